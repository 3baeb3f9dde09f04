"""Simulation of an indenter's path on prepared limbs, which are kept from job to job."""

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.api import (
    DEEPER,
    PRESS_AND_TWIST,
    FloatArray,
    Indentation,
    Job,
    Limb,
    Material,
    MaterialError,
    Simulation,
    Solver,
    Status,
)
from palpate.api.experiment import EquilibriumStates
from palpate.api.mechanics import initial_moduli
from palpate.api.mesh import SpotWrench, indentation_of
from palpate.api.runs import job_key
from palpate_jax.contact import CONTACT, ContactLaw
from palpate_jax.initial_guess import InitialGuess, WarmStart, WarmStarts, WarmStartStates
from palpate_jax.load_stepping import LoadStep, LoadStepping, Stop, explained
from palpate_jax.model import Model
from palpate_jax.schedule import REST, Schedule, schedule
from palpate_jax.sensitivity import Sensitivity
from palpate_jax.settings import JaxSettings
from palpate_jax.skin import strain_ranges, surface_states

NODES_KEPT = 40_000
"""Nodes of the limbs that stay prepared, at about 25 kB each and more in large meshes.

A fit goes from spot to spot, and between their coarse and finer meshes.
"""


@dataclass(frozen=True, slots=True, eq=False)
class _Prepared:
    """Model of a limb, and warm starts by their values and protocol."""

    limb: Limb
    materials: Mapping[str, Material]
    model: Model
    warm_starts: dict[tuple[object, ...], WarmStarts] = field(default_factory=dict)


BETWEEN = 3
"""Points of a curve between two equilibrium states: straight lines overstate a force at small depths.

Curves in time are straight between states, since a change of rate bends them."""


