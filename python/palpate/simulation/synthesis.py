"""Synthetic experiments: the curves of a study's [truth].

With them the identifiability of any limb's parameters can be studied before the experiment.
The curves come from the study's solver and mesh, so they show whether the channels identify
the parameters, not how well the model fits a limb.
"""

import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from palpate.domain import (
    Channel,
    Curve,
    FloatArray,
    Indentation,
    Job,
    Limb,
    Response,
    Status,
    channel_of,
    moving_span,
)
from palpate.domain.channels import PRESS_AND_TWIST
from palpate.domain.equilibrium_states import STATE_COLUMNS, EquilibriumStates
from palpate.errors import CurveError, StudyError
from palpate.executors.answers import plain
from palpate.experiment.measured import load_measured
from palpate.limb.loading import load_limbs
from palpate.plugins.guard import answering_for
from palpate.plugins.interfaces import ExperimentLoader
from palpate.plugins.optional import CurveWriter
from palpate.progress import SILENT, Progress
from palpate.run.atomic_files import write_atomically
from palpate.run.keys import job_key
from palpate.run.manifest import manifest
from palpate.simulation.jobs import check_jobs, homogeneous_tests
from palpate.simulation.sweep import executor_of, results
from palpate.study.reading import Study, StudySpot

NOTE = "origin.json"
"""File next to the curves with the record of their computation."""


def synthesise(
    study: Study,
    channels: Mapping[str, Channel],
    out: Path | None = None,
    *,
    noise: float = 0.0,
    seed: int = 1,
    progress: Progress = SILENT,
) -> tuple[dict[str, Response], tuple[Path, ...]]:
    """Simulate the study's truth at each spot and write the curves in place of measured ones.

    Returns the first press of each spot, from which repeats differ in their noise alone, and all files that
    were written, the record last.

    The study is read with ``need_measured=False``; its truth gives every searched parameter, and what it
    gives for a fixed one replaces the fixed value. ``out`` replaces the study's folder, and files keep their
    names. ``noise`` is the standard deviation of what is added to every ordinate, as a share of the curve's
    largest absolute value. A StudyError without a truth, for data that are not simulated, a file that exists
    or a failed simulation. A CurveError, before anything is simulated, where the loader cannot write the
    curves or does not read them back.
    """
    _check(study, noise)
    targets = _targets(study, out)
    jobs, limbs = _jobs(study, channels), load_limbs(study)
    check_jobs(study, jobs, limbs)
    _rehearse(study, jobs, channels, targets)
    exact = _simulated(study, jobs, limbs, progress)
    random = np.random.default_rng(seed)
    # One press for each file of a spot, each with different noise.
    n_presses = {s.spot.name: max(map(len, s.measured.values())) for s in study.spots}
    presses = {
        spot: [_noisy(response, noise, random) for _ in range(n_presses[spot])]
        for spot, response in exact.items()
    }
    note = _note(study, channels, jobs, limbs, {"noise": noise, "seed": seed if noise else None})
    return {spot: repeats[0] for spot, repeats in presses.items()}, _write(study, presses, targets, note)


# ----------------------------------------------------------------------- checks


def _check(study: Study, noise: float) -> None:
    where = study.file
    if study.data != "simulated":
        raise StudyError(
            f'{where}: has data = "{study.data}", but synthetic curves are simulated; '
            'set data = "simulated" in a copy of the study'
        )
    missing = [p.name for p in study.space.parameters if p.name not in study.truth]
    if missing:
        raise StudyError(
            f"{where}: [truth] gives no value for {', '.join(missing)}; give the true value of each "
            f'parameter, such as "{missing[0]}" = "…" with its unit'
        )
    if not (np.isfinite(noise) and noise >= 0.0):
        raise StudyError(f"noise {noise}: give a share of the curve's largest value, such as 0.01")
    _writer(study.loader, where)


def _writer(loader: ExperimentLoader, where: object) -> CurveWriter:
    if not isinstance(loader, CurveWriter):
        raise CurveError(
            f"{where}: loader '{loader.name}' reads curves and cannot write them; use loader 'csv'"
        )
    return loader


def _targets(study: Study, out: Path | None) -> dict[tuple[str, str | None, int], Path]:
    """File to write by spot, channel and press."""
    targets = {
        (spot.spot.name, channel, press): path if out is None else out / _inside(path, study.folder)
        for spot in study.spots
        for channel, paths in spot.measured.items()
        for press, path in enumerate(paths)
    }
    files = list(targets.values())
    for path in (*files, _note_path(files)):
        if path.exists():
            raise StudyError(
                f"{path}: exists and is not overwritten; move it, or name another folder with --into"
            )
    for path in files:
        if files.count(path) > 1:
            raise StudyError(f"{path}: is named for two curves of the study; give each a separate file")
    return targets


