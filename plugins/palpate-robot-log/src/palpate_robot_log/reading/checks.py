"""Checks of raw numbers that need no physics: time, units by magnitude, saturation, a sensor that is stuck.

Each check raises a CurveError that names row, time stamp and column. Where real logs differ
from what is assumed here, the message names the setting to change.
"""

from collections.abc import Mapping

import numpy as np

from palpate.api import FloatArray, IntArray
from palpate_robot_log.reading.channel_map import NO_COLUMN, ChannelMap, Plausible
from palpate_robot_log.reading.raw import Series

_USUAL_STEPS = 10.0
_SHORTEST_GAP_S = 0.02
_FEWEST_ROWS = 20
_PLATEAU_ROWS = 8
_PLATEAU_OVER_USUAL = 4
_PLATEAU_SHARE = 0.3
_JUMP_MM = 0.5
_TWO_PI = 2.0 * np.pi


def longest_step_s(usual_s: float) -> float:
    """Step [s] beyond which rows are missing, by the usual step [s]."""
    return max(_USUAL_STEPS * usual_s, _SHORTEST_GAP_S)


def checked_time(series: Series, channels: ChannelMap) -> Series:
    """Series whose time increases, or an error that names the row where it does not."""
    if series.time_s.size < _FEWEST_ROWS:
        raise series.fault(
            f"{series.time_s.size} rows with values where a press needs at least {_FEWEST_ROWS}; "
            "check that the log is complete"
        )
    steps = np.diff(series.time_s)
    if steps.min() < 0.0:
        index = int(np.argmax(steps < 0.0))
        raise series.fault(
            f"time goes back, to {series.time_s[index + 1]:.4f} s from {series.time_s[index]:.4f} s "
            f"({int((steps < 0.0).sum())} times in all); two logs in one file, or rows out of order: "
            "separate or sort them",
            index + 1,
        )
    if steps.min() == 0.0:
        if channels.repeated_time == "refuse":
            raise series.fault(
                f"the time of the row before once more ({int((steps == 0.0).sum())} such rows in all); "
                'remove them, or set repeated_time = "keep_first" in the channel map',
                int(np.argmax(steps == 0.0)) + 1,
            )
        series = series.part(np.concatenate([[True], steps > 0.0]))
        steps = np.diff(series.time_s)
    usual, bounds = float(np.median(steps)), channels.plausible
    if not bounds.shortest_step <= usual <= bounds.longest_step:
        raise series.fault(
            f"rows are {usual:g} s apart with time in {series.units[0]}, which no log of a press has; "
            "correct the unit of time, or widen plausible.shortest_step and longest_step in the channel map"
        )
    longest = channels.max_gap or longest_step_s(usual)
    gaps = np.flatnonzero(steps > longest)
    if gaps.size:
        first = int(gaps[0])
        raise series.fault(
            f"no rows for {steps[first]:.4f} s from here to {series.at(first + 1)}, with {usual:.4g} s as "
            f"the usual step ({gaps.size} gaps longer than {longest:.3g} s in all); record again, or raise "
            "max_gap in the channel map if nothing happened meanwhile",
            first,
        )
    return series


def check_values(series: Mapping[str, Series], channels: ChannelMap) -> float:
    """Distance of the orientations from turns, once all numbers may be those of a press."""
    bounds = channels.plausible
    for name, limit, unit in (
        ("force", channels.force_limit, "N"),
        ("moment", channels.moment_limit, "N·mm"),
    ):
        _check_sensor(series[name], channels)
        beyond = np.abs(series[name].values) >= (np.inf if limit is None else limit)
        if beyond.any():
            row, column = map(int, np.argwhere(beyond)[0])
            raise series[name].fault(
                f"{series[name].values[row, column]:g} reaches the sensor's range of {limit:g} "
                f"({name}_limit, {unit}), as in {int(beyond.any(axis=1).sum())} rows in all; press less "
                "deep, or take another sensor",
                row,
                column,
            )
    _check_magnitudes(series, bounds)
    _check_frozen(series["position"], channels.stuck)
    if "orientation" not in series:
        return 0.0
    match channels.orientation.form:
        case "quaternion":
            return _deviation_of_quaternions(series["orientation"])
        case "rotation_matrix":
            return _deviation_of_matrices(series["orientation"])
        case _:
            _check_angles(series["orientation"], bounds)
            return 0.0


