"""Balance at prescribed loads: the components of the position that they move are unknowns too.

A trial position is balanced as any other, with the history of the step's beginning. The slopes of its
loads in the free components follow from the exact tangent, and Newton's method finds the position. Each
further trial starts from the displacements that the tangent predicts, so it is balanced in an iteration
or two.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from palpate.api import FloatArray
from palpate.api.experiment import POSE, WRENCH
from palpate_jax.contact import ContactLaw, ContactState, Memory
from palpate_jax.model import Model
from palpate_jax.newton import Balance, Start, equilibrium
from palpate_jax.schedule import DEPTH, HERTZ, Aim, motion, pose, tip_at, wrench, wrench_rates
from palpate_jax.sensitivity import Rates

MOST_TRIALS = 20


class NotReachedError(Exception):
    """A load is not reached where its component has moved as far as it may; shorter steps change nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadTrial:
    """A balanced position (6,), and the loads (6,) there."""

    position: FloatArray
    loads: FloatArray
    balance: Balance


class LoadControl:
    """Finds positions at which loads are reached.

    Parameters
    ----------
    tolerance : float
        As of load stepping.
    steps : (6,) array
        Largest step of each component [mm, degrees].

    Attributes
    ----------
    thetas : mapping of region to array
        Materials in the load step.
    """

    def __init__(
        self,
        model: Model,
        thetas: Mapping[str, FloatArray],
        law: ContactLaw,
        tolerance: float,
        steps: FloatArray,
    ) -> None:
        self._model, self.thetas, self._law = model, thetas, law
        # Accuracy of the loads, and of the balance at each trial, in tolerances.
        self._tolerance, self._steps = 1e-2 * tolerance, steps
        self._largest = np.zeros(6)

    def loads(self, displacements: FloatArray, position: FloatArray, load: ContactState) -> FloatArray:
        """Loads (6,) at an equilibrium state."""
        found = wrench(self._model.answer(displacements, self.thetas, load), tip_at(position))
        self._largest = np.maximum(self._largest, np.abs(found))
        return found

    def reach(
        self, start: LoadTrial, memory: Memory, aim: Aim, begin: Callable[[FloatArray, ContactState], Start]
    ) -> LoadTrial:
        """Go from an equilibrium state to an aim; ``begin`` gives displacements for the first trial.

        Raises
        ------
        NotReachedError
            A load is not reached at its limit.
        numpy.linalg.LinAlgError
            Nothing resists a component.
        """
        free, at = aim.free, start
        change, moved = self._change(at, memory, aim)
        low, high = np.full(free.size, -np.inf), np.full(free.size, np.inf)
        n_iterations = n_shortened = 0
        for _ in range(MOST_TRIALS):
            position = aim.position_with(at.position[free] + change)
            load = ContactState(pose(position), memory, self._law)
            guess = begin(position, load) if at is start else self._carried(at, moved, load)
            found = equilibrium(self._model, self.thetas, load, guess, self._tolerance)
            n_iterations += found.n_iterations
            if found.reason:
                n_shortened += 1
                change, moved = 0.5 * change, 0.5 * moved
                # Each trial without balance halves the change of the free components.
                if n_shortened > 5 or not change.any():
                    failed = Balance(found.displacements, n_iterations, found.reason)
                    return LoadTrial(position, at.loads, failed)
                continue
            found = replace(found, n_iterations=n_iterations)
            at = LoadTrial(position, self.loads(found.displacements, position, load), found)
            if (np.abs(aim.loads - at.loads)[free] <= self._accepted(aim)).all():
                return at
            change, moved = self._change(at, memory, aim)
            if free.size == 1:
                low, high, change, moved = _between(at, aim, low, high, change, moved)
        reason = f"the loads are not met after {MOST_TRIALS} trials"
        return replace(at, balance=Balance(at.balance.displacements, n_iterations, reason))

    def _carried(self, at: LoadTrial, moved: FloatArray, load: ContactState) -> Start:
        """Displacements that the tangent predicts."""
        return Start(self._model.carried(at.balance.displacements + moved, load.pose))

    def _accepted(self, aim: Aim) -> FloatArray:
        """Differences of the loads that count as none: a moment's by the force and the indenter's radius."""
        sizes = np.nan_to_num(np.abs(aim.loads))
        force = max(float(sizes[:3].max()), self._law.least_force_N)
        moment = max(float(sizes[3:].max()), force * self._law.shape.radius_mm)
        return self._tolerance * np.array([*[force] * 3, *[moment] * 3])[aim.free]

    def _change(self, at: LoadTrial, memory: Memory, aim: Aim) -> tuple[FloatArray, FloatArray]:
        """Change (n_free,) of the free components by Newton's method, and change of the displacements."""
        free = aim.free
        if not at.loads.any():  # off the skin: down to it, first to depth 0
            wanted = np.where(free == DEPTH, max(self._steps[DEPTH], -at.position[DEPTH]), 0.0)
            slopes = []
        else:
            slopes = [self._slope(at, memory, component) for component in free]
            matrix = np.stack([loads[free] for _, loads in slopes], axis=1)
            missing = _missing(at.loads, aim)
            if free.size == 1 and not matrix[0, 0] > 0.0:  # past a peak of the load: on, in search of more
                wanted = np.sign(missing) * self._steps[free]
            else:
                wanted = np.linalg.solve(matrix, missing)
                wanted = wanted / max(1.0, float((np.abs(wanted) / self._steps[free]).max()))
        change = self._within(at, aim, wanted)
        moved = np.zeros_like(at.balance.displacements)
        for step, (with_component, _) in zip(change, slopes, strict=False):
            moved += step * with_component
        return change, moved

    def _within(self, at: LoadTrial, aim: Aim, wanted: FloatArray) -> FloatArray:
        """The change, cut at the limits; refuse one where all that misses its load is at its limit."""
        # The end of a load step is the farthest place to which a load may move its component.
        free, limits = aim.free, np.abs(aim.target.end[aim.free])
        lowest = np.where(free == DEPTH, -np.inf, -limits)
        place = at.position[free]
        change: FloatArray = np.clip(place + wanted, lowest, limits) - place
        met = np.abs(aim.loads - at.loads)[free] <= self._accepted(aim)
        stuck = (change == 0.0) & (wanted != 0.0)
        if stuck.any() and (stuck | met).all():
            k = free[int(np.argmax(stuck))]
            (load, _, unit), (farthest, _, of) = WRENCH[k].rpartition("_"), POSE[k].rpartition("_")
            unit = unit.replace("Nmm", "N·mm")
            raise NotReachedError(
                f"{load.replace('_', ' ')} of {aim.target.loads[k]:g} {unit} is not reached up to the "
                f"farthest {farthest.replace('_', ' ')} allowed, {at.position[k]:g} {of}: the largest is "
                f"{self._largest[k]:.4g} {unit}; allow more, or ask for less"
            )
        return change

    def _slope(self, at: LoadTrial, memory: Memory, component: int) -> tuple[FloatArray, FloatArray]:
        """Change of displacements (n_nodes, 3) and loads (6,) with one component of the position."""
        way, displacements = np.eye(6)[component], at.balance.displacements
        load, move = ContactState(pose(at.position), memory, self._law), motion(at.position, way)
        here = self._model.linearised(displacements, self.thetas)
        rate, rates = here.rate(load, move), Rates(self._model, displacements, load, self.thetas)
        # Residual of the linear systems of the slopes.
        step = self._model.linear.solve(here.matrix(load), partial(here.preconditioner, load), -rate, 1e-4)
        moved = rates.carried(self._model.straight(np.zeros_like(displacements), step), move)
        change = rates.change(moved, np.zeros_like(memory.anchors), motion=move)
        force, moment, _ = rates.answer(change, moved, move)
        return moved, wrench_rates(force, moment, rates.at_rest(), tip_at(at.position), way)


def _between(
    at: LoadTrial, aim: Aim, low: FloatArray, high: FloatArray, change: FloatArray, moved: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Places below and above the wanted one, and the changes: to their middle where they would leave it.

    A load that grows with its component is between the loads below and above.
    """
    place, is_below = at.position[aim.free], (aim.loads > at.loads)[aim.free]
    low, high = np.where(is_below, place, low), np.where(is_below, high, place)
    if not np.isfinite(low + high).all() or (low < place + change < high).all():
        return low, high, change, moved
    to_middle = 0.5 * (low + high) - place
    return low, high, to_middle, moved * float(to_middle[0] / change[0]) if change.any() else moved


def _missing(loads: FloatArray, aim: Aim) -> FloatArray:
    """Misses (n_free,) of the loads; of a force as if it grew with the depth like that on a sphere."""
    missing = (aim.loads - loads)[aim.free]
    force, wanted = float(loads[DEPTH]), float(aim.loads[DEPTH])
    if force > 0.0 and wanted > 0.0:
        roots = force ** (1 / HERTZ), wanted ** (1 / HERTZ)
        missing[aim.free == DEPTH] = HERTZ * force ** (1 - 1 / HERTZ) * (roots[1] - roots[0])
    return np.asarray(missing)
