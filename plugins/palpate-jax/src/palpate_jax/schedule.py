"""Points at which load stepping balances: the waypoints of a motion, and points between them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.api import BoolArray, FloatArray, Indentation, IntArray
from palpate.api.experiment import dwell_times
from palpate_jax.contact import Answer, Pose, Velocity

REST = np.zeros(6)


def tip_at(position: FloatArray) -> FloatArray:
    """Origin of the indenter (3,) [mm] at a position (6,)."""
    return np.array([position[1], position[2], -position[0]])


def pose(position: FloatArray) -> Pose:
    """The indenter at a position (6,)."""
    angle = np.deg2rad(position[5])
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    if position[3:5].any():
        turn = _tilt(position) @ turn
    return Pose(tip_at(position), turn)


def motion(position: FloatArray, way: FloatArray) -> Velocity:
    """The indenter's velocity at a position (6,) that changes by ``way`` (6,)."""
    spin = np.array([0.0, 0.0, np.deg2rad(way[5])])
    if position[3:5].any() or way[3:5].any():
        vector = np.deg2rad([*position[3:5], 0.0])
        spin = _tilt(position) @ spin + _spin_per_vector(vector) @ np.deg2rad([*way[3:5], 0.0])
    return Velocity(tip_at(way), spin)


def _tilt(position: FloatArray) -> FloatArray:
    """Rotation (3, 3) that tilts the axis: the exponential of a cross product."""
    vector = np.deg2rad([*position[3:5], 0.0])
    return np.asarray(np.eye(3) + _cross(vector) @ _spin_per_vector(vector))


