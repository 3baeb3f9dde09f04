"""A log in two files: the pose by the robot's controller and the wrench by the sensor's; their clocks."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import correlate

from palpate.api import FloatArray
from palpate_robot_log.reading.formats import Request, read_log
from palpate_robot_log.reading.raw import RawLog, Series

_STEP_S = 0.01
_SMOOTHING_STEPS = 5.0
_LEAST_AGREEMENT = 0.5
_LONGEST_S = 3600.0
_YEAR_2001_S = 1e9
"""Seconds since 1970 that no clock that began with the log has counted."""


def read_both(pose: Path, wrench: Path, request: Request) -> RawLog:
    """One log of the streams of both files; the one stream of a table is called pose or wrench."""
    logs = [read_log(path, replace(request, columns=None, streams=None)) for path in (pose, wrench)]
    streams = [
        replace(stream, name=stream.name or name)
        for name, log in zip(("pose", "wrench"), logs, strict=True)
        for stream in log.streams
    ]
    same = logs[0].layout == logs[1].layout
    return replace(
        logs[0],
        source=f"{pose} and {wrench.name}",
        format=" and ".join(dict.fromkeys(log.format for log in logs)),
        streams=tuple(streams),
        notes=tuple(note for log in logs for note in log.notes),
        layout=logs[0].layout if same else {},
    )


def share_clock(spans_s: Sequence[tuple[float, float]]) -> bool:
    """Whether times [s] are of one clock: all count since 1970, and half of the shortest is common."""
    shared = min(end for _, end in spans_s) - max(begin for begin, _ in spans_s) if spans_s else 0.0
    shortest = min((end - begin for begin, end in spans_s), default=0.0)
    return min((begin for begin, _ in spans_s), default=0.0) > _YEAR_2001_S and shared >= 0.5 * shortest


def clock_offset_s(position: Series, force: Series) -> float:
    """Time [s] by which the force's clock is ahead of the position's.

    At this shift the speed of the tip along its main direction and the rate of the push go up and down
    together: both are large while the tool presses and retracts, and the push changes most where a press
    ends and a retraction begins.

    Raises
    ------
    CurveError
        They do not agree at any shift.
    """
    away = position.values - position.values[0]
    along = np.linalg.svd(away - away.mean(axis=0), full_matrices=False)[2][0]
    speed = _rates(position, away @ along)
    push = _rates(force, np.linalg.norm(force.values - np.median(force.values[:5], axis=0), axis=1))
    agreement = correlate(push, speed, method="fft") / (np.linalg.norm(push) * np.linalg.norm(speed))
    best = int(np.argmax(agreement))
    if not agreement[best] >= _LEAST_AGREEMENT:
        raise force.fault(
            f"at no shift of the clocks the push follows the press (agreement {agreement[best]:.2f}); "
            "check that both files are of one press"
        )
    left, middle, right = agreement[[max(best - 1, 0), best, min(best + 1, agreement.size - 1)]]
    bend = left - 2.0 * middle + right
    fraction = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    shift = (best - (speed.size - 1) + fraction) * _STEP_S
    return float(force.time_s[0] - position.time_s[0] + shift)


def _rates(series: Series, values: FloatArray) -> FloatArray:
    """Size of the rate of a value (n,) on a grid of steps, smoothed."""
    duration = min(float(series.time_s[-1] - series.time_s[0]), _LONGEST_S)
    grid = series.time_s[0] + np.arange(0.0, duration, _STEP_S)
    smooth = gaussian_filter1d(np.interp(grid, series.time_s, values), _SMOOTHING_STEPS, order=1)
    rates: FloatArray = np.abs(smooth)
    return rates
