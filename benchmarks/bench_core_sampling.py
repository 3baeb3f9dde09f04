"""Times of the designs on one thread, each with a peer in the same run: ``make bench-core``.

SciPy draws the plain and the discrepancy-optimised Latin hypercube, SMT the maximin one
(``pip install smt``; left out where it is missing). A row of an optimised design is followed by
what both reached. Each time is the least of several rounds of processor time.
"""

import sys
import time
from collections.abc import Callable

import numpy as np
from scipy.spatial.distance import pdist
from scipy.stats import qmc

from palpate import _core

N_SETS, N_PARAMETERS = 250, 3


def least(run: Callable[[], np.ndarray], n_rounds: int) -> tuple[float, np.ndarray]:
    """Least processor time of a call in s, and its result."""
    times = []
    for _ in range(n_rounds):
        start = time.process_time()
        points = run()
        times.append(time.process_time() - start)
    return min(times), points


def report(
    name: str,
    ours: Callable[[], np.ndarray],
    peer: Callable[[], np.ndarray],
    reached: Callable[[np.ndarray], float] | None = None,
) -> None:
    (our_time, our_points), (peer_time, peer_points) = least(ours, 15), least(peer, 5)
    sys.stdout.write(f"{name:<28}{our_time:>12.2e} s{peer_time:>12.2e} s{peer_time / our_time:>8.1f}\n")
    if reached is not None:
        sys.stdout.write(f"{'  reached':<28}{reached(our_points):>12.2e}  {reached(peer_points):>12.2e}\n")


def optimised(criterion: str, n_swaps: int | None) -> np.ndarray:
    drawn = _core.latin_hypercube(N_SETS, N_PARAMETERS, 1, centred=True)
    return _core.optimise_design(drawn, criterion, 1, n_swaps=n_swaps)


def discrepancy(points: np.ndarray) -> float:
    return float(qmc.discrepancy(points, method="CD"))


def distance(points: np.ndarray) -> float:
    return float(pdist(points).min())


def by_scipy() -> np.ndarray:
    return qmc.LatinHypercube(N_PARAMETERS, rng=1, optimization="random-cd").random(N_SETS)


def sobol() -> np.ndarray:
    net = qmc.Sobol(10, scramble=False, bits=32).random_base2(16)
    return _core.owen_scramble(net, 1)


def main() -> None:
    sys.stdout.write(f"{'name':<28}{'ours':>14}{'peer':>14}{'ratio':>8}\n")
    report(
        "lhs 1e5 x 10",
        lambda: _core.latin_hypercube(100_000, 10, 1),
        lambda: qmc.LatinHypercube(10, rng=1).random(100_000),
    )
    report("sobol 2^16 x 10", sobol, lambda: qmc.Sobol(10, rng=1).random_base2(16))
    for n_swaps, label in ((3_000, "3000 swaps"), (None, "default")):
        report(f"cd 250 x 3, {label}", lambda n=n_swaps: optimised("cd", n), by_scipy, discrepancy)
    try:
        from smt.sampling_methods import LHS
    except ImportError:
        sys.stdout.write("smt is missing: pip install smt to time its maximin designs\n")
        return
    limits = np.array([[0.0, 1.0]] * N_PARAMETERS)

    def by_smt() -> np.ndarray:
        return LHS(xlimits=limits, criterion="ese", seed=1)(N_SETS)

    for n_swaps, label in ((3_000, "3000 swaps"), (None, "default")):
        report(f"maximin 250 x 3, {label}", lambda n=n_swaps: optimised("maximin", n), by_smt, distance)


if __name__ == "__main__":
    main()
