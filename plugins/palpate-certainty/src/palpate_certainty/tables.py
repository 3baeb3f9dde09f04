"""A fit with its covariance, the directions in which it is known, and the tables of both."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import polars as pl
import scipy

from palpate.api import FloatArray
from palpate.api.fit import (
    INCLUDED,
    LEVEL,
    THRESHOLDS,
    UNCLEAR,
    Adequacy,
    Case,
    Fit,
    Problem,
    SpotTerm,
    pieces,
    word_of,
    worst_of,
)
from palpate.api.runs import Study
from palpate_certainty.adequacy import Check, Misfit
from palpate_certainty.curve_coordinates import CurveCoordinates
from palpate_certainty.declared import DECLARED
from palpate_certainty.error_sources import MESH
from palpate_certainty.laplace import Density, Laplace, wider
from palpate_certainty.linear_problem import LinearProblem, ResidualErrors


def parameter_combinations(
    names: Sequence[str], values: FloatArray, rates: FloatArray, covariance: FloatArray
) -> Iterator[tuple[str, float]]:
    """Combinations that are known independently of each other, such as ``c1 · m1^0.3``, the best known first.

    They are principal directions of a covariance in coordinates of the unit box, in which ``rates``
    (n_parameters,) are the derivatives of the values. Each has the relative width of its 95 % interval.
    """
    # Relative changes; a value of zero has none, and is seen over its range.
    per_coordinate = rates / np.where(values == 0.0, rates, values)
    relative = covariance * np.outer(per_coordinate, per_coordinate)
    for vector in np.linalg.eigh(covariance)[1].T:
        powers = vector / per_coordinate
        powers = powers / powers[np.argmax(np.abs(powers))]
        # Power of a parameter, over the largest one, below which it is left out.
        powers = np.where(np.abs(powers) < 0.15, 0.0, np.round(powers, 1))
        sd = float(np.sqrt(powers @ relative @ powers))
        width = 2.0 * float(scipy.stats.norm.ppf(0.5 + LEVEL / 2.0)) * sd
        yield _product(names, powers), width


def _product(names: Sequence[str], powers: FloatArray) -> str:
    factors = [
        name if power == 1.0 else f"{name}^{power:g}"
        for name, power in zip(names, powers.tolist(), strict=True)
        if power
    ]
    return " · ".join(factors)


N_DRAWS = 200
"""Draws from the density of a fit that are kept."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Assessed:
    """A fit with its covariance.

    Parameters
    ----------
    case : Case
    end : Fit
    linear : LinearProblem
    errors : ResidualErrors
    point : (n_parameters,) array
        The most likely values, as shares of the ranges.
    laplace : Laplace
        By all causes.
    along : CurveCoordinates
        Coordinates in which the curves are taken as linear.
    density : Density
        By all causes, within the ranges and the filters.
    misfits : mapping of channel number to Misfit
    shape : (float, mapping)
        As :func:`~palpate_certainty.adequacy.shape_of` returns it.
    checks : tuple of Check
    mesh_errors : tuple of mapping
        Rows of :func:`~palpate_certainty.error_sources.mesh_errors`.
    has_usual_mesh_error : bool
        A mesh's error is neither shown by a finer mesh nor stated by the study.
    left_out : mapping of cause to str
        Why a cause that may be wrong here is in no interval.
    """

    case: Case
    end: Fit
    linear: LinearProblem
    errors: ResidualErrors
    point: FloatArray
    laplace: Laplace
    along: CurveCoordinates
    density: Density
    misfits: Mapping[int, Misfit]
    shape: tuple[float, Mapping[int, float]]
    checks: tuple[Check, ...]
    mesh_errors: tuple[dict[str, Any], ...] = ()
    has_usual_mesh_error: bool = False
    left_out: Mapping[str, str] = field(default_factory=dict)

    @property
    def about(self) -> dict[str, Any]:
        """First cells of its rows in every table."""
        return {"fit": self.case.label, "scenario": self.case.scenario.name}

    @property
    def values(self) -> FloatArray:
        """The most likely values (n_parameters,) in the units of the parameters."""
        box = self.end.problem.box
        return box.linear(self.point)

    @property
    def white(self) -> FloatArray:
        """Matrix (m, n) from the residuals to independent ones of variance 1, by all causes."""
        return self.linear.white(self.errors)

    @property
    def verdict(self) -> Adequacy:
        """Verdict on the model: the worst of its checks."""
        return worst_of(check.verdict for check in self.checks)


def coordinates_of(linear: LinearProblem, errors: ResidualErrors) -> CurveCoordinates:
    """Coordinates in which curves are linear: the values, and logarithms of moduli where spots differ."""
    if errors.between is None:
        return CurveCoordinates(box=linear.box, powers=np.ones(linear.point.size), origin=linear.point)
    powers = np.where(linear.box.log, 0.0, 1.0)
    return CurveCoordinates(box=linear.box, powers=powers, origin=errors.between.point)


