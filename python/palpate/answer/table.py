"""The answer of a run: one row for each value, with what may be read of it, made once for every output."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from types import MappingProxyType
from typing import Any

import numpy as np
import polars as pl

from palpate.answer.moduli import initial_moduli
from palpate.answer.words import (
    NOT,
    UNCLEAR,
    Adequacy,
    mark_of,
    share_of_range,
    verdict_of,
    worst_of,
)
from palpate.domain import Design, FloatArray, Parameter, ParameterName
from palpate.domain.thresholds import THRESHOLDS
from palpate.fit.fitted import reported_rows
from palpate.plugins.table import OF_ROW, StageTable, TableColumn
from palpate.run.result import ALL_SPOTS, LEVEL, FitResult
from palpate.run.tables import common
from palpate.study.reading import Study

OF_ANSWER = MappingProxyType(
    {
        "answer": StageTable(
            "Every value that was found, with its interval, its verdict and the reason.",
            {
                **common("scenario"),
                "spot": TableColumn("Name of the spot, or 'all spots'.", pl.String),
                "source": TableColumn("'fit', 'first answer', or the set of the sweep.", pl.String),
                "kind": TableColumn("'parameter' or 'modulus'.", pl.String),
                **common("parameter", "unit", "value"),
                "optimum": TableColumn("Value where Fopt of emulated curves is least.", unit=OF_ROW),
                **common("lower", "upper"),
                "level": TableColumn("Probability of the interval; null for an interval by the sweep."),
                **common("identifiability"),
                "at_bound": TableColumn("True at an end of the range.", pl.Boolean),
                "model": TableColumn("Verdict on the model.", pl.String),
                "verdict": TableColumn("Verdict on the value.", pl.String),
                "marks": TableColumn("Marks of the value in tables.", pl.String),
                "reason": TableColumn("Reason of the verdict on the model.", pl.String),
                "reported": TableColumn("True for the values that every output shows.", pl.Boolean),
            },
        )
    }
)
"""The table of the answer."""

IN_FULL = pl.col("^identifiability$").replace("not", NOT)
"""Words for identifiability, where a table has them, as people read them."""

FIT = "fit"
"""Source of values that a search has found; others are of a set of the sweep."""

PARAMETER, MODULUS = "parameter", "modulus"
"""Kinds of values; a modulus is an initial one, of a region."""


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of a run, of which the answer is made.

    Parameters
    ----------
    spots : tuple of str
    searched : mapping of full name to Parameter
        In the units of the tables, as everything here.
    design : Design
    selection, generalisation : DataFrame
        Sets of the sweep with the least Fopt.
    identifiability : DataFrame
        Intervals by the sweep.
    factors : mapping of full name to float
        From the units of the materials, where the tables have others.
    modulus_unit : str
    """

    study: Study
    spots: tuple[str, ...]
    searched: Mapping[str, Parameter]
    design: Design
    selection: pl.DataFrame
    generalisation: pl.DataFrame
    identifiability: pl.DataFrame
    fit: FitResult
    factors: Mapping[str, float] = field(default_factory=dict)
    modulus_unit: str = "MPa"


@dataclass(frozen=True, kw_only=True)
class _Source:
    """A fit or a set with its values by name, their known intervals, and the verdict on its model."""

    scenario: str
    spot: str
    text: str
    row: Mapping[str, Any]
    intervals: Mapping[str, Mapping[str, Any]]
    model: Adequacy
    reason: str
    is_fit: bool
    reported: bool = False


def answer_table(results: Results) -> pl.DataFrame:
    """Table of every value that a run has found, of fits and of sets, with the columns of :data:`OF_ANSWER`.

    One fit or set is ``reported``: the joint fit, or the fit of the only spot, in the scenario that
    generalises; without a fit the set for all spots, or of the only spot. Where its model does not describe
    the curves, no value of the run is a result.
    """
    sources = _with_lead(results, list(_sources(results)))
    rows = [row for source in sources for row in _rows(results, source)]
    return OF_ANSWER["answer"].frame(rows)


def searched_parameters(study: Study, design: Design, fit: FitResult) -> dict[str, Parameter]:
    """Parameters of the design by full name, and what a fit has searched besides, such as friction."""
    found = {p.name: p for p in design.parameters}
    fitted_names = set(fit.table.columns if fit.table.height else ())
    every = study.parametrisation.parameters(study.space, study.spot_names) if fitted_names else ()
    heads = {ParameterName.parse(p.name).shared: p for p in every}
    more = {name: replace(p, name=name) for name, p in heads.items() if name in fitted_names}
    return found | {name: p for name, p in more.items() if name not in found}


# -------------------------------------------------------------------------- fits and sets


