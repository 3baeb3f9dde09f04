"""Bands of predicted curves, from draws of the fitted values."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import polars as pl
import scipy

from palpate.api import FRICTION, Curve, FloatArray, ParameterSpace, Simulation, StudyError
from palpate.api.fit import STIFFNESS, Fitted, at_spot, path_of
from palpate_certainty.api import matern

LEVEL = 0.90
"""Probability of a band."""

Thetas = Mapping[str, FloatArray]
"""Textbook values by region."""


class SpotValues(NamedTuple):
    """Values of a spot by name, draws around them, and their source where that is not the fit of the run."""

    values: Mapping[str, float]
    draws: list[dict[str, float]]
    source: str = ""


def values_at(spot: str, found: Fitted, table: Callable[[str], pl.DataFrame]) -> SpotValues:
    """Values of a spot that was fitted, or of a new one; where spots differ, each has its own.

    Parameters
    ----------
    table : callable
        From the name of a stage's table to its rows, such as ``run.current``.
    """
    values, source = found.values, ""
    if found.source != "fit":
        return SpotValues(values, [])

    def rows_of(name: str, fit: str) -> pl.DataFrame:
        rows = table(name)
        return rows.filter(fit=fit, scenario=found.scenario) if rows.width else rows

    label, tables = found.fit, ["posterior_draws", "draws"]
    if rows_of("spot_draws", label).height:
        own = rows_of("intervals", spot)
        if spot in found.spots and own.height:
            label, source = spot, f"fit of {spot} alone"
            values = dict(own.select("parameter", "value").iter_rows())
        else:
            source, tables = "a new spot, drawn from the differences between the spots", ["spot_draws"]
    rows = next((each for name in tables if (each := rows_of(name, label)).height), None)
    if rows is None:
        return SpotValues(values, [], source)
    # Draws of a linear band; more change its ends by less than its own error.
    some = rows[np.linspace(0, rows.height - 1, min(rows.height, 400)).astype(int)]
    drawn = some.select(name for name in values if name in some.columns).to_dicts()
    return SpotValues(values, [dict(values) | row for row in drawn], source)


def linear(
    curve: Curve, best: Thetas, drawn: Sequence[Thetas], space: ParameterSpace, friction_sd: float = 0.0
) -> FloatArray:
    """Ordinates (n_draws, n) by the slopes of a curve; empty where it has none.

    Each draw has a friction of its own, with a standard deviation around the friction of the tool.
    """
    if not curve.slopes or not drawn:
        return np.empty((0, curve.ordinate.size))
    names = [name for r in space.regions for name in r.full_names.values()]
    slopes = np.array([curve.slopes[name] for name in names])
    flat = np.array([_flat(thetas, space) - _flat(best, space) for thetas in drawn])
    by_friction = curve.slopes.get(FRICTION, np.zeros(curve.ordinate.size))
    others = friction_sd * scores(len(drawn), 0)[:, None] * by_friction
    return np.asarray(curve.ordinate + flat @ slopes + others)


def with_model_error(lines: FloatArray, curve: Curve, errors: pl.DataFrame) -> FloatArray:
    """Draws (n_draws, n) of a new curve, each with a model error: a process along the path."""
    if errors.is_empty() or not len(lines) or not np.ptp(curve.abscissa):
        return lines
    path, known = path_of(curve.abscissa), errors_of(curve.channel, errors).select("length", "sd").iter_rows()
    apart = np.abs(path[:, None] - path)
    along = np.sum([sd**2 * matern(apart / length) for length, sd in known], axis=0)
    root = np.linalg.cholesky(along + 1e-9 * along[0, 0] * np.eye(path.size))
    drawn = np.stack([scores(len(lines), 2 + k) for k in range(path.size)], axis=1)
    return np.asarray(lines + drawn @ root.T * np.maximum.accumulate(np.abs(curve.ordinate)))


def errors_of(channel: str, errors: pl.DataFrame) -> pl.DataFrame:
    """Model errors of a channel; one that was not fitted has the errors of all channels."""
    own = errors.filter(channel=channel)
    return errors if own.is_empty() else own


def scores(n: int, cause: int) -> FloatArray:
    """Standard normal scores (n,) in an order of their own for each cause."""
    order = np.random.default_rng(cause).permutation(n)
    return np.asarray(scipy.special.ndtri((order + 0.5) / n))


def _flat(thetas: Thetas, space: ParameterSpace) -> FloatArray:
    return np.concatenate([thetas[region.region] for region in space.regions])


def ends(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower and upper end (n,) of the band of draws (n_draws, n)."""
    lower, upper = np.quantile(values, [0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL], axis=0)
    return lower, upper


def check_shared(values: Mapping[str, float], space: ParameterSpace, spot: str) -> None:
    """Refuse a spot that was not fitted where each spot has a value for itself, or each state a factor.

    Raises
    ------
    StudyError
    """
    known = at_spot(values, spot, space.states)
    if missing := [name for name in space.names if name not in known]:
        raise StudyError(
            f"spot '{spot}': {', '.join(missing)} was fitted for each spot by itself, and not for this one; "
            "predict a spot of the run, or fit one value for all spots"
        )
    if factors := [name for name in values if name.startswith(f"{STIFFNESS}.")]:
        raise StudyError(
            f"spot '{spot}': moduli are the first state's times {', '.join(factors)}, fitted "
            "at other spots; predict a spot of the fit"
        )


def frame_rows(rows: Iterable[Mapping[str, object]]) -> pl.DataFrame:
    """Make a table of rows."""
    return pl.DataFrame(list(rows), infer_schema_length=None)


ENDS: Mapping[str, str] = MappingProxyType(
    {
        "stretch_min": "smallest stretch",
        "stretch_max": "largest stretch",
        "i1_max": "largest I₁",
        "J_min": "smallest volume ratio",
        "J_max": "largest volume ratio",
    }
)
"""Ends of the strains that solvers report, in words; the fitted material was seen between them."""


def exceedances(
    experiment: Mapping[str, Mapping[str, Any]], predicted: Mapping[str, Simulation]
) -> pl.DataFrame:
    """Compare the strains of a prediction with the strains of the experiment at all of its spots.

    Returns
    -------
    DataFrame
        One row per spot, region and end: experiment and prediction, whether it is beyond, from which depth
        on (null where it is not), and for ``i1_max`` where in the undeformed limb. Empty where the solver
        reports no strains.
    """
    return frame_rows(_exceeded(experiment, predicted))


def _exceeded(
    experiment: Mapping[str, Mapping[str, Any]], predicted: Mapping[str, Simulation]
) -> Iterator[dict[str, Any]]:
    for spot, simulation in predicted.items():
        depths = None if simulation.surface is None else simulation.surface.depth_mm
        for region, found in simulation.diagnostics.get("strain", {}).items():
            known = [spots[region] for spots in experiment.values() if region in spots]
            for name in ENDS if known else ():
                sign = 1.0 if name.endswith("_max") else -1.0
                reached = max(sign * value for each in known for value in each[name])
                values = sign * np.array(found[name])
                # Excess that counts as none.
                beyond = values > reached + 1e-3
                first = int(np.argmax(beyond))
                place = found["where_mm"][int(np.argmax(values))]
                yield {
                    "spot": spot,
                    "region": region,
                    "strain": name,
                    "experiment": sign * reached,
                    "prediction": float(sign * values.max()),
                    "beyond": bool(beyond.any()),
                    "from_depth_mm": float(depths[first]) if depths is not None and beyond.any() else None,
                    "where_mm": ", ".join(f"{x:.1f}" for x in place) if name == "i1_max" else "",
                }
