"""The sweep: every set at every spot, each result kept as it comes, none computed twice."""

import hashlib
import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.domain import (
    Design,
    FloatArray,
    HomogeneousTests,
    Indentation,
    Job,
    Limb,
    Protocol,
    Response,
    Simulation,
)
from palpate.errors import StudyError
from palpate.interfaces import Component, Material, Solver
from palpate.ledger import Ledger
from palpate.plugins import answering_for
from palpate.progress import SILENT, Progress
from palpate.study import Study
from palpate.sweep import Sweep, run_sweep


def jobs(study: Study, design: Design, measured: Mapping[str, Response]) -> list[Job]:
    """Every job of the sweep: spots in the study's order, and the same sets at each.

    Without a protocol a job is homogeneous tests along the measured abscissae.
    """
    thetas = [study.space.thetas(row) for row in design.values]
    firsts = [_job(study, spot.spot.name, 0, thetas[0], measured) for spot in study.spots] if thetas else []
    return [
        Job(
            spot=first.spot,
            set_id=set_id,
            materials=first.materials,
            thetas=thetas[set_id],
            protocol=first.protocol,
        )
        for first in firsts
        for set_id in range(design.n_sets)
    ]


def job_for(study: Study, spot: str, set_id: int, row: FloatArray, measured: Mapping[str, Response]) -> Job:
    """Make the job of one parameter set, ``row`` (n_parameters,) in design columns, at a spot."""
    return _job(study, spot, set_id, study.space.thetas(row), measured)


def _job(
    study: Study,
    spot: str,
    set_id: int,
    thetas: Mapping[str, FloatArray],
    measured: Mapping[str, Response],
) -> Job:
    return Job(
        spot=spot,
        set_id=set_id,
        materials={region.region: region.material for region in study.space.regions},
        thetas=thetas,
        protocol=study.protocol_at(spot) or homogeneous_tests(measured[spot]),
    )


def homogeneous_tests(measured: Response) -> HomogeneousTests:
    """Tests of one specimen along the measured abscissae."""
    return HomogeneousTests(paths={name: curve.abscissa for name, curve in measured.curves.items()})


def check_jobs(study: Study, to_do: Sequence[Job], limbs: Mapping[str, Limb]) -> None:
    """Refuse, before the first simulation, what cannot be simulated.

    Every set is held against the physical ranges of its material; the solver itself
    is asked about the first set of each spot.

    Raises
    ------
    PalpateError
    """
    _check_searched(study)
    asked: set[str] = set()
    for job in to_do:
        for region, theta in job.thetas.items():
            job.materials[region].check(theta)
        if job.spot not in asked:
            with answering_for(study.solver, f"checking spot '{job.spot}'"):
                study.solver.check(job, limbs.get(job.spot))
            asked.add(job.spot)


def _check_searched(study: Study) -> None:
    """Refuse to search what the solver cannot see: any value would fit as well as any other."""
    for region in study.space.regions:
        with answering_for(study.solver, f"naming what it ignores of '{region.material.name}'"):
            ignored = study.solver.ignored(region.material)
        for parameter in region.searched:
            if parameter.name in ignored:
                raise StudyError(
                    f"{study.file.name}: region.{region.region}.parameters.{parameter.name} is searched, but "
                    f"solver '{study.solver.name}' with these settings answers the same to every value; "
                    f'fix it, e.g. {parameter.name} = "{parameter.lower:g} {parameter.unit}"'
                )


# ----------------------------------------------------------------------- keys


def job_key(job: Job, limb: Limb | None, solver: Solver) -> str:
    """Hash of everything that decides the result of a job.

    That is the mesh, the spot, each region's material with its settings and values,
    the protocol, and the solver with its version and settings. The ``set_id`` is a
    name and decides nothing.
    """
    return _Keys(solver).key(job, limb_key(limb))


def limb_key(limb: Limb | None) -> str:
    """Hash of a mesh and the spot on it."""
    digest = hashlib.sha256()
    if limb is not None:
        mesh = limb.mesh
        _add(digest, limb.spot.position_mm, limb.spot.normal, mesh.points_mm, list(mesh.regions))
        for arrays in (mesh.cells, mesh.cell_regions, mesh.node_sets):
            for name in sorted(arrays):
                _add(digest, name, arrays[name])
    return digest.hexdigest()


def solver_key(solver: Solver) -> str:
    """Hash of a solver, its version and its settings."""
    digest = hashlib.sha256()
    with answering_for(solver, "asking for its version"):
        _add(digest, *_described(solver), solver.version())
    return digest.hexdigest()


