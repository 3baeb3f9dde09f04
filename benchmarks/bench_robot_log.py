"""A robot's log of a million rows, from file to curves, next to one that only parses: ``make bench-logs``.

Ours includes the process of its own, every check, all steps and their record. The peer is
``polars.read_csv`` of the same file, in the same run.
"""

import os
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl

from palpate.domain import FloatArray
from palpate_robot_log import RobotLogLoader, RobotLogSettings

N_ROWS, N_ROUNDS = 1_000_000, 3
SETTINGS = {
    "channels": {
        "time": "time_s",
        "position": {"columns": ["x_m", "y_m", "z_m"]},
        "orientation": {"columns": ["qx", "qy", "qz", "qw"]},
        "force": {"columns": ["fx_N", "fy_N", "fz_N"]},
        "moment": {"columns": ["tx_Nm", "ty_Nm", "tz_Nm"]},
    }
}
DATA = Path(__file__).parents[1] / "plugins/palpate-robot-log/tests/data/robot_logs" / "robot_p1.npz"
NOISE = {"x_m": 5e-6, "y_m": 5e-6, "z_m": 5e-6, "fx_N": 0.04, "fy_N": 0.04, "fz_N": 0.04} | dict.fromkeys(
    ("tx_Nm", "ty_Nm", "tz_Nm"), 2.5e-4
)


def log(n_rows: int) -> pl.DataFrame:
    """The simulated log of spot p1 at 27 kHz, with noise of its own in every row."""
    with np.load(DATA) as stored:
        names = [name for name in stored.files if name != "decimals"]
        columns: dict[str, FloatArray] = {
            name: np.cumsum(stored[name], dtype=np.int64) / 10.0**decimals
            for name, decimals in zip(names, stored["decimals"], strict=True)
        }
    random = np.random.default_rng(1)
    time_s = np.linspace(0.0, columns["time_s"][-1], n_rows)
    dense = {name: np.interp(time_s, columns["time_s"], values) for name, values in columns.items()}
    for name, noise in NOISE.items():
        dense[name] += random.normal(0.0, noise, n_rows)
    return pl.DataFrame(dense)


def seconds(run: Callable[[], object]) -> tuple[float, float]:
    """Least time on the clock and least processor time of several rounds, children included."""
    rounds = []
    for _ in range(N_ROUNDS):
        started_s, used = time.perf_counter(), _processor_s()
        run()
        rounds.append((time.perf_counter() - started_s, _processor_s() - used))
    return min(clock for clock, _ in rounds), min(used for _, used in rounds)


def _processor_s() -> float:
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def main() -> None:
    loader = RobotLogLoader(RobotLogSettings.model_validate(SETTINGS))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "log.csv")
        log(N_ROWS).write_csv(path, float_precision=7)
        ours = seconds(lambda: loader.load(path))
        peer = seconds(lambda: pl.read_csv(path))
    sys.stdout.write(
        f"a log of {N_ROWS:,} rows to curves: {ours[0]:.2f} s on the clock, {ours[1]:.2f} s of processor\n"
        f"polars.read_csv of the same file: {peer[0]:.2f} s on the clock, {peer[1]:.2f} s of processor "
        f"(ours takes {ours[1] / peer[1]:.1f} times its processor time; load {os.getloadavg()[0]:.1f})\n"
    )


if __name__ == "__main__":
    main()
