"""Motions of an indenter, by place or by load, from the settings of a study's [protocol]; and the paper's."""

from abc import abstractmethod
from typing import Annotated

import numpy as np
from pydantic import Field

from palpate.domain import DEPTH, ROTATION, Waypoints
from palpate.domain.component import Component, Settings, SettingsT
from palpate.domain.waypoints import MOST_WAYPOINTS
from palpate.units import Quantity


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


class PressAndTwistSettings(Settings):
    """Settings of the motion ``press_and_twist``."""

    depth: Annotated[float, Quantity("mm")] = Field(gt=0.0, description="Indentation depth.")
    twist: tuple[Annotated[float, Quantity("deg")], ...] = Field(
        (), max_length=MOST_WAYPOINTS, description="Rotations travelled to, in order, at full depth."
    )


class PressAndTwist(Motion[PressAndTwistSettings]):
    """Press along the normal, then twist about it."""

    name = "press_and_twist"
    summary = "press to a depth, then rotate there to each angle in turn"

    def waypoints(self) -> Waypoints:
        """Rest, the depth, and each rotation at that depth."""
        rotations = [0.0, 0.0, *self.settings.twist]
        pose = np.zeros((len(rotations), 6))
        pose[1:, DEPTH] = self.settings.depth
        pose[:, ROTATION] = rotations
        return Waypoints(pose=pose)
