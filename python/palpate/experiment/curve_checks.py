"""Checks of measured curves by the declarations of their channels, for every loader.

Impossible curves are refused. Suspicious ones give a sentence, which ``palpate check`` and
``palpate run`` print as a warning and the manifest keeps.
"""

from collections.abc import Callable, Iterator, Mapping
from itertools import product
from types import MappingProxyType

import numpy as np

from palpate import _core
from palpate.domain import Channel, Curve, FloatArray, Indentation, ParameterSpace, RegionMaterial, Response
from palpate.domain.material import IsotropicMaterial
from palpate.errors import CurveError
from palpate.plugins.guard import answering_for

BIAS = 0.025
"""Share of its peak above which an ordinate that must be zero gives a warning."""

LARGEST_BIAS = 0.15
"""The same share beyond which the curve is refused."""

LARGEST_WORK_BACK = 0.02
"""Share of the largest work put in by which the returned work may exceed it."""

LARGEST_ONSET = 0.03
"""Share of the travel beyond which a late onset of contact gives a warning."""

LARGEST_GAP = 0.3
"""Share of a branch without a point, above which there is a warning; above half it is refused."""

LEAST_POINTS = 5
"""Points of a branch below which there is a warning."""

SIZES = (1 / 30, 30.0)
"""A peak is refused outside these multiples of Hertz's force for the study's ranges."""

LEVERS = (1 / 100, 30.0)
"""Torque over force is refused outside these multiples of what the indenter gives …"""

ODD_LEVERS = (1 / 10, 5.0)
"""… and outside these there is a warning."""

_STRAINS = np.array([-0.3, -0.05, 0.05, 0.3])


def check_curve(curve: Curve, channel: Channel) -> list[str]:
    """Sentences on what is odd in one curve by its channel's declarations; a CurveError on what cannot be."""
    named = f"channel '{curve.channel}'"
    peak = float(np.abs(curve.ordinate).max())
    if not peak > 0.0:
        return []  # scoring refuses a curve of zeros
    # Ordinate beyond which a square, and with it every score, is no number.
    if peak > 1e150:
        row = int(np.abs(curve.ordinate).argmax())
        raise CurveError(
            f"{named}: {curve.ordinate[row]:.3g} in row {row} is too large to be squared; repair it"
        )
    outliers = [*_outlier(curve)]
    if channel.non_negative:
        _check_sign(curve, channel, peak)
    if channel.dissipative:
        _check_work(curve, channel)
    found = [*(_disorder(curve, channel) or _points(curve)), *outliers]
    if channel.zero_at_start:
        found += _bias(curve, channel, peak)
    return [f"{named} {each}" for each in found]


def _check_sign(curve: Curve, channel: Channel, peak: float) -> None:
    row = int(curve.ordinate.argmin())
    least = float(curve.ordinate[row])
    if least < -BIAS * peak:
        remedy = "turn its sign" if curve.ordinate.max() < 0.5 * peak else "subtract the bias of the sensor"
        raise CurveError(
            f"channel '{curve.channel}': {channel.ordinate} is {least:.4g} at {channel.abscissa} "
            f"{curve.abscissa[row]:.4g}, and it cannot be negative; {remedy}, or check the columns"
        )


def _check_work(curve: Curve, channel: Channel) -> None:
    means = (curve.ordinate[1:] + curve.ordinate[:-1]) / 2.0
    work = np.concatenate([[0.0], np.cumsum(means * np.diff(curve.abscissa))])
    least = float(work.min())
    if least < -LARGEST_WORK_BACK * float(np.abs(work).max()):
        row = int(work.argmin())
        raise CurveError(
            f"channel '{curve.channel}': up to row {row} ({channel.abscissa} {curve.abscissa[row]:.4g}) it "
            f"returns more work than was put in ({least:.3g} {channel.ordinate}·{channel.abscissa}), which "
            "no tissue does; turn the sign of one column, or check whether one lags behind the other"
        )


