"""Completeness of the sweep: which parameter sets were simulated at which spot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import polars as pl

from palpate.domain import Design, Scenario
from palpate.run.result import FitResult
from palpate.scoring.selection import failures, unranked, weighed_spots


@dataclass(frozen=True, slots=True, kw_only=True)
class Completeness:
    """Scored simulations of any status, against design × spots.

    Parameters
    ----------
    n_sets : int
        Sets of the design.
    simulated : mapping of spot name to int
        Sets scored at each spot of the study.
    n_everywhere : int
        Sets scored at every spot.
    """

    n_sets: int
    simulated: Mapping[str, int]
    n_everywhere: int

    @property
    def is_complete(self) -> bool:
        """Whether every set was scored at every spot."""
        return all(n == self.n_sets for n in self.simulated.values())

    def at(self, spot: str) -> str:
        """Sets of the design that were scored at a spot, such as ``3 of 16``."""
        return f"{self.simulated[spot]} of {self.n_sets}"

    def __str__(self) -> str:
        missing = [f"{spot}: {self.at(spot)}" for spot, n in self.simulated.items() if n < self.n_sets]
        where = f" ({', '.join(missing)})" if missing else ""
        return f"{sum(self.simulated.values())} of {self.n_sets * len(self.simulated)} simulations{where}"


def completeness(scores: pl.DataFrame, spots: Sequence[str], design: Design) -> Completeness:
    """Count what was scored of every set at every spot.

    Parameters
    ----------
    scores : DataFrame
        As :func:`palpate.scoring.scores.score` returns it.
    spots : sequence of str
        Every spot of the study.
    """
    pairs = scores.select("spot", "set_id").unique().filter(pl.col("set_id") < design.n_sets)
    by_spot = dict(pairs.group_by("spot").len().iter_rows())
    by_set = pairs.filter(pl.col("spot").is_in(list(spots))).group_by("set_id").len()
    return Completeness(
        n_sets=design.n_sets,
        simulated={spot: by_spot.get(spot, 0) for spot in spots},
        n_everywhere=by_set.filter(pl.col("len") == len(spots)).height,
    )


def without_result(
    scores: pl.DataFrame,
    selection: pl.DataFrame,
    scenarios: Sequence[Scenario],
    spots: Sequence[str],
    fit: FitResult | None = None,
) -> dict[tuple[str, str], str]:
    """Find every spot and scenario of the study for which no set could be selected, and none was fitted.

    Returns
    -------
    dict
        The most frequent reason by (spot, scenario).
    """
    fit = fit or FitResult()
    found = set(selection.select("spot", "scenario").iter_rows()) | fit.found
    weighed = {scenario.name: weighed_spots(scores, scenario, spots) for scenario in scenarios}
    pairs = ((spot, s) for spot in spots for s in scenarios if spot in weighed[s.name])
    missing = [(spot, scenario) for spot, scenario in pairs if (spot, scenario.name) not in found]
    if (
        scores.is_empty() and not fit.table.is_empty()
    ):  # a spot without a reason measures nothing of a scenario
        missing = [(spot, scenario) for spot, scenario in missing if fit.reason(spot, scenario.name)]
    return {(p, s.name): fit.reason(p, s.name) or _reason(scores, p, s) for p, s in missing}


def _reason(scores: pl.DataFrame, spot: str, scenario: Scenario) -> str:
    in_scenario = pl.col("channel").is_in(list(scenario.weighed))
    reasons = failures(unranked(scores.filter(pl.col("spot") == spot, in_scenario)))
    if reasons.is_empty():
        return "no simulation was scored"
    status, message, *_ = reasons.row(0)
    return f"{status}: {message}" if message else str(status)


def described(missing: Mapping[tuple[str, str], str]) -> str:
    """Name the spots and scenarios that have no result, with the first reason."""
    names = [f"{spot}, scenario {scenario}" for spot, scenario in missing]
    more = f"; and {len(names) - 4} more" if len(names) > 4 else ""
    return f"{'; '.join(names[:4])}{more}; reason: {next(iter(missing.values()))}"
