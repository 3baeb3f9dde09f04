"""Which parameter rules the curves at each point of their paths: Sobol indices over the ranges."""

from collections.abc import Callable

import numpy as np
from scipy.stats import qmc

from palpate.api import FloatArray

N_BASE = 512
"""Points of each of the two matrices of the estimators."""


def sobol_indices(
    curves: Callable[[FloatArray], FloatArray], n_parameters: int, seed: int
) -> tuple[FloatArray, FloatArray]:
    """First-order and total indices of each parameter, (n_parameters, n_points) each.

    Estimators of Saltelli et al. (Computer Physics Communications 181, 2010) and Jansen (ibid. 117, 1999).
    Where a curve does not vary, they are zero.

    Parameters
    ----------
    curves : callable
        Ordinates (n, n_points) at points (n, n_parameters) of the box.
    n_parameters : int
    seed : int
    """
    both = qmc.Sobol(2 * n_parameters, rng=seed).random(N_BASE)
    one, other = both[:, :n_parameters], both[:, n_parameters:]
    at_one, at_other = curves(one), curves(other)
    variance = np.concatenate([at_one, at_other]).var(axis=0)
    varies = variance > 1e-12 * variance.max()
    divisor = np.where(varies, variance, np.inf)
    centre = at_one.mean(axis=0)
    first, total = [], []
    for i in range(n_parameters):
        mixed = one.copy()
        mixed[:, i] = other[:, i]
        at_mixed = curves(mixed)
        first.append(((at_other - centre) * (at_mixed - at_one)).mean(axis=0) / divisor)
        total.append(((at_one - at_mixed) ** 2).mean(axis=0) / 2.0 / divisor)
    return np.stack(first), np.stack(total)