def _disorder(curve: Curve, channel: Channel) -> list[str]:
    """One row whose removal leaves a path of fewer and longer branches."""
    x, n_branches = curve.abscissa, len(curve.branches)
    ends = {row for start, stop in curve.branches for row in (start, start + 1, stop - 2, stop - 1)}
    short = min(stop - start for start, stop in curve.branches)
    if n_branches < 2 or short >= LEAST_POINTS:
        return []
    others = {row: np.ascontiguousarray(np.delete(x, row)) for row in sorted(ends)}
    left = {row: _core.branches(rest) for row, rest in others.items() if np.ptp(rest)}
    row = min(left, key=lambda each: len(left[each]))
    if len(left[row]) == n_branches or min(stop - start for start, stop in left[row]) < LEAST_POINTS:
        return []
    where = f"row {row} ({channel.abscissa} {x[row]:.4g}) is out of order"
    return [f"{where}; move it where its {channel.abscissa} belongs in the file, or remove it"]


def _points(curve: Curve) -> Iterator[str]:
    for x, worst, share in _widest_gaps(curve):
        if x.size < LEAST_POINTS or share > LARGEST_GAP:
            yield (
                f"has {x.size} points from {x[0]:.4g} to {x[-1]:.4g} and none between {x[worst]:.4g} and "
                f"{x[worst + 1]:.4g}; give more rows, their shape decides the parameters"
            )


def _outlier(curve: Curve) -> Iterator[str]:
    """A row farther from the line between its neighbours than the largest value of all other rows."""
    x, y = curve.abscissa, curve.ordinate
    inside = [row for start, stop in curve.branches for row in range(start + 1, stop - 1)]
    rows = np.array(inside, dtype=np.int64)
    if rows.size < LEAST_POINTS:
        return
    share = (x[rows] - x[rows - 1]) / np.where(x[rows + 1] == x[rows - 1], 1.0, x[rows + 1] - x[rows - 1])
    off = np.abs(y[rows] - y[rows - 1] - share * (y[rows + 1] - y[rows - 1]))
    row = int(rows[off.argmax()])
    largest = float(np.abs(np.delete(y, row)).max())
    if off.max() > largest:
        found = f"is {y[row]:.4g} in row {row} and {y[row - 1]:.4g} and {y[row + 1]:.4g} next to it"
        if off.max() > 20.0 * largest:  # -9999 and 1e30 stand for no value
            raise CurveError(f"channel '{curve.channel}' {found}, as of a missing value; remove this row")
        yield f"{found}; check this row"


def check_gaps(curve: Curve) -> None:
    """Refuse a curve with a branch of which more than half is not measured, with a CurveError."""
    for x, worst, share in _widest_gaps(curve):
        if share > 0.5 + 1e-9:
            raise CurveError(
                f"channel '{curve.channel}' has no point between {x[worst]:.4g} and {x[worst + 1]:.4g}, "
                f"more than half of its way from {x[0]:.4g} to {x[-1]:.4g} ({x.size} points); "
                "measure the part between"
            )


def _widest_gaps(curve: Curve) -> Iterator[tuple[FloatArray, int, float]]:
    """Abscissae of each branch, the point before its widest gap, and the share that the gap is of it."""
    for start, stop in curve.branches:
        x = curve.abscissa[start:stop]
        steps = np.abs(np.diff(x))
        worst = int(steps.argmax())
        yield x, worst, float(steps[worst] / np.ptp(x))


def _bias(curve: Curve, channel: Channel, peak: float) -> Iterator[str]:
    """Ordinate at the start of the path, which must be zero, and the onset of contact."""
    travel = float(np.ptp(curve.abscissa))
    start = float(curve.ordinate[0])
    # A first point close to zero may have the ordinate of a straight line there.
    excess = (abs(start) - (0.0 if curve.std is None else 3.0 * float(curve.std[0]))) / peak
    excess -= abs(float(curve.abscissa[0])) / travel
    onset = _onset(curve) if channel.non_negative else None
    at = f"{channel.abscissa} {curve.abscissa[0]:.4g}"
    if excess > BIAS:
        share = f"{abs(start) / peak:.0%} of its peak"
        what = f"is {start:.4g} {channel.ordinate} at {at}, {share}, where it must be 0"
        if excess > LARGEST_BIAS:
            raise CurveError(
                f"channel '{curve.channel}' {what}; subtract the bias of the sensor, begin the path at first "
                "contact, or check the columns"
            )
        early = "" if onset is None or onset >= 0.0 else f" (as if contact began at {onset:.2g})"
        yield (
            f"{what}{early}: the sensor has a bias, or contact begins earlier; "
            "a fit would attribute it to the tissue"
        )
    elif onset is not None and onset > LARGEST_ONSET * travel:
        yield (
            f"rises as if first contact were at {channel.abscissa} {onset:.2g} and not at 0; "
            "shift the depth by it, unless the tissue is very soft at first"
        )


