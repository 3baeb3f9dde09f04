"""Motions: where an indenter goes, or by which load, from the settings of a study's [protocol]."""

from abc import abstractmethod

from palpate.domain import Waypoints
from palpate.plugins.interfaces import Component, SettingsT


class Motion(Component[SettingsT]):
    """The motion of a rigid indenter in the frame of the spot.

    A study names it as ``motion`` of ``[protocol]``; its settings are the other keys of that table.
    """

    @abstractmethod
    def waypoints(self) -> Waypoints:
        """Poses, or loads, in the order travelled, from rest on.

        Raises
        ------
        StudyError
            The settings make no motion.
        """
