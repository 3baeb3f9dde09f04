"""Reading a log of a million rows, next to what a script would do: ``make bench-logs``.

Ours includes the process of its own, the channel map, every check and the conversion of
units. The peers only parse: polars the same file, ``numpy.loadtxt`` a twentieth of it.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl

from palpate_robot_log.reading.assembly import read_recording
from palpate_robot_log.reading.channel_map import ChannelMap

N_ROWS, N_ROUNDS, SHARE = 1_000_000, 3, 20
CHANNELS = {
    "time": "time_s",
    "position": {"columns": ["x_m", "y_m", "z_m"]},
    "orientation": {"columns": ["qx", "qy", "qz", "qw"]},
    "force": {"columns": ["fx_N", "fy_N", "fz_N"]},
    "moment": {"columns": ["tx_Nm", "ty_Nm", "tz_Nm"]},
}


def log(n_rows: int) -> pl.DataFrame:
    """A press and a twist at 20 kHz, with noise."""
    rng = np.random.default_rng(1)
    way = np.linspace(-0.004, 0.010, n_rows)
    angle = np.sin(np.linspace(0.0, 6.0, n_rows))
    columns = {"time_s": np.arange(n_rows) / 2e4, "x_m": 0.4 + 0.1 * way, "y_m": 0.2 * way, "z_m": 0.3 - way}
    columns |= {"qx": np.cos(angle / 2.0), "qy": 0.0 * way, "qz": np.sin(angle / 2.0), "qw": 0.0 * way}
    for name in ("fx_N", "fy_N", "fz_N"):
        columns[name] = -800.0 * np.clip(way, 0.0, None) + 0.04 * rng.standard_normal(n_rows)
    for name in ("tx_Nm", "ty_Nm", "tz_Nm"):
        columns[name] = 0.02 * angle + 2.5e-4 * rng.standard_normal(n_rows)
    return pl.DataFrame({name: np.round(values, 7) for name, values in columns.items()})


def seconds(run: Callable[[], object]) -> float:
    """Least time on the clock of several rounds."""
    times = []
    for _ in range(N_ROUNDS):
        started_at = time.perf_counter()
        run()
        times.append(time.perf_counter() - started_at)
    return min(times)


def main() -> None:
    channels = ChannelMap.model_validate(CHANNELS)
    with tempfile.TemporaryDirectory() as folder:
        whole, part = Path(folder, "log.csv"), Path(folder, "part.csv")
        frame = log(N_ROWS)
        frame.write_csv(whole)
        frame.head(N_ROWS // SHARE).write_csv(part)
        ours = seconds(lambda: read_recording(whole, channels))
        peers = {
            "polars.read_csv": seconds(lambda: pl.read_csv(whole)),
            "numpy.loadtxt": SHARE * seconds(lambda: np.loadtxt(part, delimiter=",", skiprows=1)),
        }
    sys.stdout.write(f"{N_ROWS} rows, 14 columns: {ours:.2f} s, {N_ROWS / ours:.0f} rows/s\n")
    for name, peer in peers.items():
        sys.stdout.write(f"{name:<20}{peer:>8.2f} s{peer / ours:>8.2f}\n")


if __name__ == "__main__":
    main()
