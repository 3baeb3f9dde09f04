"""Time stamps: in order, without repeats and gaps, and in the unit of the map."""

import numpy as np

from palpate_robot_log.reading.channel_map import ChannelMap
from palpate_robot_log.reading.series import Series

_USUAL_STEPS = 10.0
_SHORTEST_GAP_S = 0.02
_FEWEST_ROWS = 20


def longest_step_s(usual_s: float) -> float:
    """Step [s] beyond which rows are missing, by the usual step [s]."""
    return max(_USUAL_STEPS * usual_s, _SHORTEST_GAP_S)


def checked_time(series: Series, channels: ChannelMap) -> Series:
    """Series whose time increases, or an error that names the row where it does not.

    Raises
    ------
    CurveError
        Too few rows, time that goes back or repeats, a step or a duration that no log
        has, or a gap.
    """
    if series.time_s.size < _FEWEST_ROWS:
        raise series.fault(
            f"{series.time_s.size} rows with values where a press needs at least {_FEWEST_ROWS}; "
            "check that the log is complete"
        )
    series = _increasing(series, channels)
    steps = np.diff(series.time_s)
    usual = float(np.median(steps))
    _check_rate(series, channels, usual)
    _check_gaps(series, channels, steps, usual)
    return series


def _increasing(series: Series, channels: ChannelMap) -> Series:
    steps = np.diff(series.time_s)
    if steps.min() > 0.0:
        return series
    if steps.min() < 0.0:
        index = int(np.argmax(steps < 0.0))
        raise series.fault(
            f"time goes back, to {series.time_s[index + 1]:.4f} s from {series.time_s[index]:.4f} s "
            f"({int((steps < 0.0).sum())} times in all); two logs in one file, or rows out of order: "
            "separate or sort them",
            index + 1,
        )
    if channels.repeated_time == "refuse":
        index = int(np.argmax(steps == 0.0))
        raise series.fault(
            f"the time of the row before once more ({int((steps == 0.0).sum())} such rows in all); remove "
            'them, or set repeated_time = "keep_first" in the channel map',
            index + 1,
        )
    return series.part(np.concatenate([[True], steps > 0.0]))


def _check_rate(series: Series, channels: ChannelMap, usual: float) -> None:
    bounds = channels.plausible
    if not bounds.shortest_step <= usual <= bounds.longest_step:
        raise series.fault(
            f"rows are {usual:g} s apart with time in {series.units[0]}, which no log of a press has; "
            "correct the unit of time, or widen plausible.shortest_step and longest_step in the channel map"
        )


def _check_gaps(series: Series, channels: ChannelMap, steps: np.ndarray, usual: float) -> None:
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
