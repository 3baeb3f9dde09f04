"""FEBio, as palpate's pipeline sees it."""

import shutil
import tempfile
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from palpate.api import (
    AnisotropicMaterial,
    Job,
    Limb,
    Material,
    PalpateError,
    Provides,
    RelaxingMaterial,
    Simulation,
    Solver,
    SolverError,
    Sphere,
    Status,
    StudyError,
)
from palpate.api.experiment import STATE_COLUMNS
from palpate.api.files import Ended, ProcessLimits, run_program
from palpate.api.mesh import in_spot_frame, indentation_of
from palpate_febio import __version__
from palpate_febio.binary import Binary, examine, find_binary
from palpate_febio.contact_meshes import contact_faces
from palpate_febio.conventions import Fit, remembered, run_probe
from palpate_febio.deck import DECK_NAME, LOG_NAME, RECORD_NAME, Problem, write_deck
from palpate_febio.locking import locking_parts
from palpate_febio.outcome import Verdict, as_rows, check_torque, judge
from palpate_febio.settings import PAPER_CONTACT, FebioSettings, Method
from palpate_febio.spelling import expected_convention, written
from palpate_febio.steps import Steps, halved, steps_of, up_to_first_turn

OPTIONS = ("-noconfig", "-nosplash", "-no_title")
"""Of febio4. Never -silent: it hides what is wrong with a deck."""

HELD = 1e-3
"""Time of the hold that verifies friction, over the shortest time constant of a tissue that relaxes."""


