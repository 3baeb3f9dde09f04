"""The best set of each spot and scenario, with how well its parameters are identified."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import polars as pl

from palpate.domain import Parameter
from palpate.report.report_data import ReportData
from palpate.report.space import named_briefly
from palpate.report.tables import weighted_channels
from palpate.stages.identifiability import ALL_SPOTS, UNCLEAR


@dataclass(frozen=True, slots=True, kw_only=True)
class Value:
    """One parameter of a best set, with the fitted optimum and the interval around that.

    These are None where they are unknown; the set need not be in the interval.
    """

    value: float
    optimum: float | None
    lower: float | None
    upper: float | None
    identifiability: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Best:
    """The best set of one spot in one scenario.

    Parameters
    ----------
    fitted_to : str
        Channels that the scenario weights.
    found : str
        ``set 12``, or ``refined`` where a local search went on from there.
    values : tuple of Value
        In the order of the design's parameters.
    r2 : mapping of channel name to number or None
    """

    spot: str
    scenario: str
    fitted_to: str
    found: str
    fopt: float
    values: tuple[Value, ...]
    r2: Mapping[str, float | None]


def best_sets(data: ReportData) -> Iterator[Best]:
    """Best set by spot and scenario: the refined one, where there is one."""
    refined = {(r["spot"], r["scenario"]): r for r in data.refined.table.iter_rows(named=True)}
    fits = {(r["spot"], r["scenario"], r["parameter"]): r for r in data.identifiability.iter_rows(named=True)}
    fitted = {s.name: weighted_channels(s) for s in data.study.scenarios}
    for row in data.selection.iter_rows(named=True):
        key = row["spot"], row["scenario"]
        end = refined.get(key, {})
        best = end if end.get("fopt") is not None else row
        yield Best(
            spot=key[0],
            scenario=key[1],
            fitted_to=fitted[key[1]],
            found="refined" if best is end else _set(row),
            fopt=best["fopt"],
            values=tuple(_value(best[p.name], fits.get((*key, p.name))) for p in data.design.parameters),
            r2={name: best.get(f"r2_{name}") for name in data.measured_channels},
        )


def _set(row: Mapping[str, Any]) -> str:
    return f"set {row['set_id']}{', unfinished' if row.get('partial') else ''}"


def _value(value: float, fit: Mapping[str, Any] | None) -> Value:
    if fit is None:
        return Value(value=value, optimum=None, lower=None, upper=None, identifiability=UNCLEAR)
    known = {name: fit[name] for name in ("optimum", "lower", "upper", "identifiability")}
    return Value(value=value, **known)


def with_brief_names(data: ReportData) -> Iterator[tuple[Parameter, Parameter]]:
    """Pair each parameter of the design with the same under its brief name."""
    parameters = data.design.parameters
    yield from zip(parameters, named_briefly(parameters), strict=True)


def identifiability_when_generalising(data: ReportData) -> pl.DataFrame:
    """Rows of the identifiability in the scenario that generalises, spot by spot."""
    return _when_generalising(data).filter(pl.col("spot") != ALL_SPOTS)


def identifiability_together(data: ReportData) -> pl.DataFrame:
    """Rows of the identifiability by all spots together, or of the only spot."""
    rows = _when_generalising(data)
    return rows.filter(pl.col("spot") == ALL_SPOTS) if len(data.spots) > 1 else rows


def _when_generalising(data: ReportData) -> pl.DataFrame:
    if data.identifiability.is_empty():
        return pl.DataFrame(
            schema=dict.fromkeys(("spot", "parameter", "identifiability", "most_correlated_with"), pl.String)
            | dict.fromkeys(("value", "optimum", "lower", "upper", "correlation"), pl.Float64)
        )
    return data.identifiability.filter(pl.col("scenario") == data.generalising.name)
