"""The sweep: every set at every spot; each result is stored as it comes, none computed twice."""

import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.domain import (
    Design,
    FloatArray,
    HomogeneousTests,
    Job,
    Limb,
    ParameterName,
    Response,
    Simulation,
)
from palpate.errors import PluginError, StudyError
from palpate.plugins.guard import answering_for
from palpate.progress import SILENT, Progress
from palpate.run.keys import JobKeys
from palpate.run.ledger import Ledger
from palpate.sampling.drawing import NO_ROW
from palpate.simulation.sweep import Simulations, of_job
from palpate.study.reading import Study
from palpate.toml_text import toml_value


def jobs(study: Study, design: Design, measured: Mapping[str, Response]) -> list[Job]:
    """Every job of the sweep: spots in the study's order, and the same sets at each.

    Without a protocol a job is homogeneous tests along the measured abscissae. Where the solver uses
    warm starts, they are the first sets of the design: the same however a sweep is stopped, resumed, extended
    or spread.
    """
    thetas = [study.space.thetas(row) for row in design.values]
    is_warm_start, warm_starts = _warm_starts(study, design)
    first = design.values[:1]
    return [
        replace(
            job,
            set_id=set_id,
            thetas=thetas[set_id],
            warm_starts=warm_starts[set_id],
            is_warm_start=is_warm_start[set_id],
        )
        for job in [job_for(study, spot, 0, row, measured) for spot in study.spot_names for row in first]
        for set_id in range(design.n_sets)
    ]


def _warm_starts(study: Study, design: Design) -> tuple[list[bool], list[Mapping[str, FloatArray] | None]]:
    """Whether each set is a warm start of others, and the values of its own warm starts."""
    with answering_for(study.solver, "asking for its warm starts"):
        if not study.solver.n_warm_starts(sys.maxsize):
            return [False] * design.n_sets, [None] * design.n_sets
    first = design.first_values
    numbers = {row.tobytes(): number for number, row in reversed([*enumerate(first)])}
    number = [numbers.get(row.tobytes(), len(first)) for row in design.values]
    with answering_for(study.solver, "asking for its warm starts"):
        counts = list(map(study.solver.n_warm_starts, number))
    n_warm_starts = max(counts, default=0)
    thetas = [study.space.thetas(row) for row in first[:n_warm_starts]]
    regions = thetas[0] if thetas else ()
    stacked = {region: np.array([each[region] for each in thetas]) for region in regions}
    warm_starts: dict[int, Mapping[str, FloatArray] | None] = {0: None}
    for n in {*counts} - {0}:
        warm_starts[n] = {region: values[:n] for region, values in stacked.items()}
    return [k < n_warm_starts for k in number], [warm_starts[n] for n in counts]


def job_for(study: Study, spot: str, set_id: int, row: FloatArray, measured: Mapping[str, Response]) -> Job:
    """Make the job of one parameter set, ``row`` (n_parameters,) in design columns, at a spot."""
    return Job(
        spot=spot,
        set_id=set_id,
        materials={region.region: region.material for region in study.space.regions},
        thetas=study.space.thetas(row),
        protocol=study.protocol_at(spot) or homogeneous_tests(measured[spot]),
        channels=study.observed(measured.get(spot) or ()),
    )


def homogeneous_tests(measured: Response) -> HomogeneousTests:
    """Tests of one specimen along the measured abscissae."""
    return HomogeneousTests(paths={name: curve.abscissa for name, curve in measured.curves.items()})


def middle_jobs(study: Study, measured: Mapping[str, Response]) -> list[Job]:
    """One job at each spot in the middle of the ranges: what a solver can check where there is no sweep."""
    middle = np.array([0.5 * (p.lower + p.upper) for p in study.space.parameters])
    return [job_for(study, spot, NO_ROW, middle, measured) for spot in study.spot_names]


def check_jobs(study: Study, to_do: Sequence[Job], limbs: Mapping[str, Limb]) -> None:
    """Refuse a job that cannot be simulated, before the first simulation.

    Every set is checked against the physical ranges of its material; the solver checks
    the first set of each spot.

    Raises
    ------
    PalpateError
    """
    _check_searched(study)
    asked: set[str] = set()
    for job in to_do:
        for region, theta in job.thetas.items():
            with answering_for(job.materials[region], f"checking set {job.set_id}"):
                job.materials[region].check(theta)
        if (name := job.limb_name) not in asked:
            # A study that was not read from a file, or a further press, may ask in vain.
            if lacks := study.solver.provides.lacks(job):
                raise StudyError(
                    f"spot '{job.spot}': solver '{study.solver.name}' does not provide {', '.join(lacks)}; "
                    "name another solver"
                )
            with answering_for(study.solver, f"checking spot '{name}'"):
                study.solver.check(job, limbs.get(name))
            asked.add(name)


