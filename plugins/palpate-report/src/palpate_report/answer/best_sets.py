"""The best set of each spot and scenario, with how well its parameters are identified."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from palpate.api import (
    FloatArray,
    IsotropicMaterial,
    PalpateError,
    Parameter,
    ParameterName,
    convert,
    mechanics,
)
from palpate.api.fit import ALL_SPOTS, UNCLEAR, share_of_range, weighed_phases
from palpate_report.data.marks import Headline
from palpate_report.data.report_data import ReportData
from palpate_report.data.tables import weighted_channels

EDGE = 0.01
"""Share of a range within which a value is at its end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Best:
    """The best set of one spot in one scenario, or of a joint fit.

    Parameters
    ----------
    fitted_to : str
        Channels that the scenario weights.
    found : str
        ``set 12`` of the sweep, or ``fit`` where a search went on from there.
    fopt : float
        At the values; of a joint fit the mean over its spots.
    fopt_least : float or None
        The least that the search has found; None of a set of the sweep.
    values : tuple of Headline
        In the order of ``ReportData.searched``.
    r2 : mapping of channel or phase to number or None
        Of a joint fit the least of its spots.
    moduli : mapping of region to (shear modulus, Young's modulus)
        At rest, in ``ReportData.modulus_unit``; of those that are searched, where the material has them.
    """

    spot: str
    scenario: str
    fitted_to: str
    found: str
    fopt: float
    fopt_least: float | None = None
    values: tuple[Headline, ...]
    r2: Mapping[str, float | None]
    moduli: Mapping[str, tuple[float, float]]

    @property
    def where(self) -> str:
        """Spot and scenario."""
        return f"{self.spot}, scenario {self.scenario}"


def best_sets(data: ReportData) -> Iterator[Best]:
    """Best set by spot and scenario, the fitted one where there is one; the joint fits come first."""
    names = (*data.measured_channels, *weighed_phases(data.study.scenarios))
    intervals = {
        (r["spot"], r["scenario"], r["parameter"]): r for r in data.identifiability.iter_rows(named=True)
    }
    sure = {
        (r["fit"], r["scenario"], r["parameter"]): r | {"level": 0.95}
        for r in data.fit.certainty.intervals.iter_rows(named=True)
    }
    chosen = (*data.selection.iter_rows(named=True), *data.fit.ends.iter_rows(named=True))
    rows = {(row["spot"], row["scenario"]): row for row in chosen}
    every = product((ALL_SPOTS, *data.spots), (s.name for s in data.study.scenarios))
    for spot, scenario in every:
        if (best := rows.get((spot, scenario))) is None:
            continue
        known = intervals | sure if "fit" in best else intervals
        values = (_value(data, best, name, known.get((spot, scenario, name), {})) for name in data.searched)
        unfinished = ", unfinished" if best.get("partial") else ""
        yield Best(
            spot=spot,
            scenario=scenario,
            fitted_to=weighted_channels(data.scenario(scenario)),
            found="fit" if "fit" in best else f"set {best['set_id']}{unfinished}",
            fopt=best["fopt"],
            fopt_least=best.get("fopt_least"),
            values=tuple(values),
            r2={name: best.get(f"r2_{name}") for name in names},
            moduli=dict(initial_moduli(data, best)),
        )


def _value(data: ReportData, best: Mapping[str, Any], name: str, interval: Mapping[str, Any]) -> Headline:
    parameter, is_fit = data.searched[name], "fit" in best
    at_bound = {ParameterName.parse(each).shared for each in (best.get("at_bound") or "").split(", ")}
    found = Headline(
        parameter=parameter.name,
        name=name,
        unit=parameter.unit,
        value=best.get(name),
        optimum=None if is_fit else interval.get("optimum"),
        lower=interval.get("lower"),
        upper=interval.get("upper"),
        identifiability=interval.get("identifiability", UNCLEAR),
        level=interval.get("level"),
        at_bound=name in at_bound,
    )
    if found.value is None:
        return found
    if found.level:  # then the value is not that of the least Fopt, of which the fit's own table speaks
        return replace(found, at_bound=_at_limit(parameter, found.value))
    if not is_fit and name in data.brief:
        drawn = data.design.values[:, list(data.brief).index(name)]
        found = replace(found, at_bound=_at_end(parameter, found, drawn))
    # The sweep's interval is of the optimum between its sets: what is outside of it has not its word.
    return found if found.is_in_interval else replace(found, identifiability=UNCLEAR)


def _at_limit(parameter: Parameter, value: float) -> bool:
    """Whether a value is at an end of its range beyond which there are others."""
    share = share_of_range(parameter, value)
    is_lowest = share < EDGE and parameter.lower > parameter.physical_lower
    return is_lowest or (share > 1.0 - EDGE and parameter.upper < parameter.physical_upper)


def _at_end(parameter: Parameter, value: Headline, drawn: FloatArray) -> bool:
    """Whether a best set is the outermost of the design, or within a spacing of the range's end.

    Not where the curves show that the optimum is inside, or do not depend on the parameter.
    """
    if value.identifiability == "not" or value.value is None:
        return False
    if value.lower is not None and value.upper is not None:
        ends = [share_of_range(parameter, end) for end in (value.lower, value.upper)]
        if ends[0] > EDGE and ends[1] < 1.0 - EDGE:
            return False
    spacing = max(EDGE, 1.0 / drawn.size)
    return (
        value.value in (drawn.min(), drawn.max())
        or not spacing < share_of_range(parameter, value.value) < 1.0 - spacing
    )


def every_value(data: ReportData, row: Mapping[str, Any]) -> dict[str, float]:
    """Values of all parameters in the units of their materials, from a row in those of the study."""
    names = (name for name in data.study.space.names if row.get(name) is not None)
    return data.study.space.complete({name: row[name] / data.factors.get(name, 1.0) for name in names})


def initial_moduli(data: ReportData, best: Mapping[str, Any]) -> Iterator[tuple[str, tuple[float, float]]]:
    """Initial shear and Young's modulus of each region that is searched, where its material has them.

    A material with directions has none: it is not as stiff along its fibres as across. They are in
    ``data.modulus_unit``.

    Parameters
    ----------
    best : mapping
        Searched values among others, by full name; None where it differs from spot to spot.
    """
    space, unit = data.study.space, convert(f"1 {data.modulus_unit}", "MPa")
    every = every_value(data, best)
    for region in (each for each in space.regions if isinstance(each.material, IsotropicMaterial)):
        values = {p.name: every[region.name_of(p.name)] for p in region.material.parameters}
        if space.columns_of(region.region) and np.isfinite(list(values.values())).all():
            try:
                mu, kappa = mechanics.initial_moduli(region.material, region.theta(values))
            except PalpateError:
                continue
            yield region.region, (mu / unit, 9.0 * kappa * mu / (3.0 * kappa + mu) / unit)


def leading(data: ReportData, bests: Sequence[Best]) -> Best | None:
    """Return the joint fit, or the best of the only spot, in the scenario that generalises."""
    main = data.generalising.name
    return next((best for best in bests if (best.spot, best.scenario) == (data.together, main)), None)
