"""Checks of measured stresses of homogeneous tests, by the mode and the study's ranges.

An isotropic material that keeps its volume has one stress in each mode, which follows from its energy. What
the ranges of a study can give bounds what may have been measured.
"""

from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np

from palpate.domain import Channel, Curve, FloatArray, IntArray, ParameterSpace
from palpate.domain.material import IsotropicMaterial
from palpate.errors import CurveError
from palpate.experiment.curve_checks import BIAS, LARGEST_BIAS, thetas_of_ranges
from palpate.mechanics.homogeneous import MODES, nominal_stress
from palpate.plugins.guard import answering_for

LARGEST_STRETCH = 20.0
"""Stretch, or amount of shear, that no soft material reaches."""

NEAR_REST = 0.25
"""Distance from a value up to which a first point counts as being there."""

ODD_STRESS = (1 / 10, 2.0)
"""Outside these multiples of what the study's ranges can give a stress is a warning …"""

LARGEST_STRESS = (1 / 30, 10.0)
"""… and outside these it is refused."""

EARLY = 0.3
"""Logarithm of the stretch up to which stresses are compared with the least that the ranges give."""

PERCENT_STRETCH = 3.0
"""Stretch up to which the stress of a soft material has bent, and that of a strain in percent has not."""


def check_stress(curve: Curve, channel: Channel, space: ParameterSpace) -> list[str]:
    """Sentences on what is odd in the curve of a homogeneous test; a CurveError on what cannot be."""
    if curve.channel not in MODES or not curve.ordinate.any():  # scoring refuses a curve of zeros
        return []
    _check_abscissa(curve, channel)
    start, stop = curve.branches[0]
    path = np.linspace(start, stop - 1, min(stop - start, 50)).astype(np.int64)
    stresses = stresses_of_ranges(space, curve.channel, curve.abscissa[path])
    found = [*_start(curve, channel, stresses)]
    found += [*_sign(curve, channel)] if not found else []
    percent = [*_percent(curve, channel)]
    try:
        found += [*_size(curve, channel, path, stresses)]
    except CurveError as error:
        raise CurveError(f"channel '{curve.channel}': {percent[0]}") if percent else error from None
    found += percent
    return [f"channel '{curve.channel}': {each}" for each in found]


def _at(curve: Curve, channel: Channel, row: int) -> str:
    return f"{channel.ordinate} is {curve.ordinate[row]:.4g} at {channel.abscissa} {curve.abscissa[row]:.4g}"


def _set(curve: Curve, axis: str, setting: str) -> str:
    return f"with loader csv, set {setting} in channels.{curve.channel}.{axis} of [experiment.settings]"


def _check_abscissa(curve: Curve, channel: Channel) -> None:
    """Refuse a strain, or the stress, in place of the stretch."""
    x, is_stretch = curve.abscissa, channel.abscissa == "stretch"
    least, most = float(x.min()), float(x.max())
    peak = float(np.abs(curve.ordinate).max())
    is_offset = not is_stretch and abs(x[0]) > NEAR_REST and abs(curve.ordinate[0]) < LARGEST_BIAS * peak
    is_strain = is_stretch and (least <= 0.0 or x[0] < NEAR_REST)
    if np.abs(x).max() <= LARGEST_STRETCH and not is_strain and not is_offset:
        return
    found = f"channel '{curve.channel}': {channel.abscissa} goes from {x[0]:.4g} to {x[-1]:.4g}"
    if is_stretch and abs(curve.ordinate[0] - 1.0) < NEAR_REST:
        raise CurveError(
            f"{found} and {channel.ordinate} begins at {curve.ordinate[0]:.4g}, where a stretch begins at 1 "
            "and a stress at 0: the columns are swapped; exchange their names in the header line, or in "
            f"channels.{curve.channel} of [experiment.settings]"
        )
    if max(-least, most) > LARGEST_STRETCH:
        settings = "scale = 0.01, offset = 1" if is_stretch else "scale = 0.01"
        raise CurveError(
            f"{found}, which no soft material reaches, as of a strain in percent; "
            f"{_set(curve, 'abscissa', settings)}"
        )
    if is_offset:
        raise CurveError(
            f"{found}, and its stress begins at 0: an amount of shear begins at 0, without the 1 of a "
            "stretch; "
            f"lower its offset by {x[0]:.4g}: {_set(curve, 'abscissa', 'offset')}"
        )
    raise CurveError(
        f"{found}, where a stretch begins at 1 and is always positive: this is a strain; "
        f"{_set(curve, 'abscissa', 'offset = 1')}"
    )


