"""Load stepping along the indenter's path: predict, balance, store friction; halve a step that fails."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from time import process_time

import numpy as np

from palpate.api import DEEPER, FloatArray, IsotropicMaterial, Material
from palpate.api.mechanics import principal_derivatives
from palpate_jax.body import Histories
from palpate_jax.contact import Answer, ContactLaw, ContactState, Memory
from palpate_jax.initial_guess import InitialGuess
from palpate_jax.load_control import LoadControl, LoadTrial, NotReachedError
from palpate_jax.model import Model
from palpate_jax.newton import Balance, Start, equilibrium
from palpate_jax.schedule import REST, Aim, Schedule, Target, motion, pose
from palpate_jax.sensitivity import Sensitivity, Slopes
from palpate_jax.settings import STEP_ITERATIONS

GOOD_GUESS = 0.03
"""Imbalance below which an initial guess serves without the linear prediction, which costs an iteration."""

PROBE = 1e-4
"""Distance ahead of an equilibrium state, as a share of the step, at which the predictor is evaluated."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadStep:
    """The equilibrium state at one point of the path; displacements (n_nodes, 3) in mm balance the load.

    ``position`` (6,) is as in :mod:`palpate_jax.schedule`; ``stresses`` is the history of what relaxes, where
    it is kept.
    """

    position: FloatArray
    answer: Answer
    displacements: FloatArray
    load: ContactState
    slopes: Slopes | None = None
    time_s: float = 0.0
    stresses: Histories = field(default_factory=dict)

    @property
    def depth_mm(self) -> float:
        """Depth of the indenter's origin."""
        return float(self.position[0])

    @property
    def rotation_deg(self) -> float:
        """Rotation about the indenter's axis."""
        return float(self.position[5])


@dataclass(frozen=True, slots=True, eq=False)
class Stop:
    """Early end of load stepping: reason, and position (6,) and displacements of the last equilibrium state.

    With ``is_limit`` the reason is a load that is not reached, and no material or mesh is to blame.
    """

    position: FloatArray
    reason: str
    displacements: FloatArray
    is_limit: bool = False


@dataclass(slots=True, eq=False)
class _State:
    """The last equilibrium state; ``friction_history`` is the history that it was balanced with.

    Its ``loads`` (6,) are known where a load is prescribed; ``stresses`` is the history of what relaxes.
    """

    position: FloatArray
    displacements: FloatArray
    memory: Memory
    friction_history: Memory
    loads: FloatArray
    stresses: Histories
    time_s: float = 0.0


