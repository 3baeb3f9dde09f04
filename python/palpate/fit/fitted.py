"""Fitted values of a run, for all spots together, and their meaning at each spot."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl

from palpate.domain import FloatArray, Job, ParameterName, ParameterSpace, Response
from palpate.domain.relaxing import relaxing
from palpate.errors import StudyError
from palpate.plugins.guard import answering_for
from palpate.plugins.parametrisation import SpotInputs, at_spot
from palpate.run.result import ALL_SPOTS, FitResult
from palpate.simulation.jobs import homogeneous_tests
from palpate.study.reading import Study


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """The joint fit of a run, or else the best set of its sweep.

    Parameters
    ----------
    source : str
        ``fit``, ``first answer``, or ``set 12`` of the sweep.
    fit : str
        Its label in the tables of the fit: ``all spots``, or the only spot.
    values : mapping of name to float
        What was searched, ``<name>@<spot>`` where each spot has its own, in the units of the materials.
    spots : tuple of str
        Whose curves it was fitted to.
    is_fit : bool
        True if a fit has found the values, and no sweep.
    """

    source: str
    fit: str
    scenario: str
    values: Mapping[str, float]
    spots: tuple[str, ...]
    is_fit: bool = True


def fitted(study: Study, selection: pl.DataFrame, generalisation: pl.DataFrame, fit: FitResult) -> Fitted:
    """Find the values that a run reports, as :func:`reported_rows` chooses them.

    Raises
    ------
    StudyError
        Nothing was fitted or selected in the scenario that generalises.
    """
    rows = reported_rows(study.spot_names, study.generalise_by, selection, generalisation, fit)
    if rows.is_empty():
        raise StudyError(
            f"{study.file}: nothing is fitted or selected in scenario '{study.generalise_by}'; run "
            "`palpate run`, or see the report for why every set failed"
        )
    by_spot = {row["spot"]: row for row in rows.iter_rows(named=True)}
    spots = tuple(spot for spot in study.spot_names if spot in by_spot)
    first = by_spot[spots[0]]
    is_fit = "fit" in first
    return Fitted(
        source="fit" if is_fit else f"set {first['set_id']}",
        fit=first.get("fit") or (ALL_SPOTS if len(study.spots) > 1 else spots[0]),
        scenario=study.generalise_by,
        values=dict(_values(study, by_spot, spots, is_fit=is_fit)),
        spots=spots,
        is_fit=is_fit,
    )


def reported_rows(
    spots: Sequence[str], main: str, selection: pl.DataFrame, generalisation: pl.DataFrame, fit: FitResult
) -> pl.DataFrame:
    """Rows of the one fit or set that a run reports, by spot; empty where there is none.

    It is the joint fit, or the fit of the only spot, in the scenario ``main`` that generalises; without a fit
    the set for all spots, or of the only spot.
    """
    alone = len(spots) == 1
    own = [rows.filter(scenario=main) for rows in (fit.of_each_spot, selection)]
    candidates = (fit.joint(main), *(own if alone else ()), generalisation)
    return next((rows for rows in candidates if not rows.is_empty()), pl.DataFrame())


def _values(
    study: Study, by_spot: Mapping[str, Mapping[str, Any]], spots: Sequence[str], *, is_fit: bool
) -> Iterator[tuple[str, float]]:
    with answering_for(study.parametrisation, "asking for its parameters"):
        searched = study.parametrisation.parameters(study.space, spots)
    for text in [p.name for p in searched] if is_fit else study.space.names:
        name = ParameterName.parse(text)
        spot = next(spot for spot in spots if name.counts_at(spot, study.space.states))
        yield text, float(by_spot[spot][name.shared])


def inputs_at(
    study: Study, spot: str, values: Mapping[str, float], measured: Mapping[str, Response]
) -> SpotInputs:
    """Inputs of the simulation at a spot for values by name; a sweep's set names the materials' alone."""
    protocol = study.protocol_at(spot) or homogeneous_tests(measured[spot])
    at = at_spot(values, spot, study.space.states)
    searched = study.parametrisation.parameters(study.space, [spot])
    if not {ParameterName.parse(p.name).shared for p in searched} <= at.keys():
        row = np.array([at[name] for name in study.space.names])
        return SpotInputs(thetas=study.space.thetas(row), protocol=protocol)
    with answering_for(study.parametrisation, f"its inputs at spot '{spot}'"):
        return study.parametrisation.inputs(study.space, spot, protocol, values)


def relaxing_space(study: Study) -> ParameterSpace:
    """Materials of a study, which have the shares of all moduli of its parametrisation as their last values.

    They relax at every point of the tissue, where the parametrisation relaxes curves.
    """
    if not (times_s := tuple(study.parametrisation.times_s.values())):
        return study.space
    regions = (replace(each, material=relaxing(each.material, times_s)) for each in study.space.regions)
    return replace(study.space, regions=tuple(regions))


def relaxing_thetas(
    study: Study, thetas: Mapping[str, FloatArray], values: Mapping[str, float]
) -> dict[str, FloatArray]:
    """Textbook values of the materials of :func:`relaxing_space`, from the values of the study's materials.

    A sweep's set has no shares, and so relaxes by nothing.
    """
    shares = [values.get(name, 0.0) for name in study.parametrisation.times_s]
    return {region: np.append(theta, shares) for region, theta in thetas.items()}


def job_of(study: Study, spot: str, inputs: SpotInputs, *, surface: bool = False) -> Job:
    """Make the job of these inputs, with the states of the skin or without."""
    return Job(
        spot=spot,
        set_id=-1,  # of no row of the design
        materials={region.region: region.material for region in study.space.regions},
        thetas=inputs.thetas,
        protocol=inputs.protocol,
        surface=surface,
    )
