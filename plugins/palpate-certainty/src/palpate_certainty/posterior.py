"""The posterior of the parameters of a scenario, drawn by an ensemble of walkers (emcee)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.api import BoolArray, FloatArray, ParameterError

AT_BOUND = 0.01
"""Share of a range that counts as its bound."""

CHUNK, MOST_STEPS = 250, 4000
"""Steps between two looks at the convergence, and in all."""

N_ENSEMBLES, N_WALKERS = 2, 128
"""Independent ensembles of walkers, which must agree, and walkers in each of them."""

N_DRAWS = 2000
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
    n_steps : int
        Steps of each walker, those at the start that are not kept too.
    n_independent : float
        Number of draws that are worth as much as independent ones.
    accepted : float
        Share of the draws that the filters accept.
    """

    points: FloatArray
    split_r: FloatArray
    autocorrelation: FloatArray
    n_steps: int
    n_independent: float
    accepted: float

    @property
    def is_converged(self) -> bool:
        """Whether the chains agree and are long enough."""
        return _is_converged(self.n_steps, self.autocorrelation, self.split_r)

    def at_bounds(self) -> FloatArray:
        """Share of the draws at the lower and at the upper bound of each range, (2, n_parameters)."""
        return np.stack([(self.points < AT_BOUND).mean(axis=0), (self.points > 1.0 - AT_BOUND).mean(axis=0)])


def draw(
    misfit: Callable[[FloatArray], FloatArray],
    accepts: Callable[[FloatArray], BoolArray],
    start: FloatArray,
    seed: int,
    *,
    to_convergence: bool = True,
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
    to_convergence : bool
        Whether several ensembles go on until they agree; else one takes a few steps.

    Raises
    ------
    ParameterError
        The filters accept no draw.
    """
    rng = np.random.default_rng(seed)
    n_ensembles, most_steps, n_draws = (
        (N_ENSEMBLES, MOST_STEPS, N_DRAWS) if to_convergence else (1, CHUNK, N_DRAWS // 4)
    )
    ensembles = [_Ensemble(misfit, _spread(start, rng), seed + i) for i in range(n_ensembles)]
    chains, n_steps = _chains(ensembles, most_steps)
    times, flat = _autocorrelation(chains), chains.reshape(-1, start.shape[1])
    kept = flat[rng.permutation(len(flat))[:n_draws]]
    if not (accepted := accepts(kept)).any():
        raise ParameterError("no draw of the posterior is accepted by the filters of the study")
    return Draws(
        points=kept[accepted],
        split_r=_split_r(chains),
        autocorrelation=times,
        n_steps=n_steps,
        n_independent=float(len(flat) / times.max()),
        accepted=float(accepted.mean()),
    )


def _chains(ensembles: "Sequence[_Ensemble]", most_steps: int) -> tuple[FloatArray, int]:
    """Chains (n_ensembles, n_steps, n_walkers, n_parameters) without their first quarter, and all steps."""
    for steps in range(CHUNK, most_steps + 1, CHUNK):
        chains = np.stack([each.run(CHUNK)[steps // 4 :] for each in ensembles])
        if _is_converged(steps, _autocorrelation(chains), _split_r(chains)):
            break
    return chains, steps


def _is_converged(n_steps: int, autocorrelation: FloatArray, split_r: FloatArray) -> bool:
    # Split-R̂ up to which chains have converged (Vehtari et al., Bayesian Analysis 16, 2021).
    # Fifty autocorrelation times: shorter chains do not tell their own.
    return bool(n_steps >= 50.0 * autocorrelation.max() and split_r.max() <= 1.01)


class _Ensemble:
    """Walkers that propose from the density of each other's places."""

    def __init__(self, misfit: Callable[[FloatArray], FloatArray], walkers: FloatArray, seed: int) -> None:
        import emcee

        def log_density(points: FloatArray) -> FloatArray:
            inside = ((points >= 0.0) & (points <= 1.0)).all(axis=1)
            found = np.full(len(points), -np.inf)
            if inside.any():
                found[inside] = -0.5 * misfit(points[inside])
            return found

        # Not emcee's snooker move, whose Metropolis factor is not that of ter Braak & Vrugt (2008).
        moves = [(emcee.moves.KDEMove(), 0.8), (emcee.moves.DEMove(), 0.2)]
        self._sampler = emcee.EnsembleSampler(*walkers.shape, log_density, moves=moves, vectorize=True)
        self._state = emcee.State(walkers, random_state=np.random.RandomState(seed).get_state())

    def run(self, n: int) -> FloatArray:
        """Go on for n steps, and return all of the chain (n_steps, n_walkers, n_parameters)."""
        self._state = self._sampler.run_mcmc(self._state, n, skip_initial_state_check=True)
        return self._sampler.get_chain()


def _spread(start: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Different points for the walkers near the points of the start, within the box."""
    chosen = start[rng.integers(len(start), size=max(N_WALKERS, 8 * start.shape[1]))]
    width = np.maximum(start.std(axis=0), 1e-4)
    return np.clip(chosen + 0.1 * width * rng.normal(size=chosen.shape), 1e-9, 1.0 - 1e-9)


def _split_r(chains: FloatArray) -> FloatArray:
    """Split-R̂ (n_parameters,) of ensembles (n_ensembles, n_steps, n_walkers, n_parameters)."""
    half = chains.shape[1] // 2
    halves = np.concatenate([chains[:, :half], chains[:, half : 2 * half]])
    split = halves.reshape(len(halves), -1, chains.shape[-1])
    within = split.var(axis=1, ddof=1).mean(axis=0)
    between = split.mean(axis=1).var(axis=0, ddof=1)
    return np.sqrt(1.0 + between / np.maximum(within, 1e-300))


def _autocorrelation(chains: FloatArray) -> FloatArray:
    """Integrated autocorrelation time (n_parameters,) in steps, of ensembles as above.

    Of all walkers together, so that one which has not moved has no effect of its own; with the window of
    Sokal (1997).
    """
    n = chains.shape[1]
    centred = chains - chains.mean(axis=(0, 1, 2))
    power = np.abs(np.fft.rfft(centred, 2 * n, axis=1)) ** 2
    covariance = np.fft.irfft(power.sum(axis=(0, 2)), axis=0)[:n]
    times = 2.0 * np.cumsum(covariance / np.maximum(covariance[0], 1e-300), axis=0) - 1.0
    # Lags that count for an autocorrelation time, in such times.
    is_long = np.arange(n)[:, None] >= 5.0 * times
    ends = np.where(is_long.any(axis=0), is_long.argmax(axis=0), n - 1)
    return np.maximum(times[ends, np.arange(times.shape[1])], 1.0)
