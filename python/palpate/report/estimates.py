"""The parameters that lead, each with its interval."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import polars as pl

from palpate.report.best_sets import Best, leading
from palpate.report.report_data import ReportData
from palpate.report.rounding import rounded
from palpate.run.result import ALL_SPOTS


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A parameter of the joint fit, of the set for all spots, or of the only spot.

    Parameters
    ----------
    parameter : str
        Brief name; ``<name>@<spot>`` where each spot has its own.
    unit : str
    value, lower, upper : float or None
        None where they are unknown, and the value where it differs from spot to spot.
    identifiability : str
    level : float or None
        0.95 where the interval is that of a fit; None where it is what fits about as well in the sweep.
    """

    parameter: str
    unit: str
    value: float | None
    lower: float | None
    upper: float | None
    identifiability: str
    level: float | None

    def __str__(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        ends, known = (self.lower, self.upper), ""
        if self.lower is not None and self.upper is not None:
            known = f"{rounded(self.lower, *ends)} to {rounded(self.upper, *ends)}, "
        value = "by spot" if self.value is None else f"= {rounded(self.value, *ends)}{unit}"
        return f"{self.parameter} {value} ({known}{self.identifiability})"


def estimates(data: ReportData, bests: Sequence[Best]) -> Iterator[Estimate]:
    """Parameters of what leads, with the intervals of the fit where it has them, else of the sweep."""
    main = data.generalising.name
    rows = data.fit.certainty.intervals
    if not rows.is_empty():
        rows = rows.filter(fit=data.together, scenario=main)
    for row in rows.iter_rows(named=True):
        head, at, spot = row["parameter"].partition("@")
        ends = {name: row[name] for name in ("unit", "value", "lower", "upper", "identifiability")}
        name = data.searched[head].name if head in data.searched else head
        yield Estimate(parameter=f"{name}{at}{spot}", level=0.95, **ends)
    if not rows.is_empty():
        return
    best = leading(data, bests)
    swept = data.identified(together=True)
    for i, (name, parameter) in enumerate(data.searched.items()):
        chosen = next(data.generalisation.iter_rows(named=True), {}) if best is None else {}
        row = next(swept.filter(parameter=name).iter_rows(named=True), {})
        yield Estimate(
            parameter=parameter.name,
            unit=parameter.unit,
            value=chosen.get(name) if best is None else best.values[i].value,
            lower=row.get("lower"),
            upper=row.get("upper"),
            identifiability=row.get("identifiability", "unclear"),
            level=None,
        )


def draws_of(data: ReportData, scenario: str, most: int) -> pl.DataFrame:
    """Draws of the fit that leads: those of its posterior, else those of its normal density; else none."""
    for frame in (data.posterior.posterior_draws, data.fit.certainty.draws):
        if not frame.is_empty():
            rows = frame.filter(pl.col("fit").is_in([data.together, ALL_SPOTS]), scenario=scenario)
            if not rows.is_empty():
                return rows.gather_every(-(-rows.height // most))
    return pl.DataFrame()
