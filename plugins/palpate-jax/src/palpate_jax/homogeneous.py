"""Solver of homogeneous tests of any material, without a mesh.

The tests and their stresses are in :mod:`palpate_jax.nominal_stress`. JAX is imported by the first
simulation: a list of solvers needs none.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import version
from itertools import groupby, islice
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from palpate.api import (
    Channel,
    Curve,
    CurveError,
    FloatArray,
    HomogeneousTests,
    Job,
    Limb,
    Material,
    PalpateError,
    ParameterName,
    Provides,
    Response,
    Settings,
    Simulation,
    Solver,
    SolverError,
    Status,
    __version__,
    mechanics,
)

if TYPE_CHECKING:
    from palpate.api.mechanics import Array

SETS_AT_ONCE = 16
"""Sets evaluated in one call, for any number of sets."""


def _channel(name: str, noun: str, abscissa: str = "stretch") -> Channel:
    label = "amount of shear" if abscissa == "shear" else "stretch"
    return Channel(
        name=name,
        abscissa=abscissa,
        ordinate="stress_MPa",
        abscissa_label=label,
        ordinate_label=f"{noun} (MPa)",
    )


CHANNELS = (
    _channel("uniaxial", "uniaxial nominal stress"),
    _channel("equibiaxial", "equibiaxial nominal stress"),
    _channel("pure_shear", "pure shear nominal stress"),
    _channel("simple_shear", "shear stress", abscissa="shear"),
    _channel("confined_compression", "confined nominal stress"),
)
"""Channels of the modes; the channel's name is the mode's."""

MODES = tuple(channel.name for channel in CHANNELS)


class HomogeneousSettings(Settings):
    """Settings of :class:`HomogeneousSolver`."""

    incompressible: bool = Field(
        default=False,
        description="Keep the volume constant exactly, instead of finding the transverse stretch.",
    )


Evaluate = Callable[[FloatArray, dict[str, FloatArray]], dict[str, "Array"]]


class HomogeneousSolver(Solver[HomogeneousSettings]):
    """Stress of homogeneous tests from the energy alone, for one region."""

    name = "homogeneous"
    summary = "homogeneous tests (uniaxial, equibiaxial, pure and simple shear, confined) without a mesh"
    provides = Provides(
        body="specimen", max_regions=1, anisotropic=True, channels=MODES, slopes=True, accuracy=1e-10
    )

    def __init__(self, settings: HomogeneousSettings | None = None) -> None:
        super().__init__(settings)
        self._compiled: dict[tuple[object, ...], Evaluate] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Drop the compiled functions, which cannot be pickled."""
        return {**self.__dict__, "_compiled": {}}

    def ignored(self, material: Material) -> tuple[str, ...]:
        """Parameters of the volumetric energy, when the specimen is incompressible."""
        if not self.settings.incompressible:
            return ()
        from palpate_jax.nominal_stress import isochoric_slopes

        ranges = np.array([(p.lower, p.upper) for p in material.parameters])
        middle = ranges.mean(axis=1)
        effects = np.abs(isochoric_slopes(material, middle)).max(axis=1) * np.ptp(ranges, axis=1)
        return tuple(
            p.name
            for p, effect in zip(material.parameters, effects, strict=True)
            if effect < 1e-12 * effects.max()
        )

    def version(self) -> str:
        """Versions of palpate and of JAX."""
        return f"{__version__}, jax {version('jax')}"

    def check(self, job: Job, limb: Limb | None) -> None:
        """Refuse all but homogeneous tests of one valid material.

        Raises
        ------
        CurveError
            The protocol, a mode or a stretch cannot be tested.
        SolverError
            Several regions, or a material without a valid reference state.
        """
        self._check_tests(job)
        material, theta = _specimen(job)
        mechanics.check_reference_state(material, theta)

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        """Simulate one job; see :meth:`simulate_many`."""
        return next(self.simulate_many([job], limb))

    def simulate_many(self, jobs: Iterable[Job], limb: Limb | None) -> Iterator[Simulation]:
        """Simulate jobs, together where they share protocol and material.

        Where no equilibrium is found the status is ``diverged``, and the response
        has the points before.
        """
        for _, alike in groupby(jobs, key=_batch_key):
            while batch := list(islice(alike, SETS_AT_ONCE)):
                yield from self._simulate_alike(batch)

    def _simulate_alike(self, jobs: list[Job]) -> Iterator[Simulation]:
        started = time.perf_counter()
        refused = {k: message for k, job in enumerate(jobs) if (message := self._refusal(job))}
        accepted = [job for k, job in enumerate(jobs) if k not in refused]
        try:
            stresses = self._at_sets(accepted) if accepted else {}
            slopes = self._at_sets(accepted, slopes=True) if accepted and jobs[0].slopes else {}
        except Exception as error:  # a third party's energy may raise anything
            message = f"{type(error).__name__}: {error}"
            yield from (Simulation(job=job, status=Status.CRASHED, message=message) for job in jobs)
            return
        seconds = (time.perf_counter() - started) / len(jobs)
        rows = iter(range(len(accepted)))
        for k, job in enumerate(jobs):
            if k in refused:
                yield Simulation(job=job, status=Status.DIVERGED, message=refused[k])
            else:
                row = next(rows)
                own, d_own = ({mode: values[row] for mode, values in v.items()} for v in (stresses, slopes))
                yield _simulation(job, own, d_own, seconds)

    def _refusal(self, job: Job) -> str:
        """Reason why a job cannot be simulated; empty if it can."""
        try:
            self._check_tests(job)
            _specimen(job)
        except PalpateError as error:
            return str(error)
        return ""

    def _at_sets(self, jobs: list[Job], *, slopes: bool = False) -> dict[str, FloatArray]:
        """Stresses by mode, (n_jobs, n), or their derivatives, (n_jobs, n, n_parameters)."""
        material, _ = _specimen(jobs[0])
        thetas = np.array([_specimen(job)[1] for job in jobs])
        # One size for all: code compiled for another size may round differently, and a set's
        # result must not depend on the other sets.
        padded = np.concatenate([thetas, np.repeat(thetas[-1:], SETS_AT_ONCE - len(jobs), axis=0)])
        paths = dict(_tests(jobs[0]).paths)
        results = self._evaluate(material, tuple(paths), slopes)(padded, paths)
        return {mode: np.asarray(values)[: len(jobs)] for mode, values in results.items()}

    def _evaluate(self, material: Material, modes: tuple[str, ...], slopes: bool) -> Evaluate:
        """Compiled function for the material's class and settings, shared by its instances."""
        from palpate_jax.nominal_stress import compiled_stresses

        key = (*_kind(material), modes, slopes)
        if key not in self._compiled:
            self._compiled[key] = compiled_stresses(material, modes, self.settings.incompressible, slopes)
        return self._compiled[key]

    def _check_tests(self, job: Job) -> None:
        for mode, path in _tests(job).paths.items():
            where = f"spot '{job.spot}', channel '{mode}'"
            if mode not in MODES:
                raise SolverError(
                    f"{where}: no homogeneous test has this name; use one of: {', '.join(MODES)}"
                )
            if mode == "confined_compression" and self.settings.incompressible:
                raise SolverError(
                    f"{where}: confined compression changes the volume; "
                    "set the solver's incompressible = false, or leave this test out"
                )
            least = -np.inf if mode == "simple_shear" else 0.0
            bad = np.flatnonzero(~(np.isfinite(path) & (path > least)))
            if bad.size:
                raise CurveError(
                    f"{where}: value {path[bad[0]]} at index {bad[0]}; "
                    "give stretches (deformed length / undeformed length), finite and greater than zero"
                )


