"""A press whose truth is known, in the columns of robots' and machines' loggers.

10 mm deep at 2.5 mm/s along -z of the base, 0.4 N/mm^1.5 (12.65 N), and a twist of ±22.5 degrees that the
tissue resists by 2.2 N·mm a degree, up to 25 N·mm. The tool points down: its frame is turned about x.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.domain import FloatArray

Table = dict[str, FloatArray]
FORCE_N, DEPTH_MM, TORQUE_NMM = 12.65, 10.0, 25.0


@dataclass(frozen=True)
class Press:
    """Time [s], tip [mm], pose, and the wrench of the tissue on the tool in the tool's frame [N, N·m]."""

    time_s: FloatArray
    tip_mm: FloatArray
    pose: Rotation
    force_N: FloatArray
    moment_Nm: FloatArray
    commanded_mm: FloatArray


def _ramp(begin: float, end: float, n_rows: int) -> FloatArray:
    share = np.linspace(0.0, 1.0, n_rows + 1)[1:]
    speed = np.clip(np.minimum(share, 1.0 - share) / 0.06, 0.0, 1.0)
    way = np.cumsum(speed) / speed.sum()
    return np.asarray(begin + (end - begin) * way)


def press(
    rate_hz: float = 25.0, *, twist: bool = False, retract: bool = True, tilt_deg: float = 0.0, seed: int = 3
) -> Press:
    """A press of the module's truth, with noise."""
    rng = np.random.default_rng(seed)

    def rows(seconds: float) -> int:
        return round(seconds * rate_hz)

    moves = [(3.0, 3.0, 0.0, 0.0, 1.2), (3.0, -10.0, 0.0, 0.0, 5.2), (-10.0, -10.0, 0.0, 0.0, 1.5)]
    if twist:
        angles = [(0.0, -22.5, 3.0), (-22.5, 22.5, 6.0), (22.5, 0.0, 3.0), (0.0, 0.0, 0.8)]
        moves += [(-10.0, -10.0, a, b, seconds) for a, b, seconds in angles]
    moves += [(-10.0, 3.0, 0.0, 0.0, 5.2), (3.0, 3.0, 0.0, 0.0, 1.2)] if retract else []
    z = np.concatenate([_ramp(a, b, rows(seconds)) for a, b, _, _, seconds in moves])
    turn = np.concatenate([_ramp(a, b, rows(seconds)) for _, _, a, b, seconds in moves])
    depth = np.clip(-z, 0.0, None)
    torque = np.zeros(z.size)
    for i in range(1, z.size):  # sticks, then slips
        stuck = torque[i - 1] + 2.2 * (turn[i] - turn[i - 1])
        torque[i] = np.clip(stuck, -TORQUE_NMM, TORQUE_NMM) if depth[i] > 5.0 else 0.0
    pose = Rotation.from_euler("y", tilt_deg, degrees=True) * (
        Rotation.from_euler("x", 180.0, degrees=True) * Rotation.from_euler("z", turn[:, None], degrees=True)
    )
    # The tool's z is inward: the tissue pushes against it, and resists a turn about it.
    inward = pose.apply([0.0, 0.0, 1.0])
    tip = np.array([400.0, 100.0, 200.0]) - z[:, None] * inward
    force, moment = np.array([0.1, -0.05, 0.3]), np.array([2e-3, -1e-3, 5e-4])
    size = 0.4 * depth**1.5
    return Press(
        time_s=np.arange(z.size) / rate_hz,
        tip_mm=tip + rng.normal(0.0, 1e-3, tip.shape),
        pose=pose,
        force_N=force - size[:, None] * [0.0, 0.0, 1.0] + rng.normal(0.0, 0.015, tip.shape),
        moment_Nm=moment - 1e-3 * torque[:, None] * [0.0, 0.0, 1.0] + rng.normal(0.0, 2e-4, tip.shape),
        # The arm yields by 0.04 mm/N.
        commanded_mm=tip + 0.04 * size[:, None] * inward,
    )


def named(names: str, *values: FloatArray) -> Table:
    return dict(zip(names.split(), np.column_stack(values).T, strict=True))


def robot(made: Press) -> Table:
    """Pose and wrench without a time."""
    names = "x_mm y_mm z_mm qx qy qz qw fx_N fy_N fz_N tx_Nm ty_Nm tz_Nm"
    return named(names, made.tip_mm, made.pose.as_quat(), made.force_N, made.moment_Nm)


def wrench(made: Press, names: str = "Fx Fy Fz Mx My Mz") -> Table:
    return named(names, made.force_N, made.moment_Nm)