class PathSimulations:
    """Simulations of a solver's jobs."""

    def __init__(self, solver: Solver[JaxSettings]) -> None:
        self._solver, self.settings = solver, solver.settings
        self._materials: dict[tuple[type[Material], str], Material] = {}
        self._recent: list[_Prepared] = []
        self._states = WarmStartStates()

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        """Simulation of one job; see :meth:`JaxSolver.simulate`."""
        protocol, own = indentation_of(job, limb, self._solver.name)
        prepared = self._prepared(own, job.materials)
        started = time.perf_counter()
        warm_starts = self._warm_starts(prepared, protocol, job, limb) if job.warm_starts else None
        try:
            modulus = self._modulus(prepared, job.thetas)
        except MaterialError as error:
            return Simulation(job=job, status=Status.DIVERGED, response=None, message=str(error))
        initial_guess = None if warm_starts is None else warm_starts.initial_guess(job.thetas, modulus)
        stepping, reached, stop = self._walk(prepared, protocol, job, modulus, initial_guess)
        # A set outside the design has a negative set_id and no folder.
        if self.settings.fields != "none" and reached and job.set_id >= 0:
            self._write_fields(prepared, job, reached)
        if job.is_warm_start:
            self._states.store(
                self._states_key(job, limb), [prepared.model.rest(), *(s.displacements for s in reached)]
            )
        response = equilibrium_states(reached).observed(job.channels)
        return Simulation(
            job=job,
            status=Status.OK if stop is None else Status.DIVERGED,
            response=response if protocol.time_s is not None else response.densified(BETWEEN),
            message="" if stop is None else explained(stop, prepared.model, prepared.materials, job.thetas),
            seconds=time.perf_counter() - started,
            diagnostics=_diagnostics(reached, stepping)
            # What a prediction or a card compares, where the skin is wanted too.
            | ({"strain": strain_ranges(own, prepared.model, reached)} if job.surface else {})
            | ({} if warm_starts is None else {"n_warm_starts": len(warm_starts)}),
            surface=surface_states(own, prepared.model, reached) if job.surface else None,
        )

    def _warm_starts(
        self, prepared: _Prepared, protocol: Indentation, job: Job, limb: Limb | None
    ) -> WarmStarts:
        """Warm starts of a job that reached the end of the path."""
        assert job.warm_starts is not None
        values = {region: job.warm_starts[region] for region in prepared.materials}
        motion = (protocol.path, protocol.lateral, protocol.loads, protocol.time_s)
        arrays = [b"" if each is None else each.tobytes() for each in (*motion, *values.values())]
        key = (protocol.indenter, protocol.friction, protocol.depth_step_parts, *arrays)
        if key not in prepared.warm_starts:
            n_steps = len(self._schedule(protocol, prepared).targets)
            n = len(next(iter(values.values())))
            found: dict[int, WarmStart] = {}
            # Each worker begins with another one, so that they share what none of them has.
            for i in np.roll(np.arange(n), os.getpid() % n):
                thetas = {region: each[i] for region, each in values.items()}
                stack = self._states_of(self._warm_start(job, values, int(i)), limb)
                if stack is not None and len(stack) == 1 + n_steps:
                    found[int(i)] = thetas, self._modulus(prepared, thetas), stack
            prepared.warm_starts[key] = WarmStarts(prepared.materials, [found[i] for i in sorted(found)])
        return prepared.warm_starts[key]

    def _warm_start(self, job: Job, values: Mapping[str, FloatArray], i: int) -> Job:
        """The job of a warm start, with the warm starts that it has itself."""
        n = self._solver.n_warm_starts(i)
        return replace(
            job,
            set_id=-1,
            thetas={region: each[i] for region, each in values.items()},
            warm_starts={region: each[:n] for region, each in values.items()} if n else None,
            slopes=False,
            surface=False,
            is_warm_start=True,
        )

    def _states_of(self, warm_start: Job, limb: Limb | None) -> NDArray[np.float32] | None:
        """Displacements of a warm start, simulated here if nobody has kept them."""
        key = self._states_key(warm_start, limb)
        if (stack := self._states.load(key)) is None:
            self.simulate(warm_start, limb)
            stack = self._states.load(key)
        return stack

    def _states_key(self, job: Job, limb: Limb | None) -> str:
        """Key of a job's displacements, which what is observed of them does not change."""
        return job_key(
            replace(job, slopes=False, surface=False, channels=PRESS_AND_TWIST), limb, self._solver
        )

    def _modulus(self, prepared: _Prepared, thetas: Mapping[str, FloatArray]) -> float:
        """Initial shear modulus [MPa] where the indenter touches."""
        region = prepared.model.touched_region
        modulus, _ = initial_moduli(prepared.materials[region], thetas[region])
        return modulus

    def _walk(
        self,
        prepared: _Prepared,
        protocol: Indentation,
        job: Job,
        modulus_MPa: float,
        initial_guess: InitialGuess | None,
    ) -> tuple[LoadStepping, list[LoadStep], Stop | None]:
        law = self._law(protocol, modulus_MPa)
        model, thetas, tolerance = prepared.model, job.thetas, self.settings.tolerance
        sensitivity = (
            Sensitivity(
                model,
                prepared.materials,
                thetas,
                law,
                protocol.contact_penalty,
                tolerance,
                None if job.mesh else _penalty_per_mm(protocol, law),
            )
            if job.slopes
            else None
        )
        fields = self.settings.fields
        stepping = LoadStepping(
            model,
            thetas,
            law,
            tolerance,
            initial_guess,
            sensitivity,
            keeps_stresses=fields != "none",
            step_iterations=self.settings.step_iterations,
        )
        reached: list[LoadStep] = []
        for state in stepping.along(self._schedule(protocol, prepared)):
            if isinstance(state, Stop):
                return stepping, reached, state
            if fields == "end" and reached:
                reached[-1] = replace(reached[-1], stresses={})  # only the last are shown
            reached.append(state)
        return stepping, reached, None

    def _schedule(self, protocol: Indentation, prepared: _Prepared) -> Schedule:
        times_s = [time for material in prepared.materials.values() for time in material.relaxation_times_s]
        depth_steps = self.settings.depth_steps * protocol.depth_step_parts
        return schedule(protocol, depth_steps, self.settings.rotation_step_deg, min(times_s, default=0.0))

    def _write_fields(self, prepared: _Prepared, job: Job, reached: Sequence[LoadStep]) -> None:
        from palpate_jax.fields import FieldWriter  # here: slow to import, and rarely used

        writer = FieldWriter(prepared.limb, prepared.materials, self.settings.mean_dilatation)
        shown = reached if self.settings.fields == "all" else reached[-1:]
        writer.write(self.settings.folder_of(job.spot) / f"set-{job.set_id}", job.thetas, shown)

    def _law(self, protocol: Indentation, modulus_MPa: float) -> ContactLaw:
        """Contact whose penetration is about the same share of any depth."""
        indenter, depth = protocol.indenter, float(protocol.path[:, 0].max())
        radius = indenter.radius_mm
        dent = indenter.contact_radius_mm(depth) if depth > 0.0 else radius
        penalty = self.settings.penalty * protocol.contact_penalty * modulus_MPa / dent
        return ContactLaw(indenter, penalty, protocol.friction, 1e-3 * modulus_MPa * radius**2)

    def _prepared(self, limb: Limb, materials: Mapping[str, Material]) -> _Prepared:
        """The model of this limb, kept for later jobs on it."""
        own = {region: self._own(material) for region, material in materials.items()}
        known = (p for p in self._recent if p.materials == own and _same(p.limb, limb))
        found = next(known, None) or _Prepared(limb, own, Model(limb, own, self.settings.mean_dilatation))
        every = [found, *(p for p in self._recent if p is not found)]
        n_nodes = np.cumsum([p.limb.mesh.n_nodes for p in every])
        self._recent = [p for p, n in zip(every, n_nodes, strict=True) if p is found or n <= NODES_KEPT]
        return found

    def _own(self, material: Material) -> Material:
        """One instance for equal materials: compiled kernels are cached by identity."""
        key = (type(material), material.settings.model_dump_json())
        return self._materials.setdefault(key, material)