def _spin_per_vector(vector: FloatArray) -> FloatArray:
    """Spin (3, 3) per rate of a rotation vector: the left Jacobian of rotations."""
    angle, cross = float(np.linalg.norm(vector)), _cross(vector)
    # 1 - cos and angle - sin by series where they would cancel.
    first = 0.5 - angle**2 / 24.0 if angle < 1e-3 else (1.0 - np.cos(angle)) / angle**2
    second = 1.0 / 6.0 - angle**2 / 120.0 if angle < 1e-3 else (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


def _cross(vector: FloatArray) -> FloatArray:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def wrench(answer: Answer, tip: FloatArray) -> FloatArray:
    """Loads (6,) of the indenter on the tissue."""
    moment = answer.moment_Nmm + np.cross(tip, answer.force_N)
    return np.array([answer.force_N[2], -answer.force_N[0], -answer.force_N[1], *moment])


def wrench_rates(
    force_N: FloatArray, moment_Nmm: FloatArray, answer: Answer, tip: FloatArray, way: FloatArray
) -> FloatArray:
    """Change of the loads (..., 6) for changes of force and moment (..., 3) and of the position (..., 6)."""
    tips = np.stack([way[..., 1], way[..., 2], -way[..., 0]], axis=-1)
    moment = moment_Nmm + np.cross(tip, force_N) + np.cross(tips, answer.force_N)
    return np.concatenate([force_N[..., 2:], -force_N[..., :2], moment], axis=-1)


DEPTH = 0
"""Component of a position."""

HERTZ = 1.5
"""Exponent of the depth in the force of a round indenter."""


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """Target of a load step.

    Parameters
    ----------
    end : (6,) array
        Position to go to; of what a load moves, the farthest.
    share : (6,) array
        Share of the way from the state before to ``end`` that the step goes; 1 where it ends there.
    loads : (6,) array
        NaN where the position is prescribed; loads to be reached at ``end``; infinite for what stays.
    load_share : float
        Share of the way to the loads.
    deeper : float
        Derivative of the depth of ``end`` in the depth of the press.
    """

    end: FloatArray
    share: FloatArray
    loads: FloatArray
    load_share: float = 1.0
    time_s: float = 0.0
    deeper: float = 0.0

    @property
    def has_loads(self) -> bool:
        """Whether any load is to be reached."""
        return bool(np.isfinite(self.loads).any())

    def position(self, before: FloatArray) -> FloatArray:
        """Position (6,) to go to from the one before; that one for what a load moves, and what stays."""
        reached = np.where(self.share == 1.0, self.end, before + self.share * (self.end - before))
        return np.where(np.isnan(self.loads), reached, before)

    def loads_after(self, before: FloatArray) -> FloatArray:
        """Loads (6,) to be reached, from those before; NaN where none is."""
        result = np.where(np.isinf(self.loads), np.nan, before + self.load_share * (self.loads - before))
        force, end = float(before[0]), float(self.loads[0])
        if np.isfinite(end) and force >= 0.0 and end > 0.0 and self.load_share < 1.0:
            # In equal steps of depth, about.
            roots = force ** (1 / HERTZ), end ** (1 / HERTZ)
            result[0] = (roots[0] + self.load_share * (roots[1] - roots[0])) ** HERTZ
        return np.where(self.load_share == 1.0, np.where(np.isinf(self.loads), np.nan, self.loads), result)

    def kept_loads(self, before: FloatArray) -> FloatArray:
        """Derivative (6,) of ``loads_after`` in the loads before."""
        kept = np.full(6, 1.0 - self.load_share)
        after = self.loads_after(before)
        if before[0] > 0.0 and self.loads[0] > 0.0 and np.isfinite(after[0]):
            kept[0] *= (after[0] / before[0]) ** (1.0 - 1.0 / HERTZ)
        return kept


@dataclass(frozen=True, slots=True, eq=False)
class Aim:
    """Part of the way of a load step from a position and loads (6,) to its target.

    Parameters
    ----------
    position : (6,) array
    loads : (6,) array
        Those that move components of the position: NaN where none does.
    origin_loads : (6,) array
        At the beginning of the load step.
    part : float
        Share of the way, up to 1.
    """

    target: Target
    position: FloatArray
    loads: FloatArray
    origin_loads: FloatArray
    part: float

    @classmethod
    def at(cls, target: Target, origin: FloatArray, loads: FloatArray, part: float) -> "Aim":
        """Aim a part of the way."""
        end, end_loads = target.position(origin), target.loads_after(loads)
        if part < 1.0:
            end, end_loads = origin + part * (end - origin), loads + part * (end_loads - loads)
        return cls(target, end, end_loads, loads, part)

    def position_with(self, free: FloatArray) -> FloatArray:
        """Position (6,) with these values of the free components."""
        position = self.position.copy()
        position[self.free] = free
        return position

    @property
    def free(self) -> IntArray:
        """Components that a load moves."""
        return np.flatnonzero(~np.isnan(self.loads))

    @property
    def kept_position(self) -> FloatArray:
        """Derivative (6,) of the prescribed position in that at the beginning of the load step."""
        return np.where(np.isnan(self.target.loads), 1.0 - self.part * self.target.share, 1.0)

    @property
    def deeper(self) -> FloatArray:
        """Derivative (6,) of the prescribed position in the depth of the press, from a fixed beginning."""
        return np.asarray((1.0 - self.kept_position) * self.target.deeper * np.eye(6)[DEPTH])

    @property
    def kept_loads(self) -> FloatArray:
        """Derivative (6,) of the prescribed loads in those at the beginning of the load step."""
        return 1.0 - self.part + self.part * self.target.kept_loads(self.origin_loads)


@dataclass(frozen=True, slots=True, eq=False)
class Schedule:
    """Targets in the order travelled.

    Parameters
    ----------
    steps : (6,) array
        Largest step of each component of the position [mm, degrees].
    """

    targets: tuple[Target, ...]
    steps: FloatArray

    @property
    def has_loads(self) -> bool:
        """Whether any load is to be reached."""
        return any(target.has_loads for target in self.targets)

    @classmethod
    def through(cls, positions: FloatArray) -> "Schedule":
        """Go to positions (n, 6), each in one step."""
        none = np.full(6, np.nan)
        return cls(tuple(Target(at, np.ones(6), none) for at in positions), np.ones(6))


def schedule(
    protocol: Indentation, depth_steps: int, rotation_step_deg: float, fastest_s: float = 0.0
) -> Schedule:
    """Targets of a protocol, with its waypoints and without the rest.

    Shifts take steps of the depth's length, tilts of the rotation, and a load as many as the depth;
    a load that was not prescribed before takes all of them, as nobody knows by how much it changes. A dwell
    has steps where something relaxes, ``fastest_s`` being its shortest time constant.
    """
    depth_step_mm = max(float(protocol.path[:, 0].max()), 1e-9) / depth_steps
    steps = np.array([*[depth_step_mm] * 3, *[rotation_step_deg] * 3])
    waypoints = protocol.waypoints
    pose = waypoints.pose
    loads = np.full(pose.shape, np.nan) if waypoints.loads is None else waypoints.loads
    times = np.zeros(len(pose)) if waypoints.time_s is None else waypoints.time_s
    largest = np.where(np.isfinite(loads), np.abs(loads), 0.0).max(axis=0)
    lowest = -np.abs(pose)
    lowest[:, DEPTH] = np.minimum(0.0, pose[:, DEPTH])
    targets: list[Target] = []
    for k in range(1, len(pose)):
        given = np.isnan(loads[k])
        known = given & np.isnan(loads[k - 1])
        n = max(
            _count(_farthest(pose[k], lowest[k - 1], pose[k - 1], known)[given] / steps[given]),
            _count(depth_steps * _changes(loads[k - 1], loads[k], largest)),
        )
        moments = times[k - 1] + (times[k] - times[k - 1]) * np.arange(1, max(n, 1) + 1) / max(n, 1)
        if n == 0 and fastest_s > 0.0:
            moments = dwell_times(times[k - 1], times[k], fastest_s)
        targets += _between(pose[k - 1 : k + 1], loads[k], known, moments)
    return Schedule(tuple(targets), steps)


def _count(change: FloatArray) -> int:
    return int(np.ceil(change.max(initial=0.0) - 1e-9))


def _farthest(to: FloatArray, lowest: FloatArray, highest: FloatArray, known: BoolArray) -> FloatArray:
    """Longest ways (6,) to a place, from ``highest`` where it is known, else from anywhere in the limits."""
    return np.where(known, np.abs(to - highest), np.maximum(np.abs(to - lowest), np.abs(to - highest)))


def _changes(before: FloatArray, after: FloatArray, largest: FloatArray) -> FloatArray:
    """Changes (6,) of loads as shares of the largest; 1 where none was prescribed before."""
    is_known, sizes = np.isfinite(before), np.where(largest > 0.0, largest, 1.0)
    changed = np.abs(after - np.where(is_known, before, 0.0)) / sizes
    return np.where(np.isfinite(after), np.where(is_known, changed, 1.0), 0.0)


def _between(ends: FloatArray, loads: FloatArray, known: BoolArray, times: FloatArray) -> Iterator[Target]:
    """Targets at times (n,) up to the next waypoint; what is not ``known`` at the first goes by shares."""
    n = len(times)
    between = ends[0] + (ends[1] - ends[0]) * np.arange(1, n + 1)[:, None] / n
    between[-1] = ends[1]  # to the last bit, so that no branch starts next to a waypoint
    first, last = (float(end > 0.0) for end in ends[:, DEPTH])
    deeper = np.linspace(first, last, n + 1)[1:] if known[DEPTH] else np.full(n, last)
    for j in range(n):
        share = 1.0 / (n - j)
        yield Target(
            end=np.where(known, between[j], ends[1]),
            share=np.where(known, 1.0, share),
            loads=loads,
            load_share=share,
            time_s=float(times[j]),
            deeper=float(deeper[j]),
        )
