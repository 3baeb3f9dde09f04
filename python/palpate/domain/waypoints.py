"""Waypoints of a rigid motion, or of loads on what moves."""

from dataclasses import dataclass

import numpy as np

from palpate.domain.curves import FloatArray, frozen_floats
from palpate.errors import StudyError

MOST_TILT_DEG = 30.0
"""Tilt from which an indenter no longer presses along the normal."""

MOST_WAYPOINTS = 1_000

DEPTH, ROTATION = 0, 5
"""Columns of a pose; the four between them are two shifts and two tilts."""


MOVES = ("depth", "rotation", "shift", "tilt", "load")
"""Parts of a motion: components that move, and whether loads move some of them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Waypoints:
    """Poses of an indenter, or loads on it, in the order travelled; between them all changes linearly.

    Parameters
    ----------
    pose : (n, 6) array
        In the frame of the spot, from rest at 0: depth and shifts along x and y [mm] of the indenter's
        origin; the rotation vector of its axis from the normal, along x and y, and the rotation about that
        axis [degrees].
    loads : (n, 6) array, optional
        NaN where a component has the value in ``pose``. A number: the load of the indenter on the tissue
        [N, N·mm] that does work along this component, which moves until it is reached, at most to the
        distance from 0 that is in ``pose``. Infinite: the component stays where a load has left it.
    time_s : (n,) array, optional
        From 0 on.
    """

    pose: FloatArray
    loads: FloatArray | None = None
    time_s: FloatArray | None = None

    def __post_init__(self) -> None:
        for name in ("pose", "loads", "time_s"):
            if (values := getattr(self, name)) is not None:
                object.__setattr__(self, name, frozen_floats(values))
        pose = self.pose
        if pose.ndim != 2 or pose.shape[1] != 6 or pose.shape[0] < 2 or not np.isfinite(pose).all():
            raise StudyError("protocol: a motion needs at least two finite rows of six components")
        if pose[0].any():
            raise StudyError(f"protocol: the motion starts at {pose[0].tolist()}; start it at rest, all 0")
        if not np.hypot(pose[:, 3], pose[:, 4]).max() < MOST_TILT_DEG:
            raise StudyError(f"protocol: the motion tilts by {MOST_TILT_DEG:g}° or more; tilt less")
        if self.loads is not None:
            self._check_loads(self.loads)
        times = self.time_s
        if times is not None and (
            times.shape != pose.shape[:1] or times[0] != 0.0 or not (np.diff(times) > 0.0).all()
        ):
            raise StudyError("protocol: the times of a motion start at 0 and grow from row to row")

    def is_same(self, other: "Waypoints") -> bool:
        """Whether both have equal rows."""
        pairs = ((getattr(self, f), getattr(other, f)) for f in ("pose", "loads", "time_s"))
        return all(
            a is b or (a is not None and b is not None and np.array_equal(a, b, equal_nan=True))
            for a, b in pairs
        )

    def _check_loads(self, loads: FloatArray) -> None:
        if loads.shape != self.pose.shape or not np.isnan(loads[0]).all():
            raise StudyError("protocol: the loads of a motion have the shape of its poses, and none at rest")
        free = ~np.isnan(loads)
        if (np.isinf(loads[1:]) & ~free[:-1]).any():
            raise StudyError("protocol: a component stays only where a load before it has left it")
        if (free & (self.pose == 0.0)).any():
            raise StudyError("protocol: a load needs the farthest place that it may move to, which is not 0")