class _Keys:
    """Keys of jobs, hashing but once what all sets of a spot have in common."""

    def __init__(self, solver: Solver) -> None:
        self._solver = solver_key(solver)
        # What an id stands for is kept beside the answer, so that no other takes the id meanwhile.
        self._heads: dict[tuple[str, int], tuple[Protocol, hashlib._Hash]] = {}
        self._regions: dict[tuple[str, int], tuple[Material, bytes]] = {}

    def key(self, job: Job, limb: str) -> str:
        digest = self._head(job.protocol, limb).copy()
        for region in sorted(job.materials):
            digest.update(self._region(region, job.materials[region]))
            _add(digest, job.thetas[region])
        return digest.hexdigest()

    def _head(self, protocol: Protocol, limb: str) -> "hashlib._Hash":
        found = self._heads.get((limb, id(protocol)))
        if found is None:
            digest = hashlib.sha256()
            _add(digest, limb, self._solver, *_protocol_parts(protocol))
            found = self._heads[limb, id(protocol)] = (protocol, digest)
        return found[1]

    def _region(self, region: str, material: Material) -> bytes:
        found = self._regions.get((region, id(material)))
        if found is None:
            encoded = b"".join(map(_encoded, (region, *_described(material))))
            found = self._regions[region, id(material)] = (material, encoded)
        return found[1]


def _described(component: Component) -> tuple[str, str]:
    return component.name, component.settings.model_dump_json()


def _protocol_parts(protocol: Protocol) -> Iterator[object]:
    if isinstance(protocol, Indentation):
        indenter = protocol.indenter
        yield from (
            "indentation",
            type(indenter).__name__,
            indenter.radius_mm,
            protocol.path,
            protocol.friction,
        )
    else:
        yield "homogeneous"
        for name in sorted(protocol.paths):
            yield from (name, protocol.paths[name])


def _add(digest: "hashlib._Hash", *parts: object) -> None:
    """Feed values to a hash so that neither their borders nor their shapes can be confused."""
    for part in parts:
        if isinstance(part, np.ndarray):
            digest.update(f"array {part.dtype.str} {part.shape};".encode())
            digest.update(np.ascontiguousarray(part).tobytes())
        else:
            digest.update(_encoded(part))


def _encoded(part: object) -> bytes:
    text = json.dumps(part).encode()
    return f"json {len(text)};".encode() + text


# ---------------------------------------------------------------------- sweep


def simulate(
    study: Study,
    design: Design,
    limbs: Mapping[str, Limb],
    measured: Mapping[str, Response],
    folder: Path,
    progress: Progress = SILENT,
    check: Callable[[], None] = lambda: None,
) -> tuple[Simulation, ...]:
    """Simulate every job whose result is not yet in ``folder``.

    Each result is on its way to the disk before the next is awaited, so an interrupted sweep
    goes on where it stopped. What had crashed is tried again, and what had run out of time
    when there is more of it now.

    Parameters
    ----------
    check : callable
        Raises where the lock on the folder is lost.

    Returns
    -------
    tuple of Simulation
        In the order of :func:`jobs`.

    Raises
    ------
    PalpateError
        A job cannot be simulated at all; nothing has been written then.
    StoppedError
        ``progress`` said to stop; what is finished is kept.
    """
    to_do = jobs(study, design, measured)
    check_jobs(study, to_do, limbs)
    job_keys = keys(study, to_do, limbs)
    done = run_sweep(
        Sweep(
            study=study, jobs=to_do, keys=job_keys, limbs=limbs, folder=folder, progress=progress, check=check
        )
    )
    return tuple(_of_job(done[key], job) for key, job in zip(job_keys, to_do, strict=True))


def stored(
    study: Study,
    design: Design,
    limbs: Mapping[str, Limb],
    measured: Mapping[str, Response],
    folder: Path,
    wanted: Collection[tuple[str, int]] | None = None,
) -> tuple[Simulation, ...]:
    """Results in ``folder`` that belong to this study, in the order of :func:`jobs`; computes nothing.

    ``wanted`` narrows them to these pairs of spot and set_id.
    """
    every = jobs(study, design, measured)
    to_do = [job for job in every if wanted is None or (job.spot, job.set_id) in wanted]
    job_keys = keys(study, to_do, limbs)
    with Ledger(folder) as ledger:
        found = ledger.simulations(dict(zip(job_keys, to_do, strict=True)))
    return tuple(_of_job(found[key], job) for key, job in zip(job_keys, to_do, strict=True) if key in found)


def keys(study: Study, to_do: Sequence[Job], limbs: Mapping[str, Limb]) -> list[str]:
    """Key of each job, as :func:`job_key` makes it."""
    meshes = {spot.spot.name: limb_key(limbs.get(spot.spot.name)) for spot in study.spots}
    maker = _Keys(study.solver)
    return [maker.key(job, meshes[job.spot]) for job in to_do]


def _of_job(simulation: Simulation, job: Job) -> Simulation:
    """Put the result under another set_id, where two rows of a design have one key."""
    if simulation.job is job:
        return simulation
    return replace(simulation, job=job)