def _onset(curve: Curve) -> float | None:
    """Abscissa d0 of the law k·(d − d0)^n that fits the first rise best; None where none does.

    Exponents run from 1 (flat punch) over 3/2 (sphere) to 3 (a tissue that stiffens).
    """
    start, stop = curve.branches[0]
    x, y = curve.abscissa[start:stop], curve.ordinate[start:stop]
    n_used = max(int((x <= x[0] + 0.4 * np.ptp(x)).sum()), 6)
    if x.size < n_used or x[-1] <= x[0]:
        return None
    x, y, travel = x[:n_used], y[:n_used], float(np.ptp(x))
    onset, exponent = np.meshgrid(np.linspace(-0.3, 0.4, 141) * travel, np.arange(1.0, 3.01, 0.25))
    law = np.maximum(x - onset[..., None], 0.0) ** exponent[..., None]
    size = np.maximum((law**2).sum(axis=-1), np.finfo(float).tiny)
    left = (y**2).sum() - (law @ y) ** 2 / size
    best = np.unravel_index(int(left.argmin()), left.shape)
    return float(onset[best]) if left[best] < 0.03**2 * (y**2).sum() else None


# ------------------------------------------------------------------------- size


def check_sizes(
    response: Response, channels: Mapping[str, Channel], protocol: Indentation, space: ParameterSpace
) -> list[str]:
    """Compare forces and moments with the indenter, the depth and the study's ranges; returns what is odd.

    Only for channels whose ``length_power`` is 2 (a force) over depth or slide, or 3 (a moment) over rotation
    or tilt, and where no load is prescribed. A CurveError for a size that no set of the ranges can give, or a
    torque that the indenter cannot give with the force.
    """
    if protocol.loads is not None:
        return []
    peaks = {
        name: float(np.abs(curve.ordinate).max())
        for name, curve in response.curves.items()
        if (channels[name].abscissa, channels[name].length_power) in _ARMS
        and curve.ordinate.any()  # scoring refuses a curve of zeros
    }
    if moduli := young_range(space):
        for name, peak in peaks.items():
            _check_size(channels[name], peak, moduli, protocol)
    forces, moments = (
        [name for name in peaks if channels[name].abscissa == along] for along in ("depth_mm", "rotation_deg")
    )
    levers = [(force, moment, peaks[moment] / peaks[force]) for force, moment in product(forces, moments)]
    return [text for each in levers for text in _lever(*each, protocol)]


def _check_size(channel: Channel, peak: float, moduli: tuple[float, float], protocol: Indentation) -> None:
    arm = _ARMS[channel.abscissa, channel.length_power](protocol)
    low, high = (hertz_N(modulus, protocol) * arm for modulus in moduli)
    if channel.abscissa not in ("depth_mm", "rotation_deg"):
        low = 0.0  # a slide or a tilt may be as small as one likes
    if high > 0.0 and not SIZES[0] * low <= peak <= SIZES[1] * high:
        raise CurveError(
            f"channel '{channel.name}': {channel.ordinate} reaches {peak:.4g}, and the ranges of the study "
            f"(Young's modulus {moduli[0]:.3g} to {moduli[1]:.3g} MPa) give about {low:.3g} to {high:.3g} "
            f"under {_what(protocol)}; check the unit of this column, and of moduli, radius and depth"
        )


def _lever(force: str, moment: str, lever: float, protocol: Indentation) -> Iterator[str]:
    usual = lever_mm(protocol)
    if not usual > 0.0 or ODD_LEVERS[0] * usual <= lever <= ODD_LEVERS[1] * usual:
        return
    text = (
        f"'{moment}' over '{force}' is a lever of {lever:.3g} mm, where {_what(protocol)} gives about "
        f"{usual:.2g} mm; check the units (1 N·m is 1,000 N·mm, 1 N·cm is 10), and that no two columns "
        "are swapped"
    )
    if not LEVERS[0] * usual <= lever <= LEVERS[1] * usual:
        raise CurveError(text)
    yield text


