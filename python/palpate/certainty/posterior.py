"""The posterior of the parameters of a scenario, drawn by an ensemble of walkers (emcee)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.domain import BoolArray, FloatArray
from palpate.errors import ParameterError

AT_BOUND = 0.01
"""Share of a range that counts as its bound."""

CONVERGED_R = 1.01
"""Split-R̂ up to which chains have converged (Vehtari et al., Bayesian Analysis 16, 2021)."""

TIMES = 50.0
"""Length of the chains, in autocorrelation times, from which those are known."""

CHUNK, MOST_STEPS = 1000, 8000
"""Steps between two looks at the convergence, and in all."""

N_DRAWS = 8000
"""Draws that are kept."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Draws:
    """Draws of a posterior.

    Parameters
    ----------
    points : (n, n_parameters) array
        Points of the box that the filters accept.
    split_r : (n_parameters,) array
        Split-R̂ of each coordinate.
    autocorrelation : (n_parameters,) array
        Steps after which a walker has forgotten where it was.
    n_independent : float
        Number of draws that are worth as much as independent ones.
    accepted : float
        Share of the draws that the filters accept.
    """

    points: FloatArray
    split_r: FloatArray
    autocorrelation: FloatArray
    n_independent: float
    accepted: float

    @property
    def is_converged(self) -> bool:
        """Whether the chains agree and are long enough."""
        return bool(self.split_r.max() <= CONVERGED_R and self.n_independent >= TIMES)

    def at_bounds(self) -> FloatArray:
        """Share of the draws at the lower and at the upper bound of each range, (2, n_parameters)."""
        return np.stack([(self.points < AT_BOUND).mean(axis=0), (self.points > 1.0 - AT_BOUND).mean(axis=0)])


def draw(
    misfit: Callable[[FloatArray], FloatArray],
    accepts: Callable[[FloatArray], BoolArray],
    start: FloatArray,
    seed: int,
) -> Draws:
    """Draw from exp(−misfit/2) within the unit box where the filters accept.

    Parameters
    ----------
    misfit : callable
        −2 log of the density at points (n, n_parameters).
    accepts : callable
        Asked for the draws that are kept alone: it is slower.
    start : (n, n_parameters) array
        Points from which walkers start.
    seed : int

    Raises
    ------
    ParameterError
        The filters accept no draw.
    """
    import emcee

    n = start.shape[1]
    rng = np.random.default_rng(seed)
    walkers = _spread(start, max(64, 4 * n), rng)

    def log_density(points: FloatArray) -> FloatArray:
        inside = ((points >= 0.0) & (points <= 1.0)).all(axis=1)
        found = np.full(len(points), -np.inf)
        if inside.any():
            found[inside] = -0.5 * misfit(points[inside])
        return found

    # Not emcee's snooker move, whose Metropolis factor is not that of ter Braak & Vrugt (2008).
    sampler = emcee.EnsembleSampler(
        len(walkers),
        n,
        log_density,
        moves=[(emcee.moves.DEMove(), 0.8), (emcee.moves.StretchMove(), 0.2)],
        vectorize=True,
    )
    state = emcee.State(walkers, random_state=np.random.RandomState(seed).get_state())
    steps = 0
    while steps < MOST_STEPS:
        state = sampler.run_mcmc(state, CHUNK, skip_initial_state_check=True)
        steps += CHUNK
        times = sampler.get_autocorr_time(tol=0)
        chains = sampler.get_chain()[steps // 4 :]
        split_r = _split_r(chains)
        if np.isfinite(times).all() and steps >= TIMES * times.max() and split_r.max() <= CONVERGED_R:
            break
    flat = chains.reshape(-1, n)
    kept = flat[rng.permutation(len(flat))[:N_DRAWS]]
    accepted = accepts(kept)
    if not accepted.any():
        raise ParameterError("no draw of the posterior is accepted by the filters of the study")
    return Draws(
        points=kept[accepted],
        split_r=split_r,
        autocorrelation=times,
        n_independent=float(len(flat) / np.nanmax(times)),
        accepted=float(accepted.mean()),
    )


def _spread(start: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
    """Choose n different points near those of the start, within the box."""
    chosen = start[rng.integers(len(start), size=n)]
    width = np.maximum(start.std(axis=0), 1e-4)
    spread: FloatArray = np.clip(chosen + 0.1 * width * rng.normal(size=chosen.shape), 1e-9, 1.0 - 1e-9)
    return spread


def _split_r(chains: FloatArray) -> FloatArray:
    """Split-R̂ (n_parameters,) of chains (n_steps, n_chains, n_parameters)."""
    half = len(chains) // 2
    split = np.concatenate([chains[:half], chains[half : 2 * half]], axis=1)
    within = split.var(axis=0, ddof=1).mean(axis=0)
    between = split.mean(axis=0).var(axis=0, ddof=1)
    ratio: FloatArray = np.sqrt((half - 1) / half + between / np.maximum(within, 1e-300))
    return ratio