def _sources(results: Results) -> Iterator[_Source]:
    """Fits, then sets: the joint ones first, then by spot and scenario."""
    swept, sure = (
        _intervals_of(results.identifiability, "spot"),
        _intervals_of(results.fit.intervals, "fit", level=LEVEL),
    )
    weighed = {s.name: tuple(s.weighed) for s in results.study.scenarios}
    rows_of_sets = (*_set_for_all(results), *results.selection.iter_rows(named=True))
    for rows, known, is_fit in (
        (tuple(results.fit.ends.iter_rows(named=True)), swept | sure, True),
        (rows_of_sets, swept, False),
    ):
        by_key = {(row["spot"], row["scenario"]): row for row in rows}
        for key in product((ALL_SPOTS, *results.spots), weighed):
            if (row := by_key.get(key)) is None:
                continue
            spot, scenario = key
            model, reason = _model(results, spot, scenario) if is_fit else (Adequacy.DESCRIBES, "")
            own = [by_key[of] for one in results.spots if (of := (one, scenario)) in by_key]
            # The checks of a joint fit let spots differ: then each fits by values of its own.
            is_judged = is_fit and not results.fit.adequacy.filter(fit=spot, scenario=scenario).is_empty()
            may_differ = is_judged and spot == ALL_SPOTS and len(own) == len(results.spots)
            low = _low_r2(own if may_differ else [row], weighed[scenario])
            yield _Source(
                scenario=scenario,
                spot=spot,
                text=FIT if is_fit else f"set {row['set_id']}{', unfinished' if row.get('partial') else ''}",
                row=row,
                intervals=known.get(key, {}),
                model=Adequacy.FAILS if low else model,
                reason=f"it does not fit: {', '.join(low)}" if low else reason,
                is_fit=is_fit,
            )


