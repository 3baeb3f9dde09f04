"""How often relaxation is flagged in simulated logs of a robot: ``make relaxation``.

The elastic curves are those of the simulated forearm, the logs those of ``simulated_robot.py``, with bias,
drift, weight and noise. They are read and processed as a study's are, and the worst rest is compared with the
default budget. No finite elements are run.
"""

import sys
import tempfile
from collections.abc import Callable, Iterable
from functools import cache, partial
from pathlib import Path

import numpy as np
from simulated_robot import RATE_HZ, REST_S, SPEED_MM_S, write_log

from palpate.domain import Curve, FloatArray, Response
from palpate.experiment.relaxation import LargestRelaxation, relaxation_of
from palpate.study.model import BudgetTable
from palpate_robot_log import RobotLogLoader, RobotLogSettings

DATA = Path(__file__).parents[1] / "plugins/palpate-robot-log/tests/data/robot_logs"
SPOTS = ("p1", "p2", "p3", "p4")
SETTINGS = {
    "channels": {
        "time": "time_s",
        "position": {"columns": ["x_m", "y_m", "z_m"]},
        "orientation": {"columns": ["qx", "qy", "qz", "qw"]},
        "force": {"columns": ["fx_N", "fy_N", "fz_N"]},
        "moment": {"columns": ["tx_Nm", "ty_Nm", "tz_Nm"]},
    },
    "gravity": {"method": "known", "weight": "0.88 N", "centre": ["0 mm", "0 mm", "-30 mm"]},
}
FALLS = 0.05, 0.20
"""Bounds of the fall in the first rest, over the force where it starts."""
TIMES_S = 0.1, 10.0
"""Bounds of the time constant."""
FAST_MM_S, SLOW_MM_S = 10.0, 0.5
"""Speeds at which the press takes 1 and 20 s."""

Relaxed = Callable[[FloatArray, FloatArray], FloatArray]


@cache
def elastic(spot: str) -> Response:
    """Curves of a spot, by another solver."""
    clean = np.genfromtxt(DATA / f"clean_{spot}.csv", delimiter=",", names=True)
    twist = int(np.flatnonzero(clean["angle_deg"])[0]) - 1
    force = Curve(
        channel="force", abscissa=clean["depth_mm"][: twist + 1], ordinate=clean["force_N"][: twist + 1]
    )
    torque = Curve(
        channel="torque", abscissa=clean["angle_deg"][twist:], ordinate=clean["torque_Nmm"][twist:]
    )
    return Response(curves={"force": force, "torque": torque})


def by_history(time_s: FloatArray, values: FloatArray, share: float, tau_s: float) -> FloatArray:
    """Values (n,) by quasi-linear viscoelasticity: increments relax by ``share`` with one time constant."""
    step = float(np.exp(-1.0 / (RATE_HZ * tau_s)))
    left, found = 0.0, np.empty_like(values)
    for row, change in enumerate(np.diff(values, prepend=values[0])):
        left = found[row] = step * left + np.sqrt(step) * change
    return (1.0 - share) * values + share * found


def by_time(time_s: FloatArray, values: FloatArray, share: float) -> FloatArray:
    """Values (n,) that all fall by ``share`` with a time constant of 1 s since first contact."""
    return values * (1.0 - share * (1.0 - np.exp(-time_s)))


def share_of(fall: float, tau_s: float, spot: str) -> float:
    """Share that makes the force fall so far in the first rest."""
    force = elastic(spot)["force"]
    n_press, n_rest = round(force.abscissa.max() / SPEED_MM_S * RATE_HZ), round(REST_S * RATE_HZ)
    depth = np.concatenate(
        [np.linspace(0.0, force.abscissa.max(), n_press), np.full(n_rest, force.abscissa.max())]
    )
    values = np.interp(depth, force.abscissa, force.ordinate)
    left = by_history(depth, values, 1.0, tau_s)
    start, end, peak = left[n_press - 1], left[-1], values[-1]
    return float(fall * peak / (start - end + fall * (peak - start)))


def found_in(
    folder: Path, seed: int, relaxed: Relaxed | None, speed_mm_s: float = SPEED_MM_S
) -> LargestRelaxation:
    """Worst rest of a log that is written and read."""
    spot, path = spot_of(seed), folder / f"{seed}.parquet"
    write_log(path, elastic(spot), seed, relaxed=relaxed, speed_mm_s=speed_mm_s)
    response = RobotLogLoader(RobotLogSettings.model_validate(SETTINGS)).load(path)
    found = relaxation_of({spot: response}, BudgetTable().gain)
    assert found is not None, "a log without rests"
    return found


def spot_of(seed: int) -> str:
    """Spot of a log."""
    return SPOTS[seed % len(SPOTS)]


def drawn(seed: int) -> tuple[float, float, float]:
    """Fall, time constant and share of a tissue that relaxes."""
    random = np.random.default_rng([7, seed])
    fall = random.uniform(*FALLS)
    while True:  # a fast relaxation may be over before the rest
        tau_s = float(np.exp(random.uniform(*np.log(TIMES_S))))
        if 0.0 < (share := share_of(fall, tau_s, spot_of(seed))) < 0.8:
            return fall, tau_s, share


def report(what: str, found: Iterable[LargestRelaxation]) -> None:
    """Print the worst rest of each log, and how many were flagged."""
    rests = list(found)
    for each in rests:
        std = each.share * each.rest.fall_std / each.rest.fall
        size = f"{100 * each.share:.2f} ± {100 * std:.2f} % of the {each.rest.channel}"
        sys.stdout.write(f"  {size} in {each.rest.phase}{', flagged' if each.is_beyond else ''}\n")
    sys.stdout.write(f"{what}: {sum(each.is_beyond for each in rests)} of {len(rests)} flagged\n")
    sys.stdout.flush()


def main() -> None:
    """Report logs with and without relaxation."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        known = [(seed, *drawn(seed)) for seed in range(20)]
        of_known = (found_in(folder, k, partial(by_history, share=v, tau_s=tau)) for k, _, tau, v in known)
        report("5 to 20 % in the rest", of_known)
        report("no relaxation", (found_in(folder, seed, None) for seed in range(20, 40)))
        of_time, of_history = partial(by_time, share=0.1), partial(by_history, share=0.1, tau_s=1.0)
        for what, relaxed, speed_mm_s in (
            ("10 % in all by time, press of 1 s", of_time, FAST_MM_S),
            ("10 % in all by history, press of 1 s", of_history, FAST_MM_S),
            ("10 % in all by history, press of 5 s", of_history, SPEED_MM_S),
            ("10 % in all by history, press of 20 s", of_history, SLOW_MM_S),
        ):
            report(what, (found_in(folder, seed, relaxed, speed_mm_s) for seed in range(40, 50)))


if __name__ == "__main__":
    main()