# ------------------------------------------------------------------- units by magnitude


def _check_magnitudes(series: Mapping[str, Series], bounds: Plausible) -> None:
    """Refuse what a wrong unit makes of a press; hint at a factor of 1000 where that would be plausible."""
    position, force, moment = (series[name] for name in ("position", "force", "moment"))
    extent, force_range, moment_range = (
        float(np.ptp(each.values, axis=0).max()) for each in (position, force, moment)
    )
    lever = moment_range / max(force_range, 1e-300)
    as_lever = f", which with a force of {force_range:.4g} N is a lever of {lever:.3g} mm"
    rules = [
        (position, "travel", extent, "mm", f"the tip moves {extent:.4g} mm in all", ""),
        (force, "force", force_range, "N", f"it varies by {force_range:.4g} N", ""),
        (moment, "lever", lever, "mm", f"it varies by {moment_range:.4g} N·mm", as_lever),
    ]
    for each, setting, value, unit, what, more in rules[: 3 if moment_range > 0.0 else 2]:
        least, most = getattr(bounds, setting)
        if not least <= value <= most:
            factors = {"larger": 1e3, "smaller": 1e-3}
            fitting = [word for word, factor in factors.items() if least <= value * factor <= most]
            hint = f" (a unit 1000 times {fitting[0]} would do)" if fitting else ""
            raise each.fault(
                f"{what} with columns in {each.units[1]}{more}, plausible is {least:g} to {most:g} "
                f"{unit}{hint}; correct unit, or widen plausible.{setting}"
            )
    reach = np.abs(position.values).max(axis=1)
    if reach.max() > bounds.reach:
        raise position.fault(
            f"the tip is {reach.max():.4g} mm from the base with columns in {position.units[1]}, plausible "
            f"is up to {bounds.reach:g} mm; correct unit, or raise plausible.reach",
            int(reach.argmax()),
        )


def _check_angles(orientation: Series, bounds: Plausible) -> None:
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


# ------------------------------------------------------------- stuck, saturated, frozen


def _check_sensor(wrench: Series, channels: ChannelMap) -> None:
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
    all_same = np.logical_and.reduce(same[:, real], axis=1)
    first, last, seconds = _longest_run(wrench, all_same)
    # A wrench that is updated less often than rows are written repeats in every run.
    if seconds > channels.stuck and last - first + 1 > 5 * np.median(_runs(all_same)[1]):
        raise wrench.fault(
            f"the same to the last digit in all axes for {seconds:.3f} s, until {wrench.at(last)}: the "
            "sensor is stuck or its driver stopped; record again, or raise stuck in the channel map for a "
            "log without noise",
            first,
        )
    for column in real:
        _check_saturated(wrench, column, same[:, column])
        _check_axis_stuck(wrench, column, same[:, column], channels.stuck)


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


def _check_axis_stuck(wrench: Series, column: int, same: np.ndarray, stuck_s: float) -> None:
    """Refuse one axis that does not change for long and shows noise at other times."""
    if np.count_nonzero(same) * float(np.median(np.diff(wrench.time_s))) < stuck_s:
        return
    first, last, seconds = _longest_run(wrench, same)
    values = wrench.values[:, column]
    # A value of few digits repeats by chance.
    is_long = seconds > stuck_s and last - first + 1 >= _PLATEAU_ROWS
    if is_long and _is_noisy(np.concatenate([values[:first], values[last + 1 :]])):
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


def _check_frozen(position: Series, stuck_s: float) -> None:
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


# ------------------------------------------------------------------------- orientations


def _deviation_of_quaternions(orientation: Series) -> float:
    """Largest deviation of a quaternion's length from 1; refuses one that is not about 1."""
    lengths = np.sqrt(np.einsum("ij,ij->i", orientation.values, orientation.values))
    off = np.abs(lengths - 1.0)
    if off.max() > 0.01:
        first = int(np.argmax(off > 0.01))
        raise orientation.fault(
            f"the quaternion has length {lengths[first]:.4f} and not 1, as in {int((off > 0.01).sum())} "
            "rows in all; check that the columns are x, y, z, w of one orientation, and form",
            first,
        )
    return float(off.max())


def _deviation_of_matrices(orientation: Series) -> float:
    """Largest deviation from a rotation; refuses matrices that are none."""
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