def _low_r2(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> list[str]:
    """Least R² of each name that has one below which nothing fits, in words."""
    found = {name: [at for row in rows if (at := row.get(f"r2_{name}")) is not None] for name in names}
    return [f"R² {name} {min(at):.3g}" for name, at in found.items() if at and min(at) < THRESHOLDS.no_fit_r2]


def _set_for_all(results: Results) -> Iterator[Mapping[str, Any]]:
    """Set with the least mean Fopt over the spots, with its least R² of each channel."""
    frame = results.generalisation
    if not frame.is_empty() and len(results.spots) > 1:
        least = {name: frame[name].min() for name in frame.columns if name.startswith("r2_")}
        yield frame.row(0, named=True) | {"spot": ALL_SPOTS} | least


def _intervals_of(
    frame: pl.DataFrame, label: str, level: float | None = None
) -> dict[tuple[str, str], dict[str, dict[str, Any]]]:
    found: dict[tuple[str, str], dict[str, dict[str, Any]]] = {}
    for row in frame.iter_rows(named=True):
        found.setdefault((row[label], row["scenario"]), {})[row["parameter"]] = row | {"level": level}
    return found


def _model(results: Results, fit: str, scenario: str) -> tuple[Adequacy, str]:
    """Verdict on the model of a fit, and the reasons."""
    # Apparent moduli are still a result; what else fails takes it away.
    own = results.fit.adequacy.filter(pl.col("check") != "relaxation", fit=fit, scenario=scenario)
    reasons = own.filter(pl.col("verdict") != Adequacy.DESCRIBES.value)["message"]
    return worst_of(own["verdict"]), "; ".join(dict.fromkeys(reasons))


def _with_lead(results: Results, sources: Sequence[_Source]) -> list[_Source]:
    """Sources with the one that is reported; where its model fails, there is no result at all."""
    main, spots = results.study.generalise_by, results.spots
    rows = reported_rows(spots, main, results.selection, results.generalisation, results.fit)
    if rows.is_empty():
        return list(sources)
    lead = (ALL_SPOTS if len(spots) > 1 else spots[0], main, "fit" in rows.columns)
    found = [replace(e, reported=(e.spot, e.scenario, e.is_fit) == lead) for e in sources]
    reported = next((each for each in found if each.reported), None)
    if reported is None or reported.model is not Adequacy.FAILS:
        return found
    return [replace(each, model=Adequacy.FAILS, reason=each.reason or reported.reason) for each in found]


# --------------------------------------------------------------------------------- values


def _rows(results: Results, source: _Source) -> Iterator[dict[str, Any]]:
    values = [
        row for name in results.searched for row in _values(results, source, name)
    ]  # those of one parameter by spot follow each other
    for row in (*values, *_moduli(results, source, values)):
        verdict = verdict_of(row["identifiability"], at_bound=row["at_bound"], model=source.model)
        yield row | {
            "scenario": source.scenario,
            "spot": source.spot,
            "source": source.text,
            "model": source.model.value,
            "verdict": verdict,
            "marks": mark_of(verdict),
            "reason": source.reason,
            "reported": source.reported,
        }


def _values(results: Results, source: _Source, name: str) -> Iterator[dict[str, Any]]:
    """Row of a parameter; one for each spot or state that has its own."""
    own = [full for full in source.intervals if ParameterName.parse(full).shared == name]
    for full in own or [name]:
        parameter, interval = results.searched[name], source.intervals.get(full, {})
        is_sure = interval.get("level") is not None
        value = interval["value"] if is_sure else source.row.get(name)
        row: dict[str, Any] = {
            "kind": PARAMETER,
            "parameter": full,
            "unit": interval["unit"] if is_sure else parameter.unit,
            "value": value,
            "optimum": None if source.is_fit else interval.get("optimum"),
            "lower": interval.get("lower"),
            "upper": interval.get("upper"),
            "level": interval.get("level"),
            "identifiability": interval.get("identifiability", UNCLEAR),
            "at_bound": False,
        }
        if value is None:
            yield row
        elif is_sure:  # then the value is not that of the least Fopt, of which the fit's own table speaks
            yield row | {"at_bound": _at_limit(parameter, value)}
        else:
            is_inside = all(
                end is None or sign * value <= sign * end
                for sign, end in ((-1.0, row["lower"]), (1.0, row["upper"]))
            )
            # The sweep's interval is of the optimum between its sets: what is outside of it has not its word.
            word = row["identifiability"] if is_inside else UNCLEAR
            yield row | {"at_bound": _at_bound(results, source, name, row), "identifiability": word}


def _at_bound(results: Results, source: _Source, name: str, row: Mapping[str, Any]) -> bool:
    """True if a value without a 95 % interval is at an end of its range."""
    drawn = [p.name for p in results.design.parameters]
    if not source.is_fit and name in drawn:
        return _at_end(results.searched[name], row, results.design.values[:, drawn.index(name)])
    at_bound = (source.row.get("at_bound") or "").split(", ")
    return name in {ParameterName.parse(each).shared for each in at_bound}


def _at_limit(parameter: Parameter, value: float) -> bool:
    """True if a value is at an end of its range, or of the one that a fit has widened it to."""
    value = min(max(value, parameter.physical_lower), parameter.physical_upper)  # beyond them by rounding
    while not parameter.lower <= value <= parameter.upper:
        parameter = parameter.wider(below=value < parameter.lower)
    share = share_of_range(parameter, value)
    is_lowest = share < THRESHOLDS.end and parameter.lower > parameter.physical_lower
    return is_lowest or (share > 1.0 - THRESHOLDS.end and parameter.upper < parameter.physical_upper)


def _at_end(parameter: Parameter, row: Mapping[str, Any], drawn: FloatArray) -> bool:
    """True if a best set is the outermost of the design, or within a spacing of the range's end.

    Not where the curves show that the optimum is inside, or do not depend on the parameter.
    """
    if row["identifiability"] == "not":
        return False
    if row["lower"] is not None and row["upper"] is not None:
        ends = [share_of_range(parameter, row[end]) for end in ("lower", "upper")]
        if ends[0] > THRESHOLDS.end and ends[1] < 1.0 - THRESHOLDS.end:
            return False
    spacing = max(THRESHOLDS.end, 1.0 / drawn.size)
    return (
        row["value"] in (drawn.min(), drawn.max())
        or not spacing < share_of_range(parameter, row["value"]) < 1.0 - spacing
    )


def _moduli(
    results: Results, source: _Source, values: Sequence[Mapping[str, Any]]
) -> Iterator[dict[str, Any]]:
    """Rows of the initial moduli of each region; one that a single parameter changes has its interval."""

    def at(row: Mapping[str, Any]) -> dict[str, float]:
        return dict(initial_moduli(results.study.space, row, results.factors, results.modulus_unit))

    row = dict.fromkeys(results.searched) | {each["parameter"]: each["value"] for each in values}
    known, moved = at(row), dict[str, list[tuple[Mapping[str, Any], float, float]]]()
    for each in values if all(each["level"] for each in values) else ():
        ends = [at(row | {each["parameter"]: each[end]}) for end in ("lower", "upper")]
        for name, modulus in known.items():
            lower, upper = (end.get(name, math.nan) for end in ends)
            if not np.allclose([lower, upper], modulus, rtol=1e-9, atol=0.0):
                moved.setdefault(name, []).append((each, min(lower, upper), max(lower, upper)))
    for name, modulus in known.items():
        by = moved.get(name, [])
        of_one, lower_end, upper_end = by[0] if len(by) == 1 else ({}, None, None)
        yield {
            "kind": MODULUS,
            "parameter": name,
            "unit": results.modulus_unit,
            "value": modulus,
            "optimum": None,
            "lower": lower_end,
            "upper": upper_end,
            "level": LEVEL if of_one else None,
            "identifiability": of_one.get("identifiability", ""),
            "at_bound": of_one.get("at_bound", False),
        }
