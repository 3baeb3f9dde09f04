"""The sphere's path in steps: predict, balance, remember; cut a step that fails, grow after success."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from palpate.domain import FloatArray, Indentation
from palpate_jax.contact import Answer, Law, Memory, Pose
from palpate_jax.model import Load, Model
from palpate_jax.newton import equilibrium
from palpate_jax.sparse import LinearSolver

SMALLEST_CUT = 1.0 / 32.0

PROBE = 1e-4
"""How far ahead of a balanced state, as a share of the step, the predictor is taken."""


@dataclass(frozen=True, slots=True, eq=False)
class Station:
    """The balanced state at one point of the path."""

    depth_mm: float
    rotation_deg: float
    answer: Answer
    n_iterations: int


@dataclass(frozen=True, slots=True, eq=False)
class Stop:
    """Why the march ended early."""

    depth_mm: float
    rotation_deg: float
    reason: str


def stations(protocol: Indentation, depth_step_mm: float, rotation_step_deg: float) -> FloatArray:
    """Points (n, 2) of depth and rotation to balance at, waypoints included, rest left out."""
    points = []
    for start, end in zip(protocol.path[:-1], protocol.path[1:], strict=True):
        change = np.abs(end - start) / (depth_step_mm, rotation_step_deg)
        n = max(int(np.ceil(change.max() - 1e-9)), 1)
        points.append(start + (end - start) * np.arange(1, n + 1)[:, None] / n)
    return np.concatenate(points)


def pose(radius_mm: float, position: FloatArray) -> Pose:
    """The sphere at (depth_mm, rotation_deg), its lowest point at depth below the spot."""
    angle = np.deg2rad(position[1])
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return Pose(np.array([0.0, 0.0, radius_mm - position[0]]), turn)


@dataclass(slots=True, eq=False)
class _State:
    """The last balanced state."""

    position: FloatArray
    displacements: FloatArray
    memory: Memory


class March:
    """Walks a model along a path.

    Parameters
    ----------
    model : Model
    thetas : mapping of region to parameters
    law : Law
    tolerance : float
        Imbalance relative to the forces at which a point counts as balanced.
    """

    def __init__(self, model: Model, thetas: Mapping[str, FloatArray], law: Law, tolerance: float) -> None:
        self._model = model
        self._thetas = thetas
        self._law = law
        self._tolerance = tolerance
        self.linear = LinearSolver(model.pattern)
        self.n_cuts = 0
        self.n_iterations = 0

    def along(self, points: FloatArray) -> Iterator[Station | Stop]:
        """Balance at each point (n, 2) in turn; a ``Stop`` ends the march."""
        state = _State(np.zeros(2), self._model.rest(), self._model.contact.no_memory())
        for point in points:
            iterations, reason = self._advance(state, point)
            if reason:
                yield Stop(float(state.position[0]), float(state.position[1]), reason)
                return
            yield self._station(state, iterations)

    def _advance(self, state: _State, target: FloatArray) -> tuple[int, str]:
        """Reach the target in as few cuts as it takes."""
        done, share, total = 0.0, 1.0, 0
        origin = state.position
        while done < 1.0:
            share = min(share, 1.0 - done)
            last = done + share >= 1.0 - 1e-12
            position = target if last else origin + (done + share) * (target - origin)
            iterations, reason = self._step(state, position)
            total += iterations
            if not reason:
                done = 1.0 if last else done + share
                share *= 2.0
                continue
            self.n_cuts += 1
            share *= 0.5
            self.linear.reset()
            if share < SMALLEST_CUT:
                return total, reason
        return total, ""

    def _load(self, state: _State, position: FloatArray) -> Load:
        return Load(pose(self._law.radius_mm, position), state.memory, self._law)

    def _predicted(self, state: _State, position: FloatArray) -> FloatArray:
        """First guess: the linear answer to the sphere's motion, taken just ahead of the last state.

        Ahead, because at a reversal of the twist the points that slid now stick.
        """
        ahead = self._load(state, state.position + PROBE * (position - state.position))
        behind = self._model.residual(state.displacements, self._thetas, self._load(state, state.position))
        residual, tangent = self._model.linearised(state.displacements, self._thetas, ahead)
        rate = (residual.free - behind.free) / PROBE
        if not rate.any():
            return state.displacements
        step = self.linear.solve(tangent.matrix(True), tangent.preconditioner, -rate, 1e-2)
        moved = self._model.moved(state.displacements, step)
        return self._model.along_arcs(state.displacements, moved)

    def _step(self, state: _State, position: FloatArray) -> tuple[int, str]:
        load = self._load(state, position)
        try:
            start = self._predicted(state, position)
        except np.linalg.LinAlgError as error:
            return 0, str(error)
        balance = equilibrium(self._model, self._thetas, load, start, self.linear, self._tolerance)
        self.n_iterations += balance.n_iterations
        if balance.reason:
            return balance.n_iterations, balance.reason
        state.memory = self._model.contact.remember(balance.displacements, load.pose, load.memory, load.law)
        state.displacements, state.position = balance.displacements, position
        return balance.n_iterations, ""

    def _station(self, state: _State, iterations: int) -> Station:
        at = pose(self._law.radius_mm, state.position)
        answer = self._model.contact.answer(state.displacements, at, state.memory, self._law)
        return Station(float(state.position[0]), float(state.position[1]), answer, iterations)
