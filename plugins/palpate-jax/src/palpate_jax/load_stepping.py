"""Load stepping along the indenter's path: predict, balance, store friction; halve a step that fails."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

import numpy as np

from palpate.api import FloatArray, Indentation
from palpate_jax.contact import Answer, ContactLaw, ContactState, Memory, Motion, Pose
from palpate_jax.initial_guess import InitialGuess
from palpate_jax.model import Model
from palpate_jax.newton import Start, equilibrium
from palpate_jax.sensitivity import Sensitivity, Slopes

SMALLEST_CUT = 1.0 / 32.0

GOOD_GUESS = 0.03
"""Imbalance below which an initial guess serves without the linear prediction, which costs an iteration."""

PROBE = 1e-4
"""Distance ahead of a balanced state, as a share of the step, at which the predictor is evaluated."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadStep:
    """The balanced state at one point of the path; displacements (n_nodes, 3) in mm balance the load."""

    depth_mm: float
    rotation_deg: float
    answer: Answer
    displacements: FloatArray
    load: ContactState
    slopes: Slopes | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Stop:
    """Why load stepping ended early; displacements (n_nodes, 3) in mm of the last balanced state."""

    depth_mm: float
    rotation_deg: float
    reason: str
    displacements: FloatArray


def load_steps(protocol: Indentation, depth_steps: int, rotation_step_deg: float) -> FloatArray:
    """Load steps (n, 2) of depth and rotation, with the waypoints and without the rest."""
    depth_step_mm = max(float(protocol.path[:, 0].max()), 1e-9) / depth_steps
    points = []
    for start, end in zip(protocol.path[:-1], protocol.path[1:], strict=True):
        change = np.abs(end - start) / (depth_step_mm, rotation_step_deg)
        n = max(int(np.ceil(change.max() - 1e-9)), 1)
        between = start + (end - start) * np.arange(1, n + 1)[:, None] / n
        between[-1] = end  # to the last bit, so that no branch starts next to a waypoint
        points.append(between)
    return np.concatenate(points)


def pose(position: FloatArray) -> Pose:
    """The indenter at (depth_mm, rotation_deg), its lowest point at depth below the spot."""
    angle = np.deg2rad(position[1])
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return Pose(np.array([0.0, 0.0, -position[0]]), turn)


def motion(way: FloatArray) -> Motion:
    """The indenter's motion along a change of (depth_mm, rotation_deg)."""
    return Motion(np.array([0.0, 0.0, -way[0]]), np.array([0.0, 0.0, np.deg2rad(way[1])]))


@dataclass(slots=True, eq=False)
class _State:
    """The last balanced state; ``felt`` is the history that it was balanced with."""

    position: FloatArray
    displacements: FloatArray
    memory: Memory
    felt: Memory


class LoadStepping:
    """Load steps of a model along a path.

    Parameters
    ----------
    model : Model
    thetas : mapping of region to parameters
    law : ContactLaw
    tolerance : float
        Imbalance relative to the forces at which a point counts as balanced.
    initial_guess : InitialGuess, optional
        Of the same model and path.
    sensitivity : Sensitivity, optional
        Follows every balanced state, also between points.
    """

    def __init__(
        self,
        model: Model,
        thetas: Mapping[str, FloatArray],
        law: ContactLaw,
        tolerance: float,
        initial_guess: InitialGuess | None = None,
        sensitivity: Sensitivity | None = None,
    ) -> None:
        self._model = model
        self._thetas = thetas
        self._law = law
        self._tolerance = tolerance
        self._initial_guess = initial_guess
        self._sensitivity = sensitivity
        self._settled = False  # whether the last tangent is of an iteration that ended in balance
        self.linear = model.linear
        self.linear.restart()
        self.n_cuts = 0
        self.n_iterations = 0
        self.n_held = 0

    def along(self, points: FloatArray) -> Iterator[LoadStep | Stop]:
        """Balance at each point (n, 2) in turn; the last may be a ``Stop``."""
        nothing = self._model.contact.no_memory(pose(np.zeros(2)))
        state = _State(np.zeros(2), self._model.rest(), nothing, nothing)
        for k, point in enumerate(points):
            guesses = [] if self._initial_guess is None else self._initial_guess.at(k, state.displacements)
            reason = self._advance(state, point, guesses)
            if reason:
                depth, rotation = map(float, state.position)
                yield Stop(depth, rotation, reason, state.displacements)
                return
            yield self._load_step(state)

    def _advance(self, state: _State, target: FloatArray, guesses: Sequence[FloatArray]) -> str:
        """Step to the target, halving a step that fails; returns the reason if it cannot be reached."""
        done, share = 0.0, 1.0
        origin = state.position
        while done < 1.0:
            share = min(share, 1.0 - done)
            last = done + share >= 1.0 - 1e-12
            position = target if last else origin + (done + share) * (target - origin)
            reason = self._step(state, position, guesses if share == 1.0 else ())
            if reason and guesses and share == 1.0:
                self.linear.reset()
                reason = self._step(state, position, ())
            if not reason:
                done = 1.0 if last else done + share
                share *= 2.0
                continue
            self.n_cuts += 1
            share *= 0.5
            self.linear.reset()
            if share < SMALLEST_CUT:
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
        rate = here.rate(ahead, motion(way))
        if not rate.any():
            return state.displacements
        step = self.linear.solve(here.matrix(ahead), partial(here.preconditioner, ahead), -rate, 1e-3)
        return model.along_arcs(state.displacements, model.straight(state.displacements, step))

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

    def _step(self, state: _State, position: FloatArray, guesses: Sequence[FloatArray]) -> str:
        load = self._load(state, position)
        start = self._start(state, load, position, guesses)
        balance = equilibrium(self._model, self._thetas, load, start, self.linear, self._tolerance)
        self.n_iterations += balance.n_iterations
        self.n_held += balance.held
        self._settled = not balance.reason and balance.n_iterations > 0
        if not balance.reason:
            state.displacements, state.position, state.felt = balance.displacements, position, state.memory
            if self._sensitivity is not None:
                self._sensitivity.balanced(state.displacements, load)
            state.memory = self._model.contact.remember(state.displacements, load)
        return balance.reason

    def _load_step(self, state: _State) -> LoadStep:
        load = ContactState(pose(state.position), state.felt, self._law)
        answer = self._model.answer(state.displacements, self._thetas, load)
        slopes = None if self._sensitivity is None else self._sensitivity.slopes
        depth, rotation = map(float, state.position)
        return LoadStep(depth, rotation, answer, state.displacements, load, slopes)
