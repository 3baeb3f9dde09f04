"""Checks of raw numbers that need no physics: units by magnitude, saturation, a sensor that is stuck.

Each check raises a CurveError that names row, time stamp and column. Where real logs differ
from what is assumed here, the message names the setting to change.
"""

import numpy as np

from palpate.api import FloatArray, IntArray
from palpate_robot_log.reading.channel_map import NO_COLUMN, ChannelMap, Plausible
from palpate_robot_log.reading.series import Series

_PLATEAU_ROWS = 8
_PLATEAU_OVER_USUAL = 4
_PLATEAU_SHARE = 0.3
_JUMP_MM = 0.5
_TWO_PI = 2.0 * np.pi


def check_position(position: Series, bounds: Plausible) -> None:
    """Refuse a way of the tip that no robot goes, which is what a wrong unit makes of it."""
    extent = float(np.ptp(position.values, axis=0).max())
    unit = position.units[1]
    what = f"the tip moves {extent:.4g} mm in all with columns in {unit}"
    _check_plausible(position, extent, bounds.travel, what, "travel")
    reach = float(np.abs(position.values).max())
    if reach > bounds.reach:
        raise position.fault(
            f"the tip is {reach:.4g} mm from the base with columns in {unit}, plausible is up to "
            f"{bounds.reach:g} mm; correct unit, or raise plausible.reach",
            int(np.argmax(np.abs(position.values).max(axis=1))),
        )


def check_wrench(force: Series, moment: Series, bounds: Plausible) -> None:
    """Refuse forces and moments that their units make too large or too small."""
    force_range = float(np.ptp(force.values, axis=0).max())
    moment_range = float(np.ptp(moment.values, axis=0).max())
    what = f"it varies by {force_range:.4g} N with columns in {force.units[1]}"
    _check_plausible(force, force_range, bounds.force, what, "force", "N")
    if moment_range > 0.0:
        lever = moment_range / force_range
        what = (
            f"it varies by {moment_range:.4g} N·mm with columns in {moment.units[1]}, which with a force of "
            f"{force_range:.4g} N is a lever of {lever:.3g} mm"
        )
        _check_plausible(moment, lever, bounds.lever, what, "lever")


def _check_plausible(
    series: Series, value: float, bounds: tuple[float, float], what: str, setting: str, unit: str = "mm"
) -> None:
    """Refuse a value out of its bounds; hint at a factor of 1000 where that would be plausible."""
    least, most = bounds
    if least <= value <= most:
        return
    factors = {"larger": 1e3, "smaller": 1e-3}
    fitting = [word for word, factor in factors.items() if least <= value * factor <= most]
    hint = f" (a unit 1000 times {fitting[0]} would do)" if fitting else ""
    raise series.fault(
        f"{what}, plausible is {least:g} to {most:g} {unit}{hint}; correct unit, or widen plausible.{setting}"
    )


def check_angles(orientation: Series, bounds: Plausible) -> None:
    """Refuse degrees that look like radians, and radians that look like degrees."""
    largest = float(np.abs(orientation.values).max())
    if largest > 2.0 * _TWO_PI:
        raise orientation.fault(f"angles up to {largest:.4g} rad; they are likely degrees: correct unit")
    in_degrees = np.degrees(largest)
    are_degrees = orientation.units[1] in ("deg", "°", "degree", "degrees")
    if are_degrees and 0.0 < in_degrees <= _TWO_PI and not bounds.small_angles:
        raise orientation.fault(
            f"all angles are below {in_degrees:.3g} degrees, so they may be radians; correct unit, or set "
            "plausible.small_angles = true"
        )


def check_sensor(wrench: Series, channels: ChannelMap) -> None:
    """Refuse an axis that never changes, a sensor that is stuck, and values cut at the end of its range."""
    real = [index for index, name in enumerate(wrench.names) if name != NO_COLUMN]
    same = wrench.values[1:] == wrench.values[:-1]
    for column in real:
        if same[:, column].all():
            raise wrench.fault(
                f"{wrench.values[0, column]:g} in every row: the axis is dead, or the column another; "
                f'repair it, or write "{NO_COLUMN}" for an axis that the sensor has not',
                0,
                column,
            )
    _check_stuck(wrench, same[:, real], channels)
    for column in real:
        _check_saturated(wrench, column, same[:, column])
        _check_axis_stuck(wrench, column, same[:, column], channels.stuck)


def check_range(wrench: Series, limit: float | None, setting: str) -> None:
    """Refuse values that reach the end of the sensor's range, where the map gives it."""
    if limit is None:
        return
    beyond = np.abs(wrench.values) >= limit
    if beyond.any():
        row, column = np.argwhere(beyond)[0]
        raise wrench.fault(
            f"{wrench.values[row, column]:g} reaches the sensor's range of {limit:g} ({setting}), as in "
            f"{int(beyond.any(axis=1).sum())} rows in all; press less deep, or take another sensor",
            int(row),
            int(column),
        )


def _runs(same: np.ndarray) -> tuple[IntArray, IntArray]:
    """First row and number of rows of each run of equal rows."""
    starts = np.concatenate([[0], np.flatnonzero(~same) + 1])
    return starts, np.diff(np.concatenate([starts, [same.size + 1]]))


def _longest_run(series: Series, same: np.ndarray) -> tuple[int, int, float]:
    """First and last row of the longest run of equal rows, and its length [s]."""
    starts, lengths = _runs(same)
    longest = int(np.argmax(lengths))
    first, last = int(starts[longest]), int(starts[longest] + lengths[longest] - 1)
    return first, last, float(series.time_s[last] - series.time_s[first])