def density_of(found: Laplace, problem: Problem, along: CurveCoordinates) -> Density:
    """Density within the ranges and the filters of a problem, where curves are linear in coordinates.

    Raises
    ------
    PalpateError
        Filters refuse all of it.
    """
    box = problem.box

    def weights(points: FloatArray) -> FloatArray:
        # Before any curve each is spread evenly along its coordinate, as a search steps in it.
        shares = along.shares(points)
        at = box.point(box.linear(shares))
        per_step = along.rates(shares) * (box.upper - box.lower) / box.rates(at)
        return problem.accepts(at) * np.prod(per_step, axis=1)

    density = along.density(found).within(weights)
    points = along.shares(density.points)
    return replace(density, centre=found.centre, covariance=found.covariance, points=points)


def most_likely(
    found: Laplace,
    linear: LinearProblem,
    errors: ResidualErrors,
    along: CurveCoordinates,
    problem: Problem,
) -> tuple[Density, FloatArray]:
    """Density within ranges and filters, and its most likely point that they accept, as shares."""
    density = density_of(found, problem, along)
    if linear.is_like_fopt and errors.between is None:
        return density, linear.point  # the least of Fopt is what was searched
    point = along.shares(along.density(found).most_likely)
    is_accepted = problem.accepts(problem.box.point(problem.box.linear(point))[None])[0]
    return density, point if is_accepted else density.nearest


def certainty_tables(assessed: Sequence[Assessed], study: Study) -> dict[str, pl.DataFrame]:
    """Tables of the assessed fits by name; the curves at the reported values are not among them."""
    rows: dict[str, Callable[[Assessed], Iterable[dict[str, Any]]]] = {
        "intervals": _intervals,
        "budget": _budget,
        "parameter_combinations": _parameter_combinations,
        "adequacy": lambda each: _adequacy(each, study),
        "mesh_errors": lambda each: (each.about | row for row in each.mesh_errors),
        "model_errors": _model_errors,
        "draws": _draws,
        "between_spots": _between_spots,
        "spot_draws": _spot_draws,
    }
    return {
        name: DECLARED["intervals"][name].frame([row for each in assessed for row in rows_of(each)])
        for name, rows_of in rows.items()
    }


def _intervals(each: Assessed) -> Iterator[dict[str, Any]]:
    box = each.end.problem.box
    failed = bool(each.left_out) or each.verdict is Adequacy.FAILS
    ends = [box.linear(end) for end in each.density.interval(each.point)]
    for i, parameter in enumerate(box.parameters):
        value, (lower, upper) = float(each.values[i]), (float(end[i]) for end in ends)
        over_value = (upper - lower) / abs(value) if value else np.inf
        over_range = (upper - lower) / (parameter.upper - parameter.lower)
        width = max(over_value if parameter.lower * parameter.upper > 0.0 else 0.0, over_range)
        yield each.about | {
            "parameter": parameter.name,
            "unit": parameter.unit,
            "value": value,
            "lower": lower,
            "upper": upper,
            "relative_width": width,
            "identifiability": UNCLEAR if failed or _is_mostly_mesh(each, i) else word_of(width),
        }


def _is_mostly_mesh(each: Assessed, parameter: int) -> bool:
    """True if the usual error of a mesh is the largest cause of a parameter's interval."""
    shares = {cause: float(share[parameter]) for cause, share in each.laplace.in_range.shares.items()}
    return each.has_usual_mesh_error and max(shares, key=shares.__getitem__) == MESH


def _budget(each: Assessed) -> Iterator[dict[str, Any]]:
    box, found = each.end.problem.box, each.laplace.in_range
    for i, name in enumerate(box.names):
        sd = float(found.sd[i] * (box.upper - box.lower)[i])
        shares = {cause: float(share[i]) for cause, share in found.shares.items()}
        for cause, share in sorted(shares.items(), key=lambda item: -item[1]):
            sd_of_cause = sd * float(np.sqrt(share))
            row = each.about | {"parameter": name, "cause": cause}
            yield row | {"share": share, "sd": sd_of_cause, "status": INCLUDED}
        for cause, why in each.left_out.items():
            yield each.about | {"parameter": name, "cause": cause, "share": None, "sd": None, "status": why}


def _parameter_combinations(each: Assessed) -> Iterator[dict[str, Any]]:
    box, within = each.end.problem.box, each.laplace.in_range
    covariance = wider(within.freedom) ** 2 * within.covariance
    for text, width in parameter_combinations(box.names, each.values, box.upper - box.lower, covariance):
        about = {"combination": text, "relative_width": width, "identifiability": word_of(width)}
        yield each.about | about