def _from_rest(values: FloatArray, channel: Channel) -> FloatArray:
    return values - 1.0 if channel.abscissa == "stretch" else values


def _sign(curve: Curve, channel: Channel) -> Iterator[str]:
    """A stress that has another sign than its strain."""
    along = np.sign(_from_rest(curve.abscissa, channel)) * curve.ordinate
    row, peak = int(along.argmin()), float(np.abs(along).max())
    if along[row] >= -BIAS * peak:
        return
    what = f"{_at(curve, channel, row)}, and a specimen resists: it is positive in tension, negative else"
    if along.max() < 0.5 * peak:
        raise CurveError(
            f"channel '{curve.channel}': {what}; turn its sign: {_set(curve, 'ordinate', 'scale = -1')}"
        )
    if along[row] < -LARGEST_BIAS * peak:
        raise CurveError(
            f"channel '{curve.channel}': {what}; subtract the bias of the load cell, or check the columns"
        )
    yield f"{what}; subtract the bias of the load cell, or leave out the rows of the slack specimen"


def _start(curve: Curve, channel: Channel, stresses: FloatArray) -> Iterator[str]:
    """A stress at the first point that is above what the ranges give there."""
    peak, start = float(np.abs(curve.ordinate).max()), float(np.abs(curve.ordinate[0]))
    near = abs(float(_from_rest(curve.abscissa[:1], channel)[0])) < NEAR_REST
    excess = start - float(np.abs(stresses[:, 0]).max(initial=0.0)) * ODD_STRESS[1]
    excess -= 0.0 if curve.std is None else 3.0 * float(curve.std[0])
    if len(stresses) and near and excess > BIAS * peak:
        yield (
            f"{_at(curve, channel, 0)}, {start / peak:.0%} of its peak, where it must be next to 0; subtract "
            f"the bias of the load cell: {_set(curve, 'ordinate', 'offset = minus its reading at rest')}"
        )


def _size(curve: Curve, channel: Channel, path: IntArray, stresses: FloatArray) -> Iterator[str]:
    """A rise of the stress that no set of the ranges can give."""
    if not len(stresses):
        return
    measured = np.abs(curve.ordinate[path] - curve.ordinate[path[0]])
    travel = np.abs(curve.abscissa[path] - curve.abscissa[path[0]])
    # Share of the first branch up to which a stress may be noise, or the rest of an earlier test.
    is_counted = (measured >= BIAS * np.abs(curve.ordinate).max()) & (travel >= 0.01 * travel[-1])
    counted = np.flatnonzero(is_counted)
    if not counted.size:
        return
    given = np.abs(stresses - stresses[:, :1])
    least, most = (end(given, axis=0) for end in (np.min, np.max))
    at = int(counted[(measured[counted] / most[counted]).argmax()])
    times, factor = measured[at] / most[at], most[at]
    if times <= ODD_STRESS[1]:
        early = counted[np.abs(_from_rest(curve.abscissa[path[counted]], channel)) < np.expm1(EARLY)]
        if not early.size or not least[early].all():
            return
        at = int(early[(measured[early] / least[early]).argmax()])
        times, factor = measured[at] / least[at], least[at]
        if times >= ODD_STRESS[0]:
            return
    text = (
        f"{_at(curve, channel, int(path[at]))}, {times:.3g} times "
        f"the {'largest' if times > 1.0 else 'least'} stress that the ranges of the study give "
        f"({factor:.3g} MPa from the first point); check the unit "
        f"of the stress ({_set(curve, 'ordinate', 'scale = 0.001')} for kPa), of the ranges in "
        "[region], and this row"
    )
    if not LARGEST_STRESS[0] <= times <= LARGEST_STRESS[1]:
        raise CurveError(f"channel '{curve.channel}': {text}")
    yield text


def _percent(curve: Curve, channel: Channel) -> Iterator[str]:
    """A stress in proportion to a large strain, as of a strain in percent.

    Every incompressible material softens at first by its change of area: neo-Hooke's stress λ − λ⁻² has half
    of its first secant at a stretch of 3.
    """
    x, y = curve.abscissa, curve.ordinate
    above = np.flatnonzero(x >= PERCENT_STRETCH)
    if channel.abscissa != "stretch" or not above.size or x[0] >= PERCENT_STRETCH:
        return
    last = int(above[0])
    first = int(np.argmax(x - 1.0 >= (x[last] - 1.0) / 4.0))
    if not 0 < first < last or not y[first] or abs(x[0] - 1.0) > NEAR_REST:
        return
    straight = (x[last] - 1.0) / (x[first] - 1.0)
    soft = (x[last] - x[last] ** -2) / (x[first] - x[first] ** -2)
    share = (y[last] / y[first] - soft) / (straight - soft)
    if abs(share - 1.0) < 0.15:
        yield (
            f"{channel.ordinate} grows in proportion to the strain up to {channel.abscissa} {x[last]:.3g}, "
            "where soft materials bend, as of a strain in percent; if it is one, "
            f"{_set(curve, 'abscissa', 'scale = 0.01, offset = 1')}"
        )