def _what(protocol: Indentation) -> str:
    depth, rotation = np.abs(protocol.path).max(axis=0)
    return (
        f"a {protocol.indenter.name} of radius {protocol.indenter.radius_mm:g} mm, {depth:g} mm deep, turned "
        f"by {rotation:g} degrees with friction {protocol.friction:g}"
    )


def hertz_N(young_MPa: float, protocol: Indentation) -> float:  # noqa: N802 -- the unit
    """Force [N] at full depth on an incompressible half-space: 16/9 E a d, Hertz's for a sphere."""
    depth = float(protocol.path[:, 0].max())
    return 16.0 / 9.0 * young_MPa * depth * protocol.indenter.contact_radius_mm(depth)


def lever_mm(protocol: Indentation) -> float:
    """Torque over force [mm]: a² β / d while it sticks, R β for a sphere; 3π/16 μ a once it slips."""
    indenter, depth = protocol.indenter, float(protocol.path[:, 0].max())
    rotation = float(np.radians(np.abs(protocol.path[:, 1]).max()))
    contact = indenter.contact_radius_mm(depth)
    sticking = contact**2 / depth * rotation if depth > 0.0 else 0.0
    return min(sticking, 3.0 * np.pi / 16.0 * protocol.friction * min(contact, indenter.reach_mm(depth)))


_ARMS: Mapping[tuple[str, int | None], Callable[[Indentation], float]] = MappingProxyType(
    {
        ("depth_mm", 2): lambda protocol: 1.0,
        ("rotation_deg", 3): lever_mm,
        ("slide_mm", 2): lambda protocol: protocol.friction,
        ("tilt_deg", 3): lambda press: press.indenter.contact_radius_mm(float(press.path[:, 0].max())),
    }
)
"""What the peak is over Hertz's force, about or at most, by abscissa and power of the length."""


def young_range(space: ParameterSpace) -> tuple[float, float] | None:
    """Least initial and largest secant Young's modulus [MPa] at the corners of the ranges.

    None where a region's material has directions, or too many parameters.
    """
    ends = [_young_ends(space, region) for region in space.regions]
    known = [each for each in ends if each is not None]
    if not known or len(known) < len(ends):
        return None
    return min(low for low, _ in known), max(high for _, high in known)


def _young_ends(space: ParameterSpace, region: RegionMaterial) -> tuple[float, float] | None:
    material, thetas = region.material, thetas_of_ranges(space, region)
    if not thetas or not isinstance(material, IsotropicMaterial):
        return None
    with answering_for(material, "energy at the ends of the ranges"), np.errstate(all="ignore"):
        moduli = np.stack([secant_young_MPa(material, theta, _STRAINS) for theta in thetas])
    initial = moduli[:, np.abs(_STRAINS) < 0.1]
    if not np.isfinite(moduli).all() or not (initial > 0.0).any():
        return None
    return float(initial[initial > 0.0].min()), float(moduli.max())


def secant_young_MPa(  # noqa: N802 -- the unit
    material: IsotropicMaterial, theta: FloatArray, strains: FloatArray
) -> FloatArray:
    """Secant Young's moduli (n,) [MPa]: an isochoric pull by the logarithmic strain e stores E e²/2."""
    stretches = np.exp(np.stack([strains, -strains / 2.0, -strains / 2.0], axis=-1))
    return 2.0 * np.asarray(material.energy(stretches, theta)) / strains**2


def thetas_of_ranges(space: ParameterSpace, region: RegionMaterial, n_levels: int = 2) -> list[FloatArray]:
    """Textbook parameters of a region at ``n_levels`` values of each range, its ends included.

    None of them where the material has directions, or too many parameters.
    """
    columns = space.columns_of(region.region)
    if not isinstance(region.material, IsotropicMaterial) or n_levels ** len(columns) > 2**12:
        return []
    values = [
        np.linspace(p.lower, p.upper, n_levels if i in columns else 1) for i, p in enumerate(space.parameters)
    ]
    return [space.thetas(np.array(corner))[region.region] for corner in product(*values)]
