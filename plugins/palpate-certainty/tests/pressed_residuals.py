"""Residuals of a fit to a press and a twist, and their errors."""

import numpy as np
from scipy.linalg import null_space

from palpate.api.fit import Adequacy
from palpate_certainty.adequacy import Closeness, checks, misfits
from palpate_certainty.linear_problem import LinearProblem, ResidualErrors
from palpate_certainty.noise_model import ErrorScale, ResidualLayout, estimate

EXPECTED = {0: 0.005, 1: 0.005}
"""Discrepancy by channel."""


def press(n_spots=1, n=25):
    """Layout of a force and a twist at some spots, and slopes of three parameters."""
    x, turn = np.linspace(0.04, 1.0, n), np.concatenate([np.linspace(0, 1, n), np.linspace(1, -1, n)[1:]])
    shape = [x**2, np.sin(turn)]
    size = np.concatenate([x**2, np.maximum.accumulate(np.abs(shape[1]))])
    rows = ResidualLayout(
        spot=np.repeat(np.arange(n_spots), size.size),
        site=np.repeat(np.arange(n_spots), size.size),
        channel=np.tile(np.repeat([0, 1], [x.size, turn.size]), n_spots),
        point=np.tile(np.concatenate([np.arange(x.size), np.arange(turn.size)]).astype(float), n_spots),
        path=np.tile(np.concatenate([x, np.cumsum(np.abs(np.diff(turn, prepend=0.0))) / 2.0]), n_spots),
        scale=np.ones(n_spots * size.size),
        envelope=np.tile(size, n_spots),
    )
    first = np.concatenate([x**2, np.sin(turn)])
    second = np.concatenate([x**3, 0.3 * turn**3])
    third = np.concatenate([x**4, 0.0 * turn])
    return rows, np.tile(np.stack([first, second, third], axis=1), (n_spots, 1))


def drawn(rng, covariance):
    return np.linalg.cholesky(covariance + 1e-14 * np.eye(len(covariance))) @ rng.normal(size=len(covariance))


def errors_of(rows, noise, discrepancy):
    return sum(
        noise**2 * rows.noise(c, 0.0) + discrepancy**2 * rows.discrepancy(c, 0.35) for c in rows.channels
    )


def fitted(errors, jacobian):
    return errors - jacobian @ np.linalg.lstsq(jacobian, errors, rcond=None)[0]


def problem(residuals, rows, jacobian, found, known=None):
    """Residuals that were not averaged, and their errors."""
    known = np.zeros((len(residuals), 1)) if known is None else known
    linear = LinearProblem(
        point=np.zeros(jacobian.shape[1]),
        residuals=residuals,
        jacobian=jacobian,
        rows=rows,
        known={"other": 1e-3 * np.eye(len(residuals))[:, :1], "known": known},
        channels=(),
        expected=EXPECTED,
        groups=np.eye(len(residuals)),
    )
    return linear, ResidualErrors(noise=found, scale=ErrorScale(factor=1.0, freedom=np.inf))


def missed(residuals, rows, jacobian, found, known=None):
    """Largest differences of residuals."""
    linear, errors = problem(residuals, rows, jacobian, found, known)
    return misfits(linear, linear, errors)


def check(errors, rows, jacobian):
    residuals = fitted(errors, jacobian)
    known = np.zeros((len(residuals), 1))
    found = estimate(residuals, null_space(jacobian.T), known, rows, expected=EXPECTED)
    return {
        each.name
        for each in checks(
            missed(residuals, rows, jacobian, found),
            EXPECTED,
            dict.fromkeys(EXPECTED, Closeness(difference=0.1, r2=0.99)),
            (0.5, EXPECTED),
            None,
            1.0,
        )
        if each.verdict is not Adequacy.DESCRIBES
    }
