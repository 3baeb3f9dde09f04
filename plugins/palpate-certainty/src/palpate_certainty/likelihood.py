"""How likely the residuals of a scenario are, by its covariance.

Residuals of covariance C are split into the scores, their part along the slopes at the fit, and the rest.
Each has its block of C; what the two have in common would move the most likely parameters away from the least
Fopt, and is left out. So the density is largest at the fit, and near it that of
:mod:`~palpate_certainty.laplace`.
"""

import numpy as np
from scipy.linalg import solve_triangular

from palpate.api import FloatArray


def whitening(jacobian: FloatArray, covariance: FloatArray, groups: FloatArray) -> FloatArray:
    """Matrix (m, n) from the n residuals of a problem to independent ones of variance 1.

    Parameters
    ----------
    jacobian : (m, n_parameters) array
    covariance : (m, m) array
        Of the averages ``groups`` (m, n) of the residuals, as the slopes are.
    """
    axes, sizes, _ = np.linalg.svd(jacobian, full_matrices=True)
    n_seen = int((sizes > 1e-9 * sizes.max()).sum())
    white = [
        solve_triangular(_root(part.T @ covariance @ part), part.T, lower=True)
        for part in (axes[:, :n_seen], axes[:, n_seen:])
    ]
    found: FloatArray = np.concatenate(white) @ groups
    return found


def _root(covariance: FloatArray) -> FloatArray:
    jitter = 1e-12 * np.trace(covariance) / len(covariance)
    root: FloatArray = np.linalg.cholesky(covariance + jitter * np.eye(len(covariance)))
    return root