def stresses_of_ranges(space: ParameterSpace, mode: str, amounts: FloatArray) -> FloatArray:
    """Nominal stresses (n_sets, n) [MPa] of a mode at the ends and middles of the ranges.

    No set where there are several regions, or the material has directions or too many parameters.
    """
    none = np.zeros((0, amounts.size))
    thetas = thetas_of_ranges(space, space.regions[0], n_levels=3) if len(space.regions) == 1 else None
    material = space.regions[0].material
    if not thetas or not isinstance(material, IsotropicMaterial):
        return none
    with answering_for(material, "energy at the ends of the ranges"), np.errstate(all="ignore"):
        stresses = np.stack([nominal_stress(material, theta, mode, amounts) for theta in thetas])
    return np.asarray(stresses[np.isfinite(stresses).all(axis=1)])


# ------------------------------------------------------------------ two tests


def check_modes(curves: Mapping[str, Curve], space: ParameterSpace) -> list[str]:
    """Say which tests of one specimen are the same numbers, and which two seem to be exchanged."""
    found, exchanged = [], []
    for one, other in combinations([name for name in curves if name in MODES], 2):
        a, b = curves[one], curves[other]
        if np.array_equal(a.abscissa, b.abscissa) and np.array_equal(a.ordinate, b.ordinate):
            found.append(
                f"'{one}' and '{other}' are the same numbers; give each test its own file under measured, or "
                "leave one out"
            )
        elif "simple_shear" not in (one, other) and (off := _exchanged(a, b, space)):
            exchanged.append((off, one, other))
    # Two files that are exchanged disagree with the third as well, by less.
    for _, one, other in sorted(exchanged)[-1:]:
        found.append(
            f"'{one}' and '{other}' have the ratio of stresses that the study's material has when they are "
            "exchanged; check which file is which test, under measured"
        )
    return found


def _exchanged(a: Curve, b: Curve, space: ParameterSpace) -> float:
    """Distance of the logarithm of two stresses' ratio from what the ranges give, over stretch.

    0 where it is small, or is no smaller the other way round. The stresses are those from the first stretch
    that both have, so that a bias is no part of them.
    """
    firsts = [curve.cut(slice(*curve.branches[0])) for curve in (a, b)]
    low = max(float(curve.abscissa.min()) for curve in firsts)
    high = min(float(curve.abscissa.max()) for curve in firsts)
    amounts = np.linspace(max(low, np.exp(-2.0 * EARLY)), min(high, np.exp(2.0 * EARLY)), 15)
    if not abs(np.log(high / low)) > EARLY / 3.0 or amounts[-1] <= amounts[0]:
        return 0.0
    if abs(amounts[0] - 1.0) > abs(amounts[-1] - 1.0):
        amounts = amounts[::-1]
    given = [stresses_of_ranges(space, curve.channel, amounts) for curve in firsts]
    if not all(len(each) for each in given):
        return 0.0
    orders = [np.argsort(curve.abscissa) for curve in firsts]
    measured = [
        np.interp(amounts, curve.abscissa[order], curve.ordinate[order])
        for curve, order in zip(firsts, orders, strict=True)
    ]
    with np.errstate(all="ignore"):
        ratio = np.log(_rise(measured[0]) / _rise(measured[1]))
        ratios = np.log(_rise(given[0]) / _rise(given[1]))
    ratios = ratios[np.isfinite(ratios).all(axis=1)]
    if not len(ratios) or not np.isfinite(ratio).all():
        return 0.0
    ends = ratios.min(axis=0), ratios.max(axis=0)
    off, off_exchanged = (float(np.median(np.abs(each - np.clip(each, *ends)))) for each in (ratio, -ratio))
    # Relative difference of two tests' ratio from what the ranges give, above which they may be exchanged.
    return off if off > 0.1 and off_exchanged < 0.5 * off else 0.0


def _rise(stresses: FloatArray) -> FloatArray:
    """Stresses (..., n − 3) above the first one; the three next to it are mostly noise."""
    return np.asarray(stresses[..., 3:] - stresses[..., :1])