class LoadStepping:
    """Load steps of a model along a path.

    Parameters
    ----------
    tolerance : float
        Imbalance relative to the forces at which a point counts as balanced.
    initial_guess : InitialGuess, optional
        Of the same model and path.
    sensitivity : Sensitivity, optional
        Follows every equilibrium state, also between points.
    keeps_stresses : bool
        Whether load steps have the history of what relaxes, which takes much memory.
    step_iterations : int
        Newton iterations for each load step of the path, on average; a path that takes more is given up.
    """

    def __init__(
        self,
        model: Model,
        thetas: Mapping[str, FloatArray],
        law: ContactLaw,
        tolerance: float,
        initial_guess: InitialGuess | None = None,
        sensitivity: Sensitivity | None = None,
        keeps_stresses: bool = False,
        step_iterations: int = STEP_ITERATIONS,
    ) -> None:
        self._model = model
        self._values = thetas
        self._thetas = thetas  # in the load step
        self._law = law
        self._tolerance = tolerance
        self._initial_guess = initial_guess
        self._sensitivity = sensitivity
        self._keeps_stresses = keeps_stresses
        self._step_iterations = step_iterations
        self._most_iterations = 0  # of the path
        self._control: LoadControl | None = None
        self._settled = False  # whether the last tangent is of an iteration that ended in balance
        self.linear = model.linear
        self.linear.restart()
        self.n_cuts = 0
        self.n_iterations = 0
        self.n_held = 0
        self.slopes_s = 0.0

    def along(self, schedule: Schedule) -> Iterator[LoadStep | Stop]:
        """Balance at each target in turn; the last may be a ``Stop``."""
        nothing = self._model.contact.no_memory(pose(REST))
        stresses = self._model.body.at_rest()
        state = _State(REST, self._model.rest(), nothing, nothing, np.zeros(6), stresses)
        if schedule.has_loads:
            self._control = LoadControl(self._model, self._values, self._law, self._tolerance, schedule.steps)
        # At least ten: a path of few large steps may halve each of them.
        self._most_iterations = self._step_iterations * max(len(schedule.targets), 10)
        for k, target in enumerate(schedule.targets):
            # Where a load moves the indenter the first trial's position is not that of the guesses.
            guessed = None if target.has_loads else self._initial_guess
            guesses = [] if guessed is None else guessed.at(k, state.displacements)
            is_limit = False
            try:
                reason = self._advance(state, target, guesses)
            except NotReachedError as error:
                reason, is_limit = str(error), True
            if reason:
                yield Stop(state.position, reason, state.displacements, is_limit)
                return
            yield self._load_step(state, target.time_s)

    def _advance(self, state: _State, target: Target, guesses: Sequence[FloatArray]) -> str:
        """Step to the target, halving a step that fails; returns the reason if it cannot be reached."""
        done, share = 0.0, 1.0
        origin, origin_s = (state.position, state.loads), state.time_s
        if self._sensitivity is not None:
            self._sensitivity.start()
        while done < 1.0:
            if self.n_iterations >= self._most_iterations:
                return (
                    f"given up after {self.n_iterations} Newton iterations, {self._step_iterations} for each "
                    "load step (setting step_iterations),"
                )
            share = min(share, 1.0 - done)
            last = done + share >= 1.0 - 1e-12
            part = 1.0 if last else done + share
            aim, time_s = Aim.at(target, *origin, part), origin_s + part * (target.time_s - origin_s)
            reason = self._step(state, aim, time_s, guesses if share == 1.0 else ())
            if reason and guesses and share == 1.0:
                self.linear.reset()
                reason = self._step(state, aim, time_s, ())
            if not reason:
                done = part
                share *= 2.0
                continue
            self.n_cuts += 1
            share *= 0.5
            self.linear.reset()
            if share < 1.0 / 32.0:
                return reason
        return ""

    def _load(self, state: _State, position: FloatArray) -> ContactState:
        return ContactState(pose(position), state.memory, self._law)

    def _predicted(self, state: _State, position: FloatArray) -> FloatArray:
        """Initial guess: the linear response to the indenter's motion, just ahead of the last state.

        Ahead, because at a reversal of the twist the points that slid now stick.
        """
        model, way = self._model, position - state.position
        ahead = self._load(state, state.position + PROBE * way)
        carried = model.carried(state.displacements, ahead.pose)
        here = model.linearised(carried, self._thetas, nearly=self._settled)
        rate = here.rate(ahead, motion(state.position, way))
        if not rate.any():
            return state.displacements
        step = self.linear.solve(here.matrix(ahead), partial(here.preconditioner, ahead), -rate, 1e-3)
        straight = model.straight(state.displacements, step)
        is_lateral = way[1:5].any() or state.position[1:5].any()
        return straight if is_lateral else model.along_arcs(state.displacements, straight)

    def _start(
        self, state: _State, load: ContactState, position: FloatArray, guesses: Sequence[FloatArray]
    ) -> Start:
        """The first good guess; without one, the guess or linear prediction that is nearest to balance."""
        best = Start(self._model.carried(state.displacements, load.pose))
        for guess in guesses:
            if best.imbalance > GOOD_GUESS:
                best = self._nearer(best, guess, load)
        if best.imbalance > GOOD_GUESS:
            with suppress(np.linalg.LinAlgError):
                best = self._nearer(best, self._predicted(state, position), load)
        return best

    def _nearer(self, best: Start, guess: FloatArray, load: ContactState) -> Start:
        carried = self._model.carried(guess, load.pose)
        found = Start(carried, self._model.forces(carried, self._thetas).residual(load))
        assert found.residual is not None
        return found if found.residual.least_jacobian > 0.0 and found.imbalance < best.imbalance else best

    def _step(self, state: _State, aim: Aim, time_s: float, guesses: Sequence[FloatArray]) -> str:
        """Go a part of the way of a load step, until a time; returns the reason if that fails."""
        body = self._model.body
        self._thetas = body.in_step(self._values, state.stresses, time_s - state.time_s)
        if self._control is not None:
            self._control.thetas = self._thetas
        if aim.free.size:
            found = self._to_loads(state, aim)
            position, balance = found.position, found.balance
        else:
            position = aim.position
            load = self._load(state, position)
            start = self._start(state, load, position, guesses)
            left = self._most_iterations - self.n_iterations
            balance = equilibrium(self._model, self._thetas, load, start, self._tolerance, left)
        self.n_iterations += balance.n_iterations
        self.n_held += balance.held
        self._settled = not balance.reason and balance.n_iterations > 0
        if not balance.reason:
            load = self._load(state, position)
            state.displacements, state.position, state.friction_history = (
                balance.displacements,
                position,
                state.memory,
            )
            if self._sensitivity is not None:
                moves = self._control is not None or DEEPER in self._sensitivity.slopes.names
                reached = replace(aim, position=position) if moves else None
                began_s = process_time()
                self._sensitivity.balanced(state.displacements, load, self._thetas, reached)
                self.slopes_s += process_time() - began_s
            if self._control is not None:
                state.loads = self._control.loads(state.displacements, position, load)
            state.memory = self._model.contact.remember(state.displacements, load)
            state.stresses, state.time_s = body.after(state.displacements, self._thetas), time_s
        return balance.reason

    def _to_loads(self, state: _State, aim: Aim) -> LoadTrial:
        def begin(position: FloatArray, load: ContactState) -> Start:
            return self._start(state, load, position, ())

        assert self._control is not None
        here = LoadTrial(state.position, state.loads, Balance(state.displacements, 0, ""))
        try:
            return self._control.reach(here, state.memory, aim, begin)
        except np.linalg.LinAlgError as error:
            failed = Balance(state.displacements, 0, f"no resistance to the loads ({error})")
            return LoadTrial(state.position, state.loads, failed)

    def _load_step(self, state: _State, time_s: float) -> LoadStep:
        load = ContactState(pose(state.position), state.friction_history, self._law)
        answer = self._model.answer(state.displacements, self._thetas, load)
        slopes = None if self._sensitivity is None else self._sensitivity.slopes
        stresses = state.stresses if self._keeps_stresses else {}
        return LoadStep(state.position, answer, state.displacements, load, slopes, time_s, stresses)