def _check_searched(study: Study) -> None:
    """Refuse to search what the solver does not use, nor what is tied to it: every value would fit."""
    place = study.place("fit", "parametrisation")
    with answering_for(study.parametrisation, f"{place}: asking for its parameters"):
        names = [p.name for p in study.parametrisation.parameters(study.space, study.spot_names)]
    if twice := {name for name in names if names.count(name) > 1}:
        raise PluginError(
            f"{place}: '{study.parametrisation.name}' searches {', '.join(sorted(twice))} twice; correct the "
            "plugin, or name another parametrisation"
        )
    used: set[str] = set()
    for region in study.space.regions:
        with answering_for(study.solver, f"naming ignored parameters of '{region.material.name}'"):
            ignored = study.solver.ignored(region.material)
        seen = (full for name, full in region.full_names.items() if name not in ignored)
        used |= {root for name in seen for root in study.space.roots(name)}
    for parameter in study.space.parameters:
        if parameter.name not in used:
            name, value = ParameterName.parse(parameter.name), f"{parameter.lower:g} {parameter.unit}"
            raise StudyError(
                f"{study.place('region', name.region, 'parameters', name.name)}: is searched, but "
                f"solver '{study.solver.name}' with these settings does not use this parameter; "
                f"fix it, e.g. {name.name} = {toml_value(value) if parameter.unit else value.strip()}"
            )


# ---------------------------------------------------------------------- sweep


def simulate(
    study: Study,
    design: Design,
    limbs: Mapping[str, Limb],
    measured: Mapping[str, Response],
    folder: Path,
    progress: Progress = SILENT,
) -> tuple[Simulation, ...]:
    """Simulate every job whose result is not yet in ``folder``; results are in the order of :func:`jobs`.

    Each result goes to the writer before the next is awaited, so an interrupted sweep continues
    where it stopped. Crashed jobs are tried again, and those that timed out if the time limit
    is larger now.

    Raises
    ------
    PalpateError
        A job cannot be simulated at all; nothing has been written then.
    StoppedError
        ``progress`` requested a stop; finished results are kept.
    """
    to_do = jobs(study, design, measured)
    check_jobs(study, to_do, limbs)
    with Simulations(study, folder, limbs, progress) as simulations:
        simulations.plan(to_do)
        return tuple(simulations.of(to_do))


def stored(
    study: Study,
    design: Design,
    limbs: Mapping[str, Limb] | None,
    measured: Mapping[str, Response],
    folder: Path,
    wanted: Collection[tuple[str, int]] | None = None,
) -> tuple[Simulation, ...]:
    """Results in ``folder`` that belong to this study, in the order of :func:`jobs`; computes nothing.

    ``wanted`` narrows them to these pairs of spot and set_id. Without ``limbs`` the simulations of the
    last sweep in the folder.
    """
    every = jobs(study, design, measured)
    to_do = [job for job in every if wanted is None or (job.spot, job.set_id) in wanted]
    with Ledger(folder) as ledger:
        if limbs is not None:
            job_keys = keys(study, to_do, limbs)
        else:
            sweep = ledger.sweep().select("spot", "set_id", "key")
            planned = {(spot, set_id): key for spot, set_id, key in sweep.iter_rows()}
            to_do = [job for job in to_do if (job.spot, job.set_id) in planned]
            job_keys = [planned[job.spot, job.set_id] for job in to_do]
        found = ledger.simulations(dict(zip(job_keys, to_do, strict=True)))
    return tuple(of_job(found[key], job) for key, job in zip(job_keys, to_do, strict=True) if key in found)


def keys(study: Study, to_do: Sequence[Job], limbs: Mapping[str, Limb]) -> list[str]:
    """Key of each job, as :func:`palpate.run.keys.job_key` makes it."""
    maker = JobKeys(study.solver, limbs, study.trusted)
    return [maker.key(job) for job in to_do]