def _penalty_per_mm(protocol: Indentation, law: ContactLaw) -> float | None:
    """Derivative of the penalty in the one depth of a press, about; None without one."""
    if (depth := protocol.only_depth_mm) is None:
        return None
    radii = [protocol.indenter.contact_radius_mm(share * depth) for share in (1.05, 0.95)]
    return -law.penalty * float(np.log(radii[0] / radii[1])) / (0.1 * depth)


def _same(one: object, other: object) -> bool:
    """Whether two values are equal; they may be copies from other processes."""
    if one is other:
        return True
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)
    if is_dataclass(one) and type(one) is type(other):
        return all(_same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    return bool(np.array_equal(one, other))  # type: ignore[arg-type]


def equilibrium_states(reached: Sequence[LoadStep]) -> EquilibriumStates:
    """States from rest on; without slopes where one of them is not finite."""
    pose = np.array([REST, *(s.position for s in reached)])
    answers = [(s.answer.force_N, s.answer.moment_Nmm) for s in reached]
    slopes = [s.slopes for s in reached if s.slopes is not None and s.slopes.finite]
    rates = [(s.force_N, s.moment_Nmm) for s in slopes] if len(slopes) == len(reached) else []
    names = slopes[0].names if rates else ()
    times = np.array([0.0, *(s.time_s for s in reached)])
    placed = {
        name: np.array([REST, *(s.position[k] for s in slopes)])
        for k, name in enumerate(names)
        if any(s.position[k].any() for s in slopes)
    }
    wrench = {name: _wrench(pose, [(f[k], m[k]) for f, m in rates]) for k, name in enumerate(names)}
    for name, moved in placed.items():  # the moments are about a point that moves
        tips = np.column_stack([moved[:, 1:3], -moved[:, 0]])
        forces = np.array([REST[:3], *(force for force, _ in answers)])
        wrench[name] = wrench[name] + np.column_stack([np.zeros((len(pose), 3)), np.cross(tips, forces)])
    placed.pop(DEEPER, None)  # a slope in the depth is of each state
    return EquilibriumStates(
        pose=pose,
        wrench=_wrench(pose, answers),
        time_s=times if times.any() else None,
        others={c: np.array([0.0, *(getattr(s.answer, of) for s in reached)]) for c, of in CONTACT.items()},
        slopes=wrench,
        pose_slopes=placed,
    )


def _wrench(pose: FloatArray, found: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Wrenches (k, 6), or derivatives of them, of forces and moments about the spot; zeros at rest."""
    values = np.zeros((len(pose), 2, 3))
    values[1:] = np.reshape(found, (-1, 2, 3))
    from_tip = np.column_stack([-pose[:, 1:3], pose[:, 0]])
    return SpotWrench(force_N=values[:, 0], moment_Nmm=-values[:, 1]).on_tissue(from_tip)


def _diagnostics(reached: list[LoadStep], stepping: LoadStepping) -> dict[str, Any]:
    def column(values: list[FloatArray]) -> list[list[float]]:
        return [[float(v) for v in value] for value in values]

    return {
        "n_iterations": stepping.n_iterations,
        "n_factorisations": stepping.linear.n_factorisations,
        "n_cuts": stepping.n_cuts,
        "n_held": stepping.n_held,
        "depth_mm": [s.depth_mm for s in reached],
        "rotation_deg": [s.rotation_deg for s in reached],
        "force_N": column([s.answer.force_N for s in reached]),
        "moment_Nmm": column([s.answer.moment_Nmm for s in reached]),
        "contact_radius_mm": [s.answer.contact_radius_mm for s in reached],
        "penetration_mm": [s.answer.penetration_mm for s in reached],
        "sticking": [s.answer.sticking for s in reached],
        **({"slopes_s": stepping.slopes_s} if stepping.slopes_s else {}),
        **_missing_slopes(reached),
    }


def _missing_slopes(reached: list[LoadStep]) -> dict[str, str]:
    """Reason why the curves have no slopes although the job asks for them."""
    for step in reached:
        if step.slopes is not None and not step.slopes.finite:
            where = f"depth {step.depth_mm:g} mm, rotation {step.rotation_deg:g}°"
            return {"slopes": f"none: the tangent is singular at {where}"}
    return {}
