"""Pose and wrench brought to the same instants."""

from collections.abc import Sequence

import numpy as np

from palpate.api import FloatArray
from palpate_robot_log.reading.series import Series

_LEAST_OVERLAP = 0.5


def are_together(series: Sequence[Series]) -> bool:
    """Whether all have the very same instants, so that nothing is interpolated."""
    first = series[0].time_s
    return all(other.time_s is first or np.array_equal(other.time_s, first) for other in series[1:])


def overlap(kept: Series, others: Sequence[Series]) -> slice:
    """Rows of ``kept`` at which all the others have values.

    Raises
    ------
    CurveError
        They hardly overlap: the clocks differ.
    """
    begin = max(float(other.time_s[0]) for other in others)
    end = min(float(other.time_s[-1]) for other in others)
    first = int(np.searchsorted(kept.time_s, begin, side="left"))
    last = int(np.searchsorted(kept.time_s, end, side="right"))
    if last - first < _LEAST_OVERLAP * kept.time_s.size:
        spans = "; ".join(f"{s.what} {s.time_s[0]:.3f} to {s.time_s[-1]:.3f} s" for s in (kept, *others))
        raise kept.fault(
            f"pose and wrench hardly overlap in time ({spans}): their clocks differ, or one stopped; choose "
            "another column of time (received in a bag), or record again"
        )
    return slice(first, last)


def interpolated(series: Series, at: FloatArray) -> FloatArray:
    """Values between rows, column by column along straight lines."""
    return np.column_stack([np.interp(at, series.time_s, column) for column in series.values.T])