def explained(
    stop: Stop, model: Model, materials: Mapping[str, Material], thetas: Mapping[str, FloatArray]
) -> str:
    """The stop in words: the symptom, where on the path, and the likely cause.

    A material is unstable where ∂²Ψ/∂ε_i∂ε_j in the logarithmic principal strains is not positive
    definite (Drucker), which is checked at every quadrature point of the last equilibrium state.
    Materials that are not isotropic are not examined.
    """
    where = f"beyond {_place(stop.position)}"
    if stop.is_limit:
        return f"{stop.reason} ({where})"
    least = np.inf
    for block in model.body.blocks:
        F, factor = (each[block.volumes > 0.0] for each in block.deformation(stop.displacements))
        least = min(least, float(np.linalg.det(F).min()))
        material = materials[block.region]
        if not isinstance(material, IsotropicMaterial):
            continue
        stretches: FloatArray = factor[:, None] * np.linalg.svd(F, compute_uv=False)
        stiffness = _least_stiffness(material, stretches, thetas[block.region])
        if stiffness.min() <= 0.0:
            worst = ", ".join(f"{s:.2f}" for s in stretches[int(np.argmin(stiffness))])
            return (
                f"{stop.reason} {where}: the material of region '{block.region}' is unstable there, at "
                f"{int((stiffness <= 0.0).sum())} of {stiffness.size} points, worst at stretches {worst}; "
                "smaller steps do not help; a stability filter drops such sets"
            )
    # Ratio of volumes at a quadrature point below which its element counts as about to invert.
    if least < 0.05:
        return f"{stop.reason} {where}: an element is crushed to {least:.3f} of its volume; refine the mesh"
    return (
        f"{stop.reason} {where}: the material is stable there, but the contact finds no equilibrium; "
        "try more depth_steps, a smaller rotation_step_deg, or a finer mesh under the indenter"
    )


def _place(position: FloatArray) -> str:
    """Position (6,) in words; shifts and tilts only where there are any."""
    depth, *lateral, rotation = position.tolist()
    words = [f"depth {depth:.2f} mm", f"rotation {rotation:.1f} degrees"]
    for name, unit, pair in (("shift", "mm", lateral[:2]), ("tilt", "degrees", lateral[2:])):
        words += [f"{name} ({pair[0]:.2f}, {pair[1]:.2f}) {unit}"] if any(pair) else []
    return ", ".join(words)


def _least_stiffness(material: IsotropicMaterial, stretches: FloatArray, theta: FloatArray) -> FloatArray:
    """Least eigenvalue (n,) of λ_i λ_j ψ_ij + δ_ij λ_i ψ_i [MPa] at stretches (n, 3)."""
    psi_i, psi_ij = (np.asarray(d) for d in principal_derivatives(material, stretches, theta))
    hessians = stretches[:, :, None] * stretches[:, None, :] * psi_ij
    hessians[:, range(3), range(3)] += stretches * psi_i
    return np.linalg.eigvalsh(np.nan_to_num(hessians, nan=-1.0))[:, 0]
