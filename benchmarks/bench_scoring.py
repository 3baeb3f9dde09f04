"""Times of the kernels, each with a peer in the same run: ``make bench``.

The peer of a score is what a script would do: ``np.interp`` on each monotone piece of the
twist, then the mean squared error. Each line is the least of several rounds.
"""

import sys
import timeit
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.stats import qmc

from palpate import _core

N_SETS, N_POINTS, N_ROUNDS = 250, 201, 7


def twist(n_points: int) -> tuple[np.ndarray, np.ndarray]:
    """Rotation 0 → −22.5 → 22.5 → 0 degrees, and a torque that depends on the branch."""
    t = np.linspace(0.0, 4.0, n_points)
    angle = np.interp(t, [0.0, 1.0, 3.0, 4.0], [0.0, -22.5, 22.5, 0.0])
    return angle, np.sin(np.deg2rad(4.0 * angle)) + 0.1 * np.sign(t - 1.0) * np.sign(3.0 - t)


def interpolated(x: np.ndarray, y: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Interpolate piece by piece, with the turning points where ``x`` and ``at`` have them."""
    values = np.empty(at.size)
    for (a, b), (c, d) in zip(pieces(x), pieces(at), strict=True):
        upwards = 1 if x[b - 1] > x[a] else -1
        values[c:d] = np.interp(at[c:d], x[a:b][::upwards], y[a:b][::upwards])
    return values


def pieces(x: np.ndarray) -> list[tuple[int, int]]:
    turns = np.flatnonzero(np.diff(np.sign(np.diff(x)))) + 1
    ends = [0, *turns, x.size - 1]
    return [(a, b + 1) for a, b in pairwise(ends)]


def nmse_loop(sim: np.ndarray, exp: np.ndarray) -> list[float]:
    normaliser = np.mean(np.abs(exp))
    return [float(np.mean((row - exp) ** 2) / normaliser**2) for row in sim]


def report(name: str, ours: Callable[[], object], peer: Callable[[], object]) -> None:
    """Print the least time of each, and how many times longer the peer takes."""
    times = [min(timeit.repeat(run, number=5, repeat=N_ROUNDS)) / 5 for run in (ours, peer)]
    sys.stdout.write(f"{name:<20}{times[0]:>12.2e} s{times[1]:>12.2e} s{times[1] / times[0]:>8.1f}\n")


def main() -> None:
    sys.stdout.write(f"{'name':<20}{'ours':>14}{'peer':>14}{'ratio':>8}\n")
    angle, exp = twist(N_POINTS)
    fine, torque = twist(4 * N_POINTS - 3)
    curves = torque * np.linspace(0.5, 1.5, N_SETS)[:, None]

    def scores() -> object:
        return _core.Measured(angle, exp).along(fine).score(curves)[0]

    def scores_peer() -> object:
        return nmse_loop(np.stack([interpolated(fine, curve, angle) for curve in curves]), exp)

    np.testing.assert_allclose(scores(), scores_peer(), rtol=1e-9, atol=1e-15)
    report("score", scores, scores_peer)
    report(
        "latin_hypercube",
        lambda: _core.latin_hypercube(10_000, 6, 1),
        lambda: qmc.LatinHypercube(6, rng=1).random(10_000),
    )


if __name__ == "__main__":
    main()
