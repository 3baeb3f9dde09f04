"""Initial guesses of a set's displacements from its warm starts: the sets that it may start from.

With prescribed motion the displacements of all sets are similar: they do not change when all moduli
are scaled, and depend smoothly on the other parameters. So they are interpolated between the warm starts at
every load step, and corrected by what the interpolation missed at the step before.
"""

import contextlib
import io
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import platformdirs
from numpy.typing import NDArray

from palpate.api import FloatArray, Material
from palpate.api.files import write_atomically

MOST_BYTES = 8_000_000_000
"""Size of the folder beyond which the files that were used longest ago are deleted."""


class WarmStartStates:
    """Displacements of warm starts by key: on disk, or in memory where that is impossible.

    Parameters
    ----------
    folder : Path, optional
        By default in the user's cache folder.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder or platformdirs.user_cache_path("palpate") / "warm_starts"
        self._in_memory: dict[str, NDArray[np.float32]] = {}

    def load(self, key: str) -> NDArray[np.float32] | None:
        """Displacements (n, n_nodes, 3) [mm] of the n states reached, with that at rest; None if not kept."""
        if key in self._in_memory:
            return self._in_memory[key]
        path = self._path(key)
        try:
            stack = np.load(path, mmap_mode="r")
        except (OSError, ValueError, EOFError):
            return None
        with contextlib.suppress(OSError):  # a folder of someone else may be read too
            os.utime(path)
        return stack if stack.dtype == np.float32 and stack.ndim == 3 else None

    def store(self, key: str, displacements: Sequence[FloatArray]) -> None:
        """Keep the displacements, from rest, of every state that was reached."""
        stack = np.array(displacements, dtype=np.float32)
        content = io.BytesIO()
        np.save(content, stack)
        try:
            self._path(key).parent.mkdir(parents=True, exist_ok=True)
            write_atomically(self._path(key), content.getvalue())
        except OSError:
            self._in_memory[key] = stack
        self._prune()

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}.npy"

    def _prune(self) -> None:
        """Delete the oldest files of a folder that is too large."""
        with contextlib.suppress(OSError):  # another worker may delete too
            found = sorted((e.stat().st_mtime, e.stat().st_size, e.path) for e in os.scandir(self._folder))
            total = sum(size for _, size, _ in found)
            free = shutil.disk_usage(self._folder).free
            # No more than this share of the free disk.
            excess = total - min(MOST_BYTES, 0.2 * (total + free))
            for _, size, path in found:
                if excess <= 0:
                    return
                os.unlink(path)
                excess -= size


@dataclass(frozen=True, slots=True, eq=False)
class InitialGuess:
    """Displacements interpolated between warm starts, at rest and at the load steps of a path.

    Parameters
    ----------
    coefficients : (m,) array
        Their sum is one.
    stacks : m arrays (n_load_steps + 1, n_nodes, 3)
        Displacements [mm] of the warm starts.
    """

    coefficients: FloatArray
    stacks: Sequence[NDArray[np.float32]]

    def at(self, k: int, displacements: FloatArray) -> list[FloatArray]:
        """Guesses for load step ``k`` from the state at the load step before it, the best first."""
        before, after = (np.array([stack[i] for stack in self.stacks], dtype=float) for i in (k, k + 1))
        there = np.tensordot(self.coefficients, after, 1)
        if k == 0:
            return [there]
        corrected = self.coefficients + self._correction(before, displacements)
        return [displacements + np.tensordot(corrected, after - before, 1), there]

    def _correction(self, before: FloatArray, displacements: FloatArray) -> FloatArray:
        """Change (m,) of the coefficients that interpolates the state at the load step before best.

        By least squares with a ridge; its sum is zero.
        """
        m = len(before)
        spread = (before - before.mean(axis=0)).reshape(m, -1)
        missed = displacements - np.tensordot(self.coefficients, before, 1)
        gram = spread @ spread.T
        system = np.ones((m + 1, m + 1))
        # Ridge of the correction, relative to the mean square of the warm starts' displacements.
        system[:m, :m] = gram + (1e-7 * np.trace(gram) / m + np.finfo(float).tiny) * np.eye(m)
        system[m, m] = 0.0
        rhs = np.append(spread @ missed.ravel(), 0.0)
        return np.linalg.lstsq(system, rhs, rcond=None)[0][:m]


WarmStart = tuple[Mapping[str, FloatArray], float, NDArray[np.float32]]
"""Parameters by region, initial shear modulus [MPa] where the indenter touches, and displacements
(n_load_steps + 1, n_nodes, 3) [mm] from rest, of a set that reached every load step."""


class WarmStarts:
    """Warm starts of one limb, path and choice of materials."""

    def __init__(self, materials: Mapping[str, Material], warm_starts: Sequence[WarmStart]) -> None:
        parameters = [(region, p) for region, m in materials.items() for p in m.parameters]
        self._regions = tuple(materials)
        self._moduli = np.array([p.kind == "modulus" for _, p in parameters])
        self._logarithmic = self._moduli & np.array([p.lower * p.upper > 0.0 for _, p in parameters])
        self._stacks = [stack for _, _, stack in warm_starts]
        self._features = np.array([self._of(thetas, modulus_MPa) for thetas, modulus_MPa, _ in warm_starts])

    def __len__(self) -> int:
        return len(self._stacks)

    def _of(self, thetas: Mapping[str, FloatArray], modulus_MPa: float) -> FloatArray:
        """Coordinates of the interpolation: moduli relative to one, as logarithms if possible."""
        values = np.concatenate([np.asarray(thetas[region], dtype=float) for region in self._regions])
        features = np.where(self._moduli, values / modulus_MPa, values)
        sizes = np.abs(features)
        usable = self._logarithmic & (sizes > 0.0)
        features[usable] = np.log(sizes[usable])
        return features

    def initial_guess(self, thetas: Mapping[str, FloatArray], modulus_MPa: float) -> InitialGuess | None:
        """Interpolated displacements; None without warm starts."""
        if not self._stacks:
            return None
        spread = self._features.std(axis=0)
        # Relative difference of parameters that counts as none.
        varied = spread > 1e-12 * np.abs(self._features).max(axis=0)
        target = self._of(thetas, modulus_MPa)[varied] / spread[varied]
        known = self._features[:, varied] / spread[varied]
        # Warm starts that a guess is interpolated from: the nearest.
        nearest = np.argsort(np.linalg.norm(known - target, axis=1), kind="stable")[:24]
        coefficients = _interpolation(known[nearest], target)
        return InitialGuess(coefficients, [self._stacks[i] for i in nearest])


def _interpolation(known: FloatArray, target: FloatArray) -> FloatArray:
    """Coefficients (m,) of a cubic radial interpolant with linear polynomials, at ``target``.

    Only the nearest set if there are too few for a plane.
    """
    m, d = known.shape
    if m < d + 2:
        return np.eye(m)[0]
    distances = np.linalg.norm(known[:, None] - known[None], axis=2)
    plane = np.hstack([np.ones((m, 1)), known - target])
    system = np.block([[distances**3, plane], [plane.T, np.zeros((d + 1, d + 1))]])
    rhs = np.concatenate([np.linalg.norm(known - target, axis=1) ** 3, [1.0], np.zeros(d)])
    solution = np.linalg.lstsq(system, rhs, rcond=1e-12)[0]
    return np.asarray(solution[:m], dtype=np.float64)