def _kind(material: Material) -> tuple[object, ...]:
    """Key of a material's energy: instances with the same key are interchangeable."""
    return type(material), material.settings.model_dump_json()


def _batch_key(job: Job) -> tuple[object, ...]:
    """Key of jobs that can be evaluated together."""
    kinds = job.slopes, *(_kind(material) for material in job.materials.values())
    if not isinstance(job.protocol, HomogeneousTests):
        return kinds
    return kinds, *((mode, path.tobytes()) for mode, path in job.protocol.paths.items())


def _tests(job: Job) -> HomogeneousTests:
    if not isinstance(job.protocol, HomogeneousTests):
        raise SolverError(
            f"spot '{job.spot}': the homogeneous solver cannot indent a limb; "
            "leave out the protocol, or choose a finite element solver"
        )
    return job.protocol


def _specimen(job: Job) -> tuple[Material, FloatArray]:
    """Return the one material of the specimen, and its checked parameters."""
    if len(job.materials) != 1:
        raise SolverError(
            f"spot '{job.spot}': a homogeneous specimen has one region, not {len(job.materials)} "
            f"({', '.join(job.materials)}); describe one"
        )
    ((region, material),) = job.materials.items()
    material.check(job.thetas[region])
    return material, job.thetas[region]


def _simulation(
    job: Job, stresses: dict[str, FloatArray], slopes: dict[str, FloatArray], seconds: float
) -> Simulation:
    """Curves up to the first point without a finite stress."""
    ((region, material),) = job.materials.items()
    names = [str(ParameterName(region, p.name)) for p in material.parameters]
    curves, problems, without = {}, [], {}
    for mode, stress in stresses.items():
        path = _tests(job).paths[mode]
        bad = np.flatnonzero(~np.isfinite(stress))
        n_good = int(bad[0]) if bad.size else path.size
        if bad.size:
            problems.append(f"{mode}: no equilibrium at {path[n_good]:g} (index {n_good})")
        if n_good >= 2 and np.ptp(path[:n_good]) > 0.0:
            own = dict(zip(names, slopes[mode][:n_good].T, strict=True)) if mode in slopes else {}
            if not all(np.isfinite(values).all() for values in own.values()):
                without[mode], own = "no finite slopes", {}
            curves[mode] = Curve(channel=mode, abscissa=path[:n_good], ordinate=stress[:n_good], slopes=own)
    return Simulation(
        job=job,
        status=Status.DIVERGED if problems else Status.OK,
        response=Response(curves=curves) if curves else None,
        message="; ".join(problems),
        seconds=seconds,
        diagnostics={"slopes": without} if without else {},
    )
