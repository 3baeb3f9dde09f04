"""Initial guesses of a set's displacements from the sets that were simulated before it.

With prescribed motion the displacements of all sets are similar: they do not change when all moduli
are scaled, and depend smoothly on the other parameters. So they are interpolated between finished
sets at every load step, and a multiple of a finished set needs no simulation.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.api import FloatArray, Material, Simulation

MOST_BYTES = 500_000_000
"""Displacements kept; beyond this number the oldest are dropped."""

MOST_SETS = 24
"""Sets that a guess is interpolated from."""

SAME = 1e-12
"""Relative difference of parameters that counts as none."""


@dataclass(frozen=True, slots=True, eq=False)
class InitialGuess:
    """Displacements interpolated between finished sets, at rest and at the load steps of a path.

    Parameters
    ----------
    coefficients : (m,) array
        Their sum is one.
    stacks : m arrays (n_load_steps + 1, n_nodes, 3)
        Displacements [mm] of finished sets.
    """

    coefficients: FloatArray
    stacks: tuple[NDArray[np.float32], ...]

    def _at(self, k: int) -> FloatArray:
        total = np.zeros(self.stacks[0].shape[1:])
        for coefficient, stack in zip(self.coefficients, self.stacks, strict=True):
            total += coefficient * stack[k]
        return total

    def at(self, k: int, displacements: FloatArray) -> list[FloatArray]:
        """Guesses for load step ``k`` from the state at the load step before it."""
        there = self._at(k + 1)
        return [displacements + there - self._at(k), there]


@dataclass(frozen=True, slots=True, eq=False)
class _Finished:
    features: FloatArray
    values: FloatArray
    stack: NDArray[np.float32]
    simulation: Simulation


class WarmStart:
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
        """Coordinates of the interpolation: moduli relative to one, as logarithms if possible."""
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
        """Keep a set that reached every load step; ``displacements`` start at rest."""
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

    def initial_guess(self, thetas: Mapping[str, FloatArray], modulus_MPa: float) -> InitialGuess | None:
        """Interpolated displacements; None while nothing is finished."""
        if not self._finished:
            return None
        features = np.array([f.features for f in self._finished])
        spread = features.std(axis=0)
        varied = spread > SAME * np.abs(features).max(axis=0)
        target = self._features(self._values(thetas), modulus_MPa)[varied] / spread[varied]
        known = features[:, varied] / spread[varied]
        nearest = np.argsort(np.linalg.norm(known - target, axis=1), kind="stable")[:MOST_SETS]
        coefficients = _interpolation(known[nearest], target)
        return InitialGuess(coefficients, tuple(self._finished[i].stack for i in nearest))


def _interpolation(known: FloatArray, target: FloatArray) -> FloatArray:
    """Coefficients (m,) of a cubic radial interpolant with linear polynomials, at ``target``.

    Only the nearest set if there are too few for a plane.
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
    return np.asarray(solution[:m], dtype=np.float64)