def _check_stuck(wrench: Series, same: np.ndarray, channels: ChannelMap) -> None:
    all_same = np.logical_and.reduce(same, axis=1)
    first, last, seconds = _longest_run(wrench, all_same)
    # A wrench that is updated less often than rows are written repeats in every run.
    if seconds > channels.stuck and last - first + 1 > 5 * np.median(_runs(all_same)[1]):
        raise wrench.fault(
            f"the same to the last digit in all axes for {seconds:.3f} s, until {wrench.at(last)}: the "
            "sensor is stuck or its driver stopped; record again, or raise stuck in the channel map for a "
            "log without noise",
            first,
        )


def _check_axis_stuck(wrench: Series, column: int, same: np.ndarray, stuck_s: float) -> None:
    """Refuse one axis that does not change for long and shows noise at other times."""
    if np.count_nonzero(same) * float(np.median(np.diff(wrench.time_s))) < stuck_s:
        return
    first, last, seconds = _longest_run(wrench, same)
    values = wrench.values[:, column]
    if seconds > stuck_s and _is_noisy(np.concatenate([values[:first], values[last + 1 :]])):
        raise wrench.fault(
            f"{values[first]:.6g} to the last digit for {seconds:.3f} s, until {wrench.at(last)}, with noise "
            "at other times: the axis is stuck; record again, or raise stuck in the channel map",
            first,
            column,
        )


def _is_noisy(values: FloatArray) -> bool:
    """Whether most rows differ from their neighbours, and by chance: of a smooth signal bends are small."""
    steps = np.diff(values)
    bends = np.diff(steps)
    return bends.size > 0 and bool(np.median(np.abs(bends)) >= np.median(np.abs(steps)) > 0.0)


def _check_saturated(wrench: Series, column: int, same: np.ndarray) -> None:
    values = wrench.values[:, column]
    highest, lowest = float(values.max()), float(values.min())
    for extreme in (highest, lowest):
        is_near_rest = abs(extreme) < _PLATEAU_SHARE * max(abs(highest), abs(lowest))
        if is_near_rest or np.count_nonzero(values == extreme) < _PLATEAU_ROWS:
            continue
        starts, lengths = _runs(same)
        at_extreme = values[starts] == extreme
        longest = int(np.argmax(np.where(at_extreme, lengths, 0)))
        # A coarse sensor repeats itself at every value; one that is cut repeats itself at the end only.
        elsewhere = int(lengths[~at_extreme].max(initial=1))
        if lengths[longest] >= max(_PLATEAU_ROWS, _PLATEAU_OVER_USUAL * elsewhere):
            first = int(starts[longest])
            raise wrench.fault(
                f"{extreme:.6g} in {lengths[longest]} rows on end, until "
                f"{wrench.at(first + lengths[longest] - 1)}, "
                "and never beyond: the sensor is saturated; press less deep, or take another sensor",
                first,
                column,
            )


def check_frozen(position: Series, stuck_s: float) -> None:
    """Refuse a pose that does not change to the last digit and then jumps: its stream was interrupted."""
    starts, lengths = _runs((position.values[1:] == position.values[:-1]).all(axis=1))
    ends = starts + lengths - 1
    held = position.time_s[ends] - position.time_s[starts]
    for index in np.flatnonzero((held > stuck_s) & (lengths > 5 * np.median(lengths))):
        end = int(ends[index])
        if end + 1 < position.time_s.size:
            jump = float(np.linalg.norm(position.values[end + 1] - position.values[end]))
            if jump > _JUMP_MM:
                raise position.fault(
                    f"the pose does not change for {held[index]:.3f} s and then jumps by {jump:.2f} mm at "
                    f"{position.at(end + 1)}: its stream was interrupted; record again",
                    int(starts[index]),
                )


def check_quaternions(orientation: Series) -> float:
    """Refuse quaternions whose length is not about 1; returns the largest deviation."""
    lengths = np.sqrt(np.einsum("ij,ij->i", orientation.values, orientation.values))
    off = np.abs(lengths - 1.0)
    worst = int(np.argmax(off))
    if off[worst] > 0.01:
        first = int(np.argmax(off > 0.01))
        raise orientation.fault(
            f"the quaternion has length {lengths[first]:.4f} and not 1, as in {int((off > 0.01).sum())} "
            "rows in all; check that the columns are x, y, z, w of one orientation, and form",
            first,
        )
    return float(off[worst])


def check_matrices(orientation: Series) -> float:
    """Refuse matrices that are no rotations; returns the largest deviation."""
    matrices = orientation.values.reshape(-1, 3, 3)
    gram = np.einsum("nij,nkj->nik", matrices, matrices) - np.eye(3)
    off = np.abs(gram).max(axis=(1, 2))
    worst = int(np.argmax(off))
    if off[worst] > 0.01:
        raise orientation.fault(
            f"the nine numbers are no rotation (rows are {off[worst]:.3g} from unit length and right "
            "angles); check that they are the matrix row by row",
            worst,
        )
    determinants = np.linalg.det(matrices)
    if determinants.min() < 0.0:
        raise orientation.fault(
            "the matrix mirrors: its determinant is -1, so one of its axes points the wrong way; "
            "turn the sign of that axis's columns",
            int(np.argmin(determinants)),
        )
    return float(off[worst])