def _inside(path: Path, folder: Path) -> Path:
    """Path from the study's folder; the bare name of a file in another folder."""
    normal = Path(os.path.normpath(path))
    return normal.relative_to(folder) if normal.is_relative_to(folder) else Path(path.name)


def _note_path(files: Sequence[Path]) -> Path:
    return Path(os.path.commonpath([path.parent for path in files])) / NOTE


def _rehearse(
    study: Study,
    jobs: Sequence[Job],
    channels: Mapping[str, Channel],
    targets: Mapping[tuple[str, str | None, int], Path],
) -> None:
    """Refuse files that the loaders cannot write or read back, by curves of the same channels.

    Curves that only the solver knows are not rehearsed.
    """
    if study.protocol is None:
        curves = _planned(study, channels)
    elif set(study.solver.provides.channels) <= {channel.name for channel in PRESS_AND_TWIST}:
        curves = {job.spot: _stand_in(job, study.solver.provides.columns) for job in jobs}
    else:
        return
    with TemporaryDirectory() as folder:
        for spot, channel, press, content in _contents(
            study, {spot: [each] for spot, each in curves.items()}
        ):
            path = targets[spot, channel, press]
            try:
                _save(study.loader_at(spot), Path(folder, path.name), content, channel)
            except CurveError as error:
                raise CurveError(str(error).replace(folder, str(path.parent))) from error


def _stand_in(job: Job, columns: Sequence[str]) -> Response:
    """Curves of a job's channels along its motion, with numbers that no solver gives."""
    assert isinstance(job.protocol, Indentation)
    motion = job.protocol.waypoints
    # Points of a curve between two waypoints, where its file is tried before anything is simulated.
    steps = np.linspace(0.0, len(motion.pose) - 1.0, 8 * (len(motion.pose) - 1) + 1)

    def along(values: FloatArray) -> FloatArray:
        return np.array([np.interp(steps, np.arange(len(values)), each) for each in values.T]).T

    states = EquilibriumStates(
        pose=along(motion.pose),
        wrench=steps[:, None] * np.arange(1.0, 7.0),
        time_s=None if motion.time_s is None else along(motion.time_s[:, None])[:, 0],
        others={name: steps for name in columns if name not in STATE_COLUMNS},
    )
    return states.observed(job.channels)


# -------------------------------------------------------------------- simulation


def _jobs(study: Study, channels: Mapping[str, Channel]) -> list[Job]:
    thetas = {region: theta for region, theta, _ in _true_materials(study)}
    materials = {region.region: region.material for region in study.space.regions}
    protocols = {spot.spot.name: study.protocol_at(spot.spot.name) for spot in study.spots}
    if study.protocol is None:
        protocols = {spot: homogeneous_tests(m) for spot, m in _planned(study, channels).items()}
    weighed = [channel_of(name) for scenario in study.scenarios for name in scenario.weighed]
    named = {s.spot.name: [*weighed, *(name for name in s.measured if name)] for s in study.spots}
    return [
        Job(
            spot=spot,
            set_id=0,
            materials=materials,
            thetas=thetas,
            protocol=protocol,
            channels=study.observed(named[spot]),
        )
        for spot, protocol in protocols.items()
        if protocol is not None
    ]


def _planned(study: Study, channels: Mapping[str, Channel]) -> dict[str, Response]:
    """Curves with the abscissae of planned homogeneous tests."""
    for spot in study.spots:
        for path in spot.files:
            if not path.is_file():
                raise StudyError(
                    f"{path}: no such file, and the study has no [protocol]: homogeneous tests run along "
                    "the abscissae of this file; write it with any ordinates, and use --into"
                )
    return load_measured(study, channels)


def _true_materials(study: Study) -> Iterator[tuple[str, FloatArray, dict[str, float]]]:
    """Region, textbook values and the numbers as the study writes them."""
    values_of = study.space.complete(study.truth)
    for region in study.space.regions:
        numbers = {name: values_of[full] for name, full in region.full_names.items()}
        values = np.array(list(numbers.values()))
        yield region.region, region.material.to_textbook(values, region.convention), numbers


def _simulated(
    study: Study, jobs: Sequence[Job], limbs: Mapping[str, Limb], progress: Progress
) -> dict[str, Response]:
    progress.begin("synthesise", len(jobs))
    found: dict[str, Response] = {}
    with executor_of(study) as executor:
        for index, result in results(study, executor, jobs, limbs):
            progress.step(result.status.value)
            spot = jobs[index].spot
            if result.status is not Status.OK or result.response is None:
                raise StudyError(
                    f"spot '{spot}': the simulation of the truth ended {result.status.value} "
                    f"({result.message or 'no message'}); {result.status.remedy}, or change [truth]"
                )
            # Between the first and the last movement, as a loader gives them.
            curves = result.response.curves.items()
            found[spot] = Response(curves={name: c.cut(moving_span(c.abscissa)) for name, c in curves})
    return {job.spot: found[job.spot] for job in jobs}


