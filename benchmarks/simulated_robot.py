"""A robot with a six-axis sensor at its tool that logs a press of which the curves are known.

Free air, the press, a rest, the twist, a rest, and back, along a normal that no column gives. The sensor
has a bias, a slow drift, noise and the tool's weight, as in the study ``robot-log``, whose columns these are.
"""

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import polars as pl
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

from palpate.domain import Curve, FloatArray, Response

RATE_HZ = 100.0
SPEED_MM_S, SPEED_DEG_S = 2.0, 3.75
CLEARANCE_MM, REST_S = 4.0, 1.0
WEIGHT_N, CENTRE_MM = 0.88, np.array([0.0, 0.0, -30.0])
NOISE = np.array([0.04, 0.04, 0.04, 0.25, 0.25, 0.25])
"""Standard deviations of force [N] and moment [N·mm] in each row."""
BIAS = np.array([0.4, 0.4, 0.4, 8.0, 8.0, 8.0])
DRIFT_PER_S = np.array([0.002, 0.002, 0.002, 0.04, 0.04, 0.04])
"""Bounds of both, from which they are drawn evenly."""


def write_log(
    path: Path,
    response: Response,
    seed: int,
    *,
    speed_mm_s: float = SPEED_MM_S,
    relaxed: Callable[[FloatArray, FloatArray], FloatArray] | None = None,
) -> None:
    """Log a press of these curves, smooth between their points, as a Parquet file.

    ``relaxed`` makes force and torque (n,) of a tissue that relaxes of the elastic ones and of the time
    since first contact [s].
    """
    random = np.random.default_rng(seed)
    force, torque = response["force"], response["torque"]
    depth, angle = _motion(force, torque, speed_mm_s)
    press = PchipInterpolator(force.abscissa, force.ordinate)
    pressing = np.where(depth > 0.0, press(np.maximum(depth, 0.0)), 0.0)
    twisting = _twisting(torque, angle) * pressing / pressing.max()  # what is left goes with the force
    time = np.arange(depth.size) / RATE_HZ
    if relaxed is not None:
        since, touching = np.maximum(time - time[np.argmax(depth > 0.0)], 0.0), pressing > 0.0
        pressing, twisting = (relaxed(since, each) * touching for each in (pressing, twisting))
        pressing = np.maximum(pressing, 0.0)
    write_rows(path, depth, angle, pressing, twisting, random)


def write_rows(
    path: Path,
    depth: FloatArray,
    angle: FloatArray,
    force: FloatArray,
    torque: FloatArray,
    random: np.random.Generator,
) -> None:
    """Log depth [mm], rotation [degrees], force [N] and torque [N·mm] (n,) in every row."""
    time = np.arange(depth.size) / RATE_HZ
    normal = random.normal(size=3) * 0.5 + np.array([0.0, 0.0, 1.0])
    normal /= np.linalg.norm(normal)
    start = _tool_against(normal) * Rotation.from_euler("z", random.uniform(0.0, 360.0), degrees=True)
    turned = Rotation.from_rotvec(np.radians(angle)[:, None] * normal) * start
    down = WEIGHT_N * turned.inv().apply([0.0, 0.0, -1.0])
    bias, drift = (bound * random.uniform(-1.0, 1.0, 6) for bound in (BIAS, DRIFT_PER_S))
    wrench = np.hstack(
        [
            turned.inv().apply(force[:, None] * normal) + down,
            turned.inv().apply(-torque[:, None] * normal) + np.cross(CENTRE_MM, down),
        ]
    )
    wrench += bias + drift * time[:, None] + NOISE * random.normal(size=wrench.shape)
    tip = random.uniform(-0.5, 0.5, 3) - 1e-3 * depth[:, None] * normal
    table = np.hstack([time[:, None], tip, turned.as_quat(), wrench[:, :3], 1e-3 * wrench[:, 3:]])
    names = ("time_s", *("x_m", "y_m", "z_m"), *("qx", "qy", "qz", "qw"))
    names += ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")
    pl.DataFrame(table, schema=list(names)).write_parquet(path)


def _motion(force: Curve, torque: Curve, speed_mm_s: float) -> tuple[FloatArray, FloatArray]:
    """Depth [mm] and rotation [degrees] in every row."""
    deepest = float(force.abscissa.max())
    turns = torque.abscissa[_turning(torque.abscissa)]
    down = _ramp([-CLEARANCE_MM, deepest], speed_mm_s)
    rest = np.full(round(REST_S * RATE_HZ), deepest)
    turn = _ramp(turns, SPEED_DEG_S)
    depth = np.concatenate([down, rest, np.full(turn.size, deepest), rest, down[::-1]])
    before = np.full(down.size + rest.size, turns[0])
    return depth, np.concatenate([before, turn, np.full(down.size + rest.size, turns[-1])])


def _ramp(ends: Sequence[float] | FloatArray, speed: float) -> FloatArray:
    """From each value to the next at constant speed."""
    parts = [
        np.linspace(a, b, round(abs(b - a) / speed * RATE_HZ), endpoint=False)
        for a, b in itertools.pairwise(ends)
    ]
    return np.concatenate([*parts, [ends[-1]]])


def _turning(values: FloatArray) -> list[int]:
    """First, last, and the points where the path turns back."""
    steps = np.sign(np.diff(values))
    return [0, *(np.flatnonzero(steps[1:] != steps[:-1]) + 1), len(values) - 1]


def _twisting(torque: Curve, angle: FloatArray) -> FloatArray:
    """Torque in every row, branch by branch; that of the ends before and after the twist."""
    x, y = torque.abscissa, torque.ordinate
    found, rows = np.full(angle.size, y[0]), [int(np.argmax(angle != angle[0])) - 1]
    for first, last in itertools.pairwise(_turning(x)):
        sense = np.sign(x[last] - x[first])
        branch = PchipInterpolator(sense * x[first : last + 1], y[first : last + 1])
        stop = rows[-1] + int(np.argmax(sense * angle[rows[-1] :] >= sense * x[last] - 1e-9))
        found[rows[-1] : stop + 1] = branch(sense * angle[rows[-1] : stop + 1])
        rows.append(stop)
    found[rows[-1] :] = y[-1]
    return found


def _tool_against(normal: FloatArray) -> Rotation:
    """An orientation whose z axis points along −normal."""
    turn, _ = Rotation.align_vectors(-normal[None, :], np.array([[0.0, 0.0, 1.0]]))
    return turn
