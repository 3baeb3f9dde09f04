"""What a report is made of."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import polars as pl

from palpate.domain import Channel, Design, Response, Scenario
from palpate.refinement import Refined
from palpate.study import Study


@dataclass(frozen=True, slots=True, kw_only=True)
class Content:
    """The results of a run, as the stages left them.

    Parameters
    ----------
    study : Study
    channels : mapping of name to Channel
        Axes and labels.
    measured : mapping of spot name to Response
    design : Design
    scores, selection, generalisation : DataFrame
        As :mod:`palpate.scoring`, :mod:`palpate.selection` and
        :mod:`palpate.generalisation` return them.
    refined : Refined
    rays : DataFrame
        As :func:`palpate.rays.best_on_rays` returns it.
    responses : mapping of (spot, set_id) to Response
        Simulated curves of every selected and of the generalised set.
    """

    study: Study
    channels: Mapping[str, Channel]
    measured: Mapping[str, Response]
    design: Design
    scores: pl.DataFrame
    selection: pl.DataFrame
    generalisation: pl.DataFrame
    refined: Refined
    responses: Mapping[tuple[str, int], Response]
    rays: pl.DataFrame = field(default_factory=pl.DataFrame)

    @property
    def spots(self) -> tuple[str, ...]:
        """Names of the spots, in the study's order."""
        return tuple(self.measured)

    @property
    def measured_channels(self) -> tuple[str, ...]:
        """Channels that any spot has, in the order in which they come."""
        return tuple(dict.fromkeys(name for response in self.measured.values() for name in response))

    @property
    def generalising(self) -> Scenario:
        """The scenario whose mean over the spots decides the generalised set."""
        return next(s for s in self.study.scenarios if s.name == self.study.generalise_by)

    @property
    def notice(self) -> str:
        """What every picture of these data must say."""
        return self.study.notice
