"""Tables of posteriors, profiles, Sobol indices, volumes, and the emulator they are from."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
import polars as pl
import scipy

from palpate.api import FloatArray
from palpate_certainty.declared import DECLARED
from palpate_certainty.posterior_sampling import Posterior, Sampled
from palpate_certainty.profiles import profile_planes


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
    # Points of each of the two matrices of the estimators.
    both = scipy.stats.qmc.Sobol(2 * n_parameters, rng=seed).random(512)
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


def posterior_tables(found: Sampled, seed: int) -> dict[str, pl.DataFrame]:
    """Tables of the sampled posteriors by name."""
    rows: dict[str, Iterable[dict[str, Any]]] = {
        "posterior": (row for each in found.posteriors for row in _posterior(each)),
        "profiles": _profiles(found),
        "profile_ends": _ends(found),
        "sobol_indices": _sobol_indices(found, seed),
        "volumes": _volumes(found),
        "emulator": _emulator(found),
    }
    return {name: DECLARED["certainty"][name].frame(list(each)) for name, each in rows.items()} | {
        "posterior_draws": pl.concat([_draws(each) for each in found.posteriors], how="diagonal"),
        "posterior_planes": profile_planes([each.assessed for each in found.posteriors], found.curves),
    }


def _posterior(each: Posterior) -> Iterator[dict[str, Any]]:
    values, draws = each.values, each.draws
    ends = np.quantile(values, [0.025, 0.975], axis=0)
    solved = values.mean(axis=0) + each.shift
    at_bounds = draws.at_bounds()
    for i, parameter in enumerate(each.density.problem.parameters):
        yield each.assessed.about | {
            "parameter": parameter.name,
            "unit": parameter.unit,
            "mean": float(values[:, i].mean()),
            "sd": float(values[:, i].std()),
            "lower": float(ends[0, i]),
            "upper": float(ends[1, i]),
            "mean_solved": float(solved[i]),
            "at_lower": float(at_bounds[0, i]),
            "at_upper": float(at_bounds[1, i]),
            "split_r": float(draws.split_r[i]),
            "autocorrelation": float(draws.autocorrelation[i]),
            "n_independent": draws.n_independent,
            "converged": draws.is_converged,
        }


def _draws(each: Posterior) -> pl.DataFrame:
    # Draws of each scenario in the table.
    frame = pl.DataFrame(each.values[:1000], schema=each.density.problem.names)
    return frame.select(*(pl.lit(value).alias(name) for name, value in each.assessed.about.items()), pl.all())


def _profiles(found: Sampled) -> Iterator[dict[str, Any]]:
    main = found.posteriors[0]
    box = main.density.problem.box
    for i, (parameter, profile) in enumerate(zip(box.parameters, found.profiles, strict=True)):
        for value, rise in zip(
            box.values(profile.points)[:, i].tolist(), profile.rises.tolist(), strict=True
        ):
            about = main.assessed.about | {"parameter": parameter.name, "unit": parameter.unit}
            yield about | {"value": value, "rise": rise}


def _ends(found: Sampled) -> Iterator[dict[str, Any]]:
    main = found.posteriors[0]
    for parameter, ends in zip(main.density.problem.parameters, found.ends, strict=True):
        for name, end in zip(("lower", "upper"), ends, strict=True):
            yield main.assessed.about | {
                "parameter": parameter.name,
                "unit": parameter.unit,
                "end": name,
                "value": end.value,
                "value_solved": end.solved if np.isfinite(end.solved) else None,
                "at_bound": end.is_open,
            }


def _sobol_indices(found: Sampled, seed: int) -> Iterator[dict[str, Any]]:
    simulated = found.curves.simulated
    problem = simulated.problem
    first, total = sobol_indices(
        lambda points: found.curves(problem.box.values(points)), len(problem.parameters), seed
    )
    for term in problem.terms:
        for channel in term.weights:
            at = simulated.places[term.spot, channel]
            for i, parameter in enumerate(problem.parameters):
                for point, abscissa in enumerate(term.measured[channel].abscissa.tolist()):
                    yield {
                        "spot": term.spot,
                        "channel": channel,
                        "point": point,
                        "abscissa": abscissa,
                        "parameter": parameter.name,
                        "first": float(first[i, at.start + point]),
                        "total": float(total[i, at.start + point]),
                    }


def _volumes(found: Sampled) -> Iterator[dict[str, Any]]:
    main = found.posteriors[0].volume
    for each in found.posteriors:
        yield each.assessed.about | {
            "volume": each.volume,
            "ratio": each.volume / main if main > 0.0 else None,
        }


def _emulator(found: Sampled) -> Iterator[dict[str, Any]]:
    simulated = found.curves.simulated
    left_out = np.abs(found.curves.left_out) / simulated.peak
    for each in found.posteriors:
        missed = each.missed
        for channel in dict.fromkeys(channel for _, channel in simulated.places):
            places = [at for (_, of), at in simulated.places.items() if of == channel]
            yield each.assessed.about | {
                "channel": channel,
                "n_runs": len(found.curves.runs.values),
                "n_solved": len(missed),
                "error": max(float(missed[:, at].max(initial=0.0)) for at in places),
                "left_out": max(float(left_out[:, at].max()) for at in places),
            }
