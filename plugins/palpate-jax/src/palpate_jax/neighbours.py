"""Sets that were simulated before, and what they say about a new one on the same limb and path.

Prescribed motion makes the displacements of all sets alike: scaling every modulus
changes none of them, and they follow the remaining numbers smoothly. So a new
set's displacements are guessed at every station by interpolation between
finished sets, and a set that is a multiple of a finished one is known.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.domain import FloatArray, Simulation
from palpate.interfaces import Material

MOST_BYTES = 500_000_000
"""Displacements kept; beyond it the oldest go."""

MOST_NEIGHBOURS = 24
"""Sets that a guess is interpolated from."""

SAME = 1e-12
"""Relative difference of parameters that counts as none."""


@dataclass(frozen=True, slots=True, eq=False)
class Guide:
    """A guess of the displacements at the stations of a path, the first one at rest.

    Parameters
    ----------
    weights : (m,) array
        Their sum is one.
    stacks : m arrays (n_stations + 1, n_nodes, 3)
        Displacements [mm] of finished sets.
    """

    weights: FloatArray
    stacks: tuple[NDArray[np.float32], ...]

    def _at(self, k: int) -> FloatArray:
        total = np.zeros(self.stacks[0].shape[1:])
        for weight, stack in zip(self.weights, self.stacks, strict=True):
            total += weight * stack[k]
        return total

    def hints(self, k: int, displacements: FloatArray) -> list[FloatArray]:
        """Guesses for station ``k`` from the state at the station before it."""
        there = self._at(k + 1)
        return [displacements + there - self._at(k), there]


@dataclass(frozen=True, slots=True, eq=False)
class _Finished:
    features: FloatArray
    values: FloatArray
    stack: NDArray[np.float32]
    simulation: Simulation


class Neighbours:
    """Finished sets of one limb, path and choice of materials.

    Parameters
    ----------
    materials : mapping of region to Material
    """

    def __init__(self, materials: Mapping[str, Material]) -> None:
        parameters = [(region, p) for region, m in materials.items() for p in m.parameters]
        self._regions = tuple(materials)
        self._moduli = np.array([p.kind == "modulus" for _, p in parameters])
        self._logarithmic = self._moduli & np.array([p.lower * p.upper > 0.0 for _, p in parameters])
        self._finished: deque[_Finished] = deque()

    def _values(self, thetas: Mapping[str, FloatArray]) -> FloatArray:
        return np.concatenate([np.asarray(thetas[region], dtype=np.float64) for region in self._regions])

    def _features(self, values: FloatArray, modulus_MPa: float) -> FloatArray:
        """What displacements follow smoothly: moduli relative to one, as logarithms if they can be."""
        features = np.where(self._moduli, values / modulus_MPa, values)
        sizes = np.abs(features)
        usable = self._logarithmic & (sizes > 0.0)
        features[usable] = np.log(sizes[usable])
        return features

    def add(
        self,
        thetas: Mapping[str, FloatArray],
        modulus_MPa: float,
        displacements: Sequence[FloatArray],
        simulation: Simulation,
    ) -> None:
        """Keep a set that reached every station; ``displacements`` start at rest."""
        values = self._values(thetas)
        stack = np.array(displacements, dtype=np.float32)
        self._finished.append(_Finished(self._features(values, modulus_MPa), values, stack, simulation))
        while len(self._finished) * stack.nbytes > max(MOST_BYTES, stack.nbytes):
            self._finished.popleft()

    def multiple(self, thetas: Mapping[str, FloatArray]) -> tuple[Simulation, float] | None:
        """A finished simulation, and the factor by which all its moduli differ from these."""
        values = self._values(thetas)
        for finished in self._finished:
            known = finished.values
            largest = np.argmax(np.where(self._moduli, np.abs(known), -1.0))
            factor = float(values[largest] / known[largest]) if self._moduli[largest] else 1.0
            scaled = np.where(self._moduli, factor * known, known)
            if factor > 0.0 and np.allclose(values, scaled, rtol=SAME, atol=0.0):
                return finished.simulation, factor
        return None

    def guide(self, thetas: Mapping[str, FloatArray], modulus_MPa: float) -> Guide | None:
        """Interpolated displacements; None while nothing is finished."""
        if not self._finished:
            return None
        features = np.array([f.features for f in self._finished])
        spread = features.std(axis=0)
        varied = spread > SAME * np.abs(features).max(axis=0)
        target = self._features(self._values(thetas), modulus_MPa)[varied] / spread[varied]
        known = features[:, varied] / spread[varied]
        nearest = np.argsort(np.linalg.norm(known - target, axis=1), kind="stable")[:MOST_NEIGHBOURS]
        weights = _interpolation(known[nearest], target)
        return Guide(weights, tuple(self._finished[i].stack for i in nearest))


def _interpolation(known: FloatArray, target: FloatArray) -> FloatArray:
    """Weights (m,) of a cubic radial interpolant with linear polynomials, at ``target``.

    The nearest set alone while there are too few for a plane.
    """
    m, d = known.shape
    if m < d + 2:
        nearest: FloatArray = np.eye(m)[0]
        return nearest
    distances = np.linalg.norm(known[:, None] - known[None], axis=2)
    plane = np.hstack([np.ones((m, 1)), known - target])
    system = np.block([[distances**3, plane], [plane.T, np.zeros((d + 1, d + 1))]])
    rhs = np.concatenate([np.linalg.norm(known - target, axis=1) ** 3, [1.0], np.zeros(d)])
    solution = np.linalg.lstsq(system, rhs, rcond=1e-12)[0]
    weights: FloatArray = np.asarray(solution[:m], dtype=np.float64)
    return weights