def _model_errors(each: Assessed) -> Iterator[dict[str, Any]]:
    noise = each.errors.noise
    for number, size in noise.discrepancy.items():
        row = each.about | {"channel": each.linear.channels[number]}
        for length, share in noise.lengths(number).items():
            yield row | {"length": length, "sd": size * float(np.sqrt(share))}


def _draws(each: Assessed) -> Iterator[dict[str, Any]]:
    box = each.end.problem.box
    for shares in each.density.draws(N_DRAWS):
        values = box.linear(shares)
        yield each.about | dict(zip(box.names, values.tolist(), strict=True))


def _between_spots(each: Assessed) -> Iterator[dict[str, Any]]:
    box, found = each.end.problem.box, each.errors.between
    if found is None:
        return
    rates = box.rates(box.point(each.values))
    for k, i in enumerate(found.shared.tolist()):
        sd, lower, upper = (float(size * rates[i]) for size in (found.sd[k], *found.ends[k]))
        yield each.about | {
            "parameter": box.parameters[i].name,
            "unit": box.parameters[i].unit,
            "value": float(each.values[i]),
            "sd": sd,
            "lower": lower,
            "upper": upper,
            "n_spots": int(found.seen[:, k].sum()),
        }


def _spot_draws(each: Assessed) -> Iterator[dict[str, Any]]:
    """Draws from the density of a new spot's parameters, within the ranges."""
    box, found = each.end.problem.box, each.errors.between
    if found is None:
        return
    rng, drawn = np.random.default_rng(0), each.density.draws(N_DRAWS)
    there = box.point(box.linear(drawn))
    there[:, found.shared] += found.sd * rng.standard_t(found.freedom, (len(there), found.sd.size))
    for values in box.values(there.clip(0.0, 1.0)):
        yield each.about | dict(zip(box.names, values.tolist(), strict=True))


def _adequacy(each: Assessed, study: Study) -> Iterator[dict[str, Any]]:
    for check in each.checks:
        channel = each.linear.channels[check.channel] if check.channel >= 0 else None
        said = {
            "discrepancy": "" if channel is None else _missed(each, check.channel, study),
            "shape": (
                "errors of the budget give residuals of this shape along the path in less than "
                f"{100.0 * THRESHOLDS.unusual:g} of 100 cases"
            ),
            "ranges": "the curves ask for parameters outside of their ranges",
            "relaxation": check.message,
        }
        yield each.about | {
            "check": check.name,
            "channel": channel,
            "probability": check.probability,
            "verdict": check.verdict.value,
            "difference": None if check.closeness is None else check.closeness.difference,
            "r2": None if check.closeness is None else check.closeness.r2,
            "explained_by": None if check.closeness is None else each.misfits[check.channel].cause,
            "visible": check.visible,
            "message": "" if check.verdict is Adequacy.DESCRIBES else said.get(check.name, ""),
        }


def _missed(each: Assessed, number: int, study: Study) -> str:
    """Sentence on the largest difference of a channel: how large and where it is, and what explains it."""
    name, misfit, terms = each.linear.channels[number], each.misfits[number], each.end.problem.terms
    spot, point = _place(terms, misfit.row)
    curve, channel = spot.measured[name], study.channels.get(name)
    x, y = ("", "") if channel is None else (channel.abscissa_label, channel.ordinate_label)
    size = _quantity(y, misfit.share * float(np.abs(curve.ordinate).max()))
    at_spot = f" of {spot.spot}" if len(terms) > 1 else ""
    at = _quantity(x, float(curve.abscissa[point]), is_named=True)
    allowed = THRESHOLDS.allowed * study.budget.discrepancy_of(name)
    return (
        f"the {name} differs from the model by up to {100.0 * misfit.share:.2g} % of its peak "
        f"({size}{at_spot} at {at}); noise and error budget leave {100.0 * misfit.unexplained:.2g} % "
        f"unexplained, more than the {100.0 * allowed:.2g} % that the budget allows"
    )


def _place(terms: Sequence[SpotTerm], row: int) -> tuple[SpotTerm, int]:
    """Spot of a residual, and the number of its point on the measured curve."""
    term, name, at = next(
        (term, name, at) for term, name, at, _ in pieces(terms) if at.start <= row < at.stop
    )
    return term, int(np.flatnonzero(term.counted(name))[row - at.start])


def _quantity(label: str, value: float, *, is_named: bool = False) -> str:
    """Value with the unit, and before it the name, of an axis such as ``indentation depth (mm)``."""
    name, _, unit = label.removesuffix(")").partition(" (")
    before, after = f"{name} " if name and is_named else "", f" {unit}" if unit else ""
    return f"{before}{value:.3g}{after}"
