"""Times of the scoring kernels, each with a peer of the same run: ``make bench-core``.

A batch has curves of 100 simulated points on a force ramp of 1,000 measured ones. The peers do
what a script would: ``np.interp`` (or a compiled numba loop where numba is installed) for each
curve, then the mean squared error. All runs on one thread and is measured in its processor time;
each line is the least of several rounds, per curve.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from palpate import _core

N_SIMULATED, N_MEASURED, N_SETS, N_ROUNDS = 100, 1_000, 2_000, 9


@dataclass(frozen=True)
class Ramp:
    """A measured force ramp and simulated ones: (n,), (N,), (n_sets, n)."""

    sim_x: np.ndarray
    sim: np.ndarray
    exp_x: np.ndarray
    exp: np.ndarray

    @classmethod
    def made(cls, n_sets: int = N_SETS) -> "Ramp":
        rng = np.random.default_rng(1)
        sim_x, exp_x = np.linspace(0.0, 15.0, N_SIMULATED), np.linspace(0.0, 15.0, N_MEASURED)
        factors = rng.uniform(0.5, 1.5, (n_sets, 1))
        sim = factors * 8.0 * (sim_x / 15.0) ** 2 + rng.normal(0.0, 0.02, (n_sets, N_SIMULATED))
        return cls(sim_x, sim, exp_x, 8.0 * (exp_x / 15.0) ** 2)

    def by_numpy(self, n_sets: int) -> np.ndarray:
        """Score ``n_sets`` curves by np.interp."""
        return np.array([self._error(np.interp(self.exp_x, self.sim_x, y)) for y in self.sim[:n_sets]])

    def _error(self, values: np.ndarray) -> float:
        return float(np.mean((values - self.exp) ** 2) / np.mean(np.abs(self.exp)) ** 2)


def numba_peer(ramp: Ramp) -> Callable[[int], np.ndarray] | None:
    """Compile one loop that walks both curves at once and interpolates as it goes."""
    if find_spec("numba") is None:
        return None
    import numba

    def scores(sim_x, sim, exp_x, exp):
        out = np.empty(len(sim))
        normaliser = np.mean(np.abs(exp)) ** 2
        for i in range(len(sim)):
            k, total = 0, 0.0
            for j in range(len(exp_x)):
                while k < len(sim_x) - 2 and sim_x[k + 1] <= exp_x[j]:
                    k += 1
                share = (exp_x[j] - sim_x[k]) / (sim_x[k + 1] - sim_x[k])
                total += (sim[i, k] + share * (sim[i, k + 1] - sim[i, k]) - exp[j]) ** 2
            out[i] = total / len(exp_x) / normaliser
        return out

    compiled = numba.njit(scores)
    return lambda n_sets: compiled(ramp.sim_x, ramp.sim[:n_sets], ramp.exp_x, ramp.exp)


def seconds(run: Callable[[], object]) -> float:
    """Return the least processor time of several runs."""
    times = []
    for _ in range(N_ROUNDS):
        begin = time.process_time()
        run()
        times.append(time.process_time() - begin)
    return min(times)


@dataclass(frozen=True)
class Peer:
    """A peer with its time per curve and the scores that ours must have."""

    name: str
    per_curve: float
    scores: np.ndarray

    @classmethod
    def timed(cls, name: str, run: Callable[[int], np.ndarray], n_sets: int) -> "Peer":
        run(1)
        return cls(name, seconds(lambda: run(n_sets)) / n_sets, run(n_sets))

    def compare(self, name: str, ours: Callable[[], np.ndarray]) -> None:
        """Print our time per curve next to this peer's, after a look that the scores agree."""
        np.testing.assert_allclose(ours()[: self.scores.size], self.scores, rtol=1e-12)
        own = seconds(ours) / N_SETS
        label = f"{name} / {self.name}"
        sys.stdout.write(
            f"{label:<34}{own * 1e6:>10.3f} µs{self.per_curve * 1e6:>10.2f} µs{self.per_curve / own:>8.1f}\n"
        )


def main() -> None:
    ramp = Ramp.made()
    shared = _core.Measured(ramp.exp_x, ramp.exp).along(ramp.sim_x)

    sys.stdout.write(f"{'name':<34}{'ours':>13}{'peer':>13}{'ratio':>8}\n")
    interp = Peer.timed("np.interp", ramp.by_numpy, 500)
    interp.compare("score", lambda: shared.score(ramp.sim)[0])
    if (loop := numba_peer(ramp)) is None:
        sys.stdout.write("numba is not installed: no such peer\n")
    else:
        Peer.timed("numba", loop, N_SETS).compare("score", lambda: shared.score(ramp.sim)[0])


if __name__ == "__main__":
    main()
