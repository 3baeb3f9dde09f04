"""The protocol's path as FEBio's time: one unit of it per step, so every output time is a whole number.

Of a tissue that relaxes it is the time in seconds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from palpate.api import FloatArray, Indentation, StudyError
from palpate.api.experiment import dwell_times


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """Points that FEBio must balance at.

    Parameters
    ----------
    depth_mm, rotation_deg : (n + 1,) array
        Row 0 is rest.
    time_s : (n + 1,) array, optional
        Of a tissue that relaxes.
    """

    depth_mm: FloatArray
    rotation_deg: FloatArray
    time_s: FloatArray | None = None

    @property
    def n(self) -> int:
        """Number of steps."""
        return len(self.depth_mm) - 1

    @property
    def time(self) -> FloatArray:
        """FEBio's time (n + 1,): seconds where there are any, else the number of the step."""
        return np.arange(self.n + 1.0) if self.time_s is None else self.time_s

    def each(self, change: Callable[[FloatArray], FloatArray]) -> Steps:
        """Steps whose columns are changed alike."""
        time_s = None if self.time_s is None else change(self.time_s)
        return Steps(change(self.depth_mm), change(self.rotation_deg), time_s)


def steps_of(
    protocol: Indentation, depth_steps: int, rotation_step_deg: float, fastest_s: float = 0.0
) -> Steps:
    """Steps of equal size in each piece of the path; every waypoint is one of the points.

    Parameters
    ----------
    depth_steps : int
        Steps that go from the surface to the greatest depth.
    rotation_step_deg : float
        Largest step of rotation.
    fastest_s : float
        Shortest time constant of what relaxes, which needs the times of the protocol: steps of a dwell then
        grow with time.

    Raises
    ------
    StudyError
        Something relaxes, and the protocol has no times.
    """
    times = protocol.time_s
    if fastest_s and times is None:
        raise StudyError(
            'a tissue that relaxes needs the times of its press; give durations: motion = "moves"'
        )
    step_mm = max(float(protocol.path[:, 0].max()), 1e-9) / depth_steps
    rows, moments = [protocol.path[:1]], [np.zeros(1)]
    for k, (start, end) in enumerate(pairwise(protocol.path)):
        change = np.abs(end - start) / (step_mm, rotation_step_deg)
        n = max(int(np.ceil(change.max() - 1e-9)), 1)
        shares = np.arange(1, n + 1) / n
        if times is not None and fastest_s:
            at = times[k] + (times[k + 1] - times[k]) * shares
            if not change.any():
                at = dwell_times(times[k], times[k + 1], fastest_s)
                shares = np.ones(len(at))
            moments.append(at)
        piece = start + (end - start) * shares[:, None]
        piece[-1] = end
        rows.append(piece)
    points = np.concatenate(rows)
    return Steps(points[:, 0].copy(), points[:, 1].copy(), np.concatenate(moments) if fastest_s else None)


def up_to_first_turn(steps: Steps) -> Steps:
    """The steps up to where the rotation first turns back; all of them where it never does."""
    change = np.sign(np.diff(steps.rotation_deg))
    moving = np.flatnonzero(change)
    turns = moving[1:][change[moving[1:]] != change[moving[:-1]]]
    end = int(turns[0]) + 1 if turns.size else len(steps.depth_mm)
    return steps.each(lambda values: values[:end])


def halved(steps: Steps) -> Steps:
    """Steps in two halves each."""

    def cut(values: FloatArray) -> FloatArray:
        whole = np.empty(2 * len(values) - 1)
        whole[::2] = values
        whole[1::2] = 0.5 * (values[1:] + values[:-1])
        return whole

    return steps.each(cut)


def with_hold(steps: Steps, n_held: int, step_s: float = 0.0) -> Steps:
    """Steps with the last point held for ``n_held`` more, each of ``step_s`` where the tissue relaxes."""
    held = steps.each(lambda values: np.pad(values, (0, n_held), mode="edge"))
    if held.time_s is None:
        return held
    later_s = step_s * np.maximum(np.arange(held.n + 1) - steps.n, 0)
    return replace(held, time_s=held.time_s + later_s)
