"""How likely the residuals of a scenario are, by its covariance.

Residuals of covariance C are split into the scores, their part along the slopes at the fit, and the rest.
Each has its block of C; what the two have in common would move the most likely parameters away from the least
Fopt, and is left out. So the density is largest at the fit, and near it that of
:mod:`~palpate.certainty.laplace`.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from palpate.domain import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Likelihood:
    """Normal density of the residuals of a scenario.

    Parameters
    ----------
    white : (m, n) array
        From the n residuals of a problem to independent ones of variance 1.
    """

    white: FloatArray

    def misfit(self, residuals: FloatArray) -> FloatArray:
        """−2 log of the density (k,), up to a constant, at residuals (k, n)."""
        found: FloatArray = ((residuals @ self.white.T) ** 2).sum(axis=1)
        return found


def likelihood(jacobian: FloatArray, covariance: FloatArray, groups: FloatArray) -> Likelihood:
    """Density from the slopes (m, n_parameters) and the covariance (m, m) of averages ``groups`` (m, n)."""
    axes, sizes, _ = np.linalg.svd(jacobian, full_matrices=True)
    n_seen = int((sizes > 1e-9 * sizes.max()).sum())
    white = [
        solve_triangular(_root(part.T @ covariance @ part), part.T, lower=True)
        for part in (axes[:, :n_seen], axes[:, n_seen:])
    ]
    return Likelihood(white=np.concatenate(white) @ groups)


def _root(covariance: FloatArray) -> FloatArray:
    jitter = 1e-12 * np.trace(covariance) / len(covariance)
    root: FloatArray = np.linalg.cholesky(covariance + jitter * np.eye(len(covariance)))
    return root
