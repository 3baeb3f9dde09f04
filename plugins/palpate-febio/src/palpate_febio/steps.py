"""The protocol's path as FEBio's time: one unit of it per step, so every output time is a whole number."""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray, Indentation


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """Points that FEBio must balance at; row k belongs to time k.

    Parameters
    ----------
    depth_mm, rotation_deg : (n + 1,) array
        Row 0 is rest.
    """

    depth_mm: FloatArray
    rotation_deg: FloatArray

    @property
    def n(self) -> int:
        """Number of steps."""
        return len(self.depth_mm) - 1


def steps_of(protocol: Indentation, depth_steps: int, rotation_step_deg: float) -> Steps:
    """Steps of equal size in each piece of the path; every waypoint is one of the points.

    Parameters
    ----------
    depth_steps : int
        Steps that go from the surface to the greatest depth.
    rotation_step_deg : float
        Largest step of rotation.
    """
    step_mm = max(float(protocol.path[:, 0].max()), 1e-9) / depth_steps
    rows = [protocol.path[:1]]
    for start, end in zip(protocol.path[:-1], protocol.path[1:], strict=True):
        change = np.abs(end - start) / (step_mm, rotation_step_deg)
        n = max(int(np.ceil(change.max() - 1e-9)), 1)
        piece = start + (end - start) * np.arange(1, n + 1)[:, None] / n
        piece[-1] = end
        rows.append(piece)
    points = np.concatenate(rows)
    return Steps(points[:, 0].copy(), points[:, 1].copy())


def up_to_first_turn(steps: Steps) -> Steps:
    """The steps up to where the rotation first turns back; all of them where it never does."""
    change = np.sign(np.diff(steps.rotation_deg))
    moving = np.flatnonzero(change)
    turns = moving[1:][change[moving[1:]] != change[moving[:-1]]]
    end = int(turns[0]) + 1 if turns.size else len(steps.depth_mm)
    return Steps(steps.depth_mm[:end], steps.rotation_deg[:end])


def halved(steps: Steps) -> Steps:
    """Steps in two halves each."""

    def cut(values: FloatArray) -> FloatArray:
        whole = np.empty(2 * len(values) - 1)
        whole[::2] = values
        whole[1::2] = 0.5 * (values[1:] + values[:-1])
        return whole

    return Steps(cut(steps.depth_mm), cut(steps.rotation_deg))


def with_hold(steps: Steps, n_held: int) -> Steps:
    """Steps with the last point held for ``n_held`` more."""
    return Steps(*(np.pad(v, (0, n_held), mode="edge") for v in (steps.depth_mm, steps.rotation_deg)))