class FebioWarning(UserWarning):
    """A setting that is known to give wrong numbers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Try:
    """One run of FEBio: which method, and what became of it."""

    method: Method
    steps: Steps
    verdict: Verdict
    ended: Ended

    def row(self) -> dict[str, Any]:
        """Row of the diagnostics."""
        return {
            "method": self.method,
            "status": self.verdict.status.value,
            "message": self.verdict.message,
            "n_steps": self.steps.n,
            "n_balanced": self.verdict.n_steps,
            "seconds": self.ended.seconds,
        }


class FebioSolver(Solver[FebioSettings]):
    """Quasi-static finite elements by FEBio 4, a program of its own.

    Each run has a folder and a process group of its own, and leaves neither
    behind. The deck, the command and the reading of the answer are methods, so
    that each can be looked at without the program.
    """

    name = "febio"
    summary = "finite elements by FEBio 4 (a program of its own): decks, conventions probed, torque verified"
    provides = Provides(anisotropic=True, columns=STATE_COLUMNS, relaxation=True)

    def __init__(self, settings: FebioSettings | None = None) -> None:
        super().__init__(settings)
        self._binary: Binary | None = None
        self._fits: dict[tuple[type[Material], str], Fit] = {}

    # ------------------------------------------------------------ the program

    def binary(self) -> Binary:
        """The installed FEBio, found and examined once.

        Raises
        ------
        PluginError
            There is none, or it is not FEBio 4.
        """
        if self._binary is None:
            self._binary = examine(find_binary(self.settings.executable))
        return self._binary

    def version(self) -> str:
        """Versions of FEBio and of this plugin, and the digest of the binary."""
        binary = self.binary()
        return f"FEBio {binary.version} ({binary.digest[:12]}), palpate-febio {__version__}"

    def command(self, folder: Path) -> list[str]:
        """Command to run in a folder that holds the deck; every name is relative to it."""
        program = str(self.binary().path)
        return [program, *OPTIONS, "-i", DECK_NAME, "-o", LOG_NAME]

    def convention(self, material: Material) -> Fit:
        """Convention in which the installed FEBio reads this material, by a probe whose result is kept.

        Raises
        ------
        MaterialError
            It computes something that is not known, or has no such material.
        """
        if isinstance(material, RelaxingMaterial):
            material = material.elastic
        key = (type(material), material.settings.model_dump_json())
        if key not in self._fits:
            binary = self.binary()
            command = [str(binary.path), *OPTIONS]
            self._fits[key] = remembered(
                material,
                binary.digest,
                lambda: run_probe(material, command, ProcessLimits(time_s=300.0, stall_s=300.0)),
            )
        return self._fits[key]

    # --------------------------------------------------------------- the deck

    def check(self, job: Job, limb: Limb | None) -> None:
        """Refuse what FEBio could not run, before it starts, and probe the materials.

        Raises
        ------
        StudyError
            No limb, or another protocol than an indentation.
        MeshError
            A mesh that FEBio would refuse.
        MaterialError
            Parameters out of range, or a material that FEBio does not have or reads in an unknown way.
        PluginError
            There is no FEBio.
        """
        from palpate.api.mechanics import check_reference_state
        from palpate.api.runs import check_limb

        _, limb = indentation_of(job, limb, self.name)
        check_limb(limb, list(job.materials))
        for region in limb.mesh.regions:
            check_reference_state(job.materials[region], job.thetas[region])
            if isinstance(job.materials[region], AnisotropicMaterial) and limb.spot.normal[2] != 1.0:
                raise SolverError(
                    f"spot '{job.spot}': region '{region}' has directions, and FEBio's deck is in the frame "
                    "of the spot, not of the mesh; give a mesh whose normal there is +z, or use solver 'jax'"
                )
        problem = self.problem(job, limb, dict.fromkeys(job.materials, "textbook"))
        if not problem.bonded:
            contact_faces(problem.mesh)
        for material in job.materials.values():
            self.convention(material)
        if not self._right:
            warnings.warn(PAPER_CONTACT, FebioWarning, stacklevel=2)
        if not problem.bonded:
            _report_locking(job, limb, problem.radius_mm)

    def locking(self, job: Job, limb: Limb) -> float:
        """Relative excess of the force where FEBio has displacement elements; 0 without any."""
        protocol, limb = indentation_of(job, limb, self.name)
        assert isinstance(protocol.indenter, Sphere)
        parts = locking_parts(limb, job.materials, job.thetas, protocol.indenter.radius_mm)
        return max(parts.values(), default=0.0)

    def problem(
        self, job: Job, limb: Limb, conventions: Mapping[str, str] | None = None, method: Method | None = None
    ) -> Problem:
        """Everything that decides the deck of a job.

        Parameters
        ----------
        conventions : mapping of region to convention, optional
            How FEBio reads each material; default: as FEBio 4.4 to 4.11 was measured to.
        method : str, optional
            Default: the first of the fallbacks.
        """
        protocol, limb = indentation_of(job, limb, self.name)
        if lacks := self.provides.lacks(job):
            raise StudyError(
                f"spot '{job.spot}': FEBio's deck presses and twists a sphere, no {', '.join(lacks)}; "
                "use solver 'jax', or another protocol"
            )
        assert isinstance(protocol.indenter, Sphere)
        method = method or self.settings.fallbacks[0]
        steps = steps_of(
            protocol, self.settings.depth_steps, self.settings.rotation_step_deg, _fastest_s(job)
        )
        known = conventions or {r: expected_convention(m) for r, m in job.materials.items()}
        return Problem(
            mesh=in_spot_frame(limb),
            materials={r: written(m, job.thetas[r], known[r]) for r, m in job.materials.items()},
            radius_mm=protocol.indenter.radius_mm,
            friction=protocol.friction,
            steps=halved(steps) if method.endswith("half_steps") else steps,
            settings=self.settings,
            method=method,
        )

    def write_deck(self, job: Job, limb: Limb) -> bytes:
        """The deck of a job as it is run first, with the measured conventions; needs no FEBio."""
        return write_deck(self.problem(job, limb))

    # ---------------------------------------------------------------- the run

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        """Try the fallbacks until a run is sound; each run is in the diagnostics."""
        started = time.perf_counter()
        try:
            protocol, limb = indentation_of(job, limb, self.name)
            conventions = {region: self.convention(m).convention for region, m in job.materials.items()}
            tries = self._tried(job, limb, conventions)
        except PalpateError as error:
            return Simulation(job=job, status=Status.CRASHED, response=None, message=str(error))
        last = tries[-1]
        states = last.verdict.states
        if last.method.endswith("half_steps"):
            states = states.cut(slice(None, None, 2))
        response = states.observed(job.channels)
        remarks = (self.binary().remark, "" if self._right else PAPER_CONTACT)
        # Statuses whose curves, whole or partial, are FEBio's answer to what was asked.
        simulation = Simulation(
            job=job,
            status=last.verdict.status,
            response=response
            if response.curves and last.verdict.status in (Status.OK, Status.DIVERGED)
            else None,
            message=last.verdict.message,
            seconds=time.perf_counter() - started,
            diagnostics={
                **as_rows(states),
                "tries": [t.row() for t in tries],
                "conventions": conventions,
                "contact": "augmented" if protocol.friction > 0.0 and self._right else "penalty",
                "remarks": [*last.verdict.log.warnings, *filter(None, remarks)],
            },
        )
        if self.settings.verification != "every":
            return simulation
        found = self.verify(job, limb, simulation)
        marked = replace(simulation, diagnostics={**simulation.diagnostics, "verification": dict(found)})
        return replace(marked, message=found["message"]) if found and not found["passed"] else marked

    @property
    def _right(self) -> bool:
        return bool(self.settings.contact == "right")

    def _tried(self, job: Job, limb: Limb, conventions: Mapping[str, str]) -> Sequence[Try]:
        tries: list[Try] = []
        for method in self.settings.fallbacks:
            tries.append(self._try(job, self.problem(job, limb, conventions, method)))
            if tries[-1].verdict.status is not Status.DIVERGED:
                return tries
        # All diverged: the longest answer, and each is on record.
        best = max(tries, key=lambda t: t.verdict.n_steps / t.steps.n)
        return [*(t for t in tries if t is not best), best]

    def _try(self, job: Job, problem: Problem, label: str = "") -> Try:
        with self._folder(job, label or problem.method) as folder:
            (folder / DECK_NAME).write_bytes(write_deck(problem))
            n_threads = str(self.settings.threads)
            ended = run_program(
                self.command(folder),
                folder,
                ProcessLimits(time_s=self.settings.time_limit, stall_s=self.settings.stall_limit),
                {"OMP_NUM_THREADS": n_threads, "MKL_NUM_THREADS": n_threads},
                is_scratch=not self.settings.keep_folder,
            )
            verdict = self.read_response(ended, folder, problem)
        return Try(method=problem.method, steps=problem.steps, verdict=verdict, ended=ended)

    def read_response(self, ended: Ended, folder: Path, problem: Problem) -> Verdict:
        """Verdict on the files of a run."""
        log, record = (
            file.read_text(errors="replace") if file.is_file() else None
            for file in (folder / LOG_NAME, folder / RECORD_NAME)
        )
        return judge(ended, log, record, problem.steps, problem.radius_mm)

    def verify(self, job: Job, limb: Limb | None, simulation: Simulation) -> Mapping[str, Any]:
        """Row of a verification of the torque by halved steps and a hold.

        Empty where nothing twists, nothing rubs, or the setting ``verification`` is "never". A run that
        was verified as it was made is not verified again.
        """
        protocol, limb = indentation_of(job, limb, self.name)
        twists = bool(protocol.path[:, 1].any()) and protocol.friction > 0.0
        if self.settings.verification == "never" or not twists or simulation.status is not Status.OK:
            return {}
        diagnostics = simulation.diagnostics
        if "verification" in diagnostics:
            return dict(diagnostics["verification"])
        problem = self.problem(job, limb, diagnostics["conventions"], diagnostics["tries"][-1]["method"])
        points = Steps(np.array(diagnostics["depth_mm"]), np.array(diagnostics["rotation_deg"]))

        def run(steps: Steps) -> Verdict:
            """Verdict on the first whole answer, or the longest; the contact stays as stiff as it was."""
            tried: list[Verdict] = []
            # Ways to solve the run that verifies another, whose steps are given.
            for method in (problem.method,) if problem.method == "broyden_soft" else ("broyden", "newton"):
                finer = replace(problem, steps=steps, method=method)
                tried.append(self._try(job, finer, f"verification-{method}").verdict)
                if tried[-1].status is not Status.DIVERGED:
                    return tried[-1]
            return max(tried, key=lambda verdict: verdict.n_steps)

        torque_Nmm = float(diagnostics["torque_Nmm"][up_to_first_turn(points).n])
        tolerance, held_s = self.settings.verification_tolerance, HELD * _fastest_s(job)
        return check_torque(problem.steps, torque_Nmm, run, tolerance, held_s).row()

    @contextmanager
    def _folder(self, job: Job, label: str) -> Iterator[Path]:
        """Folder of one run: removed afterwards, or kept under a name of its own."""
        if not self.settings.keep_folder:
            with tempfile.TemporaryDirectory(prefix="palpate-febio-") as name:
                yield Path(name)
            return
        spot = quote(job.spot, safe=" ").replace(".", "%2E")
        folder = Path(self.settings.keep_folder) / spot / f"set-{job.set_id}-{label}"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        yield folder


def _report_locking(job: Job, limb: Limb, radius_mm: float) -> None:
    """Warn of the part of a limb whose elements lock most."""
    parts = locking_parts(limb, job.materials, job.thetas, radius_mm)
    # Relative excess of the force by locking elements above which a check reports it.
    if parts and (excess := max(parts.values())) > 0.02:
        region, kind = max(parts, key=lambda part: parts[part])
        warnings.warn(
            f"spot '{job.spot}': FEBio's {kind} of region '{region}' locks. The force is up to about "
            f"{excess:.0%} too high on this mesh; use solver 'jax', or refine the mesh",
            FebioWarning,
            stacklevel=3,
        )


def _fastest_s(job: Job) -> float:
    """Shortest time constant of the materials; 0 where none relaxes."""
    return min((time for m in job.materials.values() for time in m.relaxation_times_s), default=0.0)