def _noisy(response: Response, noise: float, random: np.random.Generator) -> Response:
    if noise == 0.0:
        return response
    return Response(
        curves={
            name: replace(
                curve,
                ordinate=curve.ordinate
                + random.normal(0.0, noise * np.abs(curve.ordinate).max(), curve.ordinate.size),
            )
            for name, curve in response.curves.items()
        }
    )


# ----------------------------------------------------------------------- writing


def _write(
    study: Study,
    presses: Mapping[str, Sequence[Response]],
    targets: Mapping[tuple[str, str | None, int], Path],
    note: Mapping[str, Any],
) -> tuple[Path, ...]:
    """Write all files or, when one cannot be, none."""
    written: list[Path] = []
    try:
        for spot, channel, press, content in _contents(study, presses):
            path = targets[spot, channel, press]
            path.parent.mkdir(parents=True, exist_ok=True)
            written.append(path)
            _save(study.loader_at(spot), path, content, channel)
        note_path = _note_path(written)
        text = json.dumps(note, indent=2, ensure_ascii=False, allow_nan=False)
        write_atomically(note_path, text.encode() + b"\n")
    except BaseException as error:
        for path in written:
            path.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise StudyError(f"{written[-1]}: cannot be written ({error}); use --into FOLDER") from error
        raise
    return (*written, note_path)


def _contents(
    study: Study, presses: Mapping[str, Sequence[Response]]
) -> Iterator[tuple[str, str | None, int, Response]]:
    """Spot, channel, press and curves of each file."""
    for spot in study.spots:
        for press, response in enumerate(presses[spot.spot.name]):
            for channel, content in _by_file(spot, response).items():
                if press < len(spot.measured[channel]):
                    yield spot.spot.name, channel, press, content


def _by_file(spot: StudySpot, response: Response) -> dict[str | None, Response]:
    """Curves by the channel that the study names their file for; None takes all others."""
    files: dict[str | None, Response] = {}
    for channel in spot.measured:
        wanted = [channel] if channel else [name for name in response if name not in spot.measured]
        lacking = [name for name in wanted if name not in response.curves]
        if lacking or not wanted:
            raise CurveError(
                f"spot '{spot.spot.name}': the simulation gives {', '.join(response) or 'no curve'} and "
                f"nothing for the file of {channel or 'several channels'}; correct `measured` or the protocol"
            )
        files[channel] = Response(curves={name: response[name] for name in wanted})
    return files


def _save(loader: ExperimentLoader, path: Path, response: Response, channel: str | None) -> None:
    with answering_for(loader, f"writing {path}"):
        _writer(loader, path).save(path, response, channel)
    with answering_for(loader, f"reading {path}"):
        found = loader.load(path, channel)
    if set(found) != set(response) or not all(_same(found[c], response[c]) for c in response):
        raise CurveError(
            f"{path}: loader '{loader.name}' does not read its own file (channels "
            f"{', '.join(found)} of {', '.join(response)}); check the columns and scales in its settings"
        )


def _same(found: Curve, written: Curve) -> bool:
    pairs = ((found.abscissa, written.abscissa), (found.ordinate, written.ordinate))
    # Largest difference between a curve and what is read back, relative to its largest value.
    return all(a.shape == b.shape and bool(np.abs(a - b).max() <= 1e-12 * np.abs(b).max()) for a, b in pairs)


def _note(
    study: Study,
    channels: Mapping[str, Channel],
    jobs: Sequence[Job],
    limbs: Mapping[str, Limb],
    noise: Mapping[str, Any],
) -> dict[str, Any]:
    """Record of the computation of the curves."""
    all_of_it = manifest(study, channels)
    decide = ("study", "units", "versions", "loader", "limb_source", "solver", "protocol")
    regions = {region.region: region for region in study.space.regions}
    return {
        "origin": "simulated by `palpate synthesise` with the study's solver and mesh; "
        "no limb or specimen was touched",
        **{key: all_of_it[key] for key in decide},
        "truth": {
            name: {
                "material": regions[name].material.name,
                "convention": regions[name].convention,
                "values": plain(numbers),
            }
            for name, _, numbers in _true_materials(study)
        },
        **noise,
        "meshes": {
            spot.spot.name: hashlib.sha256(spot.mesh.read_bytes()).hexdigest()
            for spot in study.spots
            if spot.mesh is not None
        },
        "simulations": {job.spot: job_key(job, limbs.get(job.spot), study.solver) for job in jobs},
    }
