"""The four simulated logs of a robot, and what is known about them."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from palpate.domain import FloatArray
from palpate_robot_log.processing.chain import Processed, process
from palpate_robot_log.processing.settings import ProcessingSettings
from palpate_robot_log.recording import Recording

FOLDER = Path(__file__).parent / "data" / "robot_logs"
SPOTS = ("p1", "p2", "p3", "p4")
WEIGHT = {"method": "known", "weight": "0.88 N", "centre": ["0 mm", "0 mm", "-30 mm"]}
"""The tool of the logs: 0.88 N, its centre 30 mm behind the tip."""

STARTS_S = {
    "approach": 0.0,
    "press": 0.5,
    "dwell_1": 5.5,
    "twist_1": 6.5,
    "twist_2": 12.5,
    "twist_3": 24.5,
    "dwell_2": 30.5,
    "retract": 31.0,
    "departure": 36.0,
}
"""Contact at 0.5 s, press 5 s, dwell 1 s, twist 24 s, dwell 0.5 s, retract 5 s."""


@dataclass(frozen=True)
class Truth:
    """What made a log."""

    normal: FloatArray
    spot_mm: FloatArray
    force_bias_N: FloatArray
    moment_bias_Nmm: FloatArray
    force_drift_N_per_s: FloatArray
    moment_drift_Nmm_per_s: FloatArray
    clean: Any


def columns(spot: str) -> dict[str, FloatArray]:
    """Columns of a log, in the units of their names."""
    with np.load(FOLDER / f"robot_{spot}.npz") as stored:
        names = [name for name in stored.files if name != "decimals"]
        decimals = dict(zip(names, stored["decimals"], strict=True))
        return {name: np.cumsum(stored[name], dtype=np.int64) / 10.0 ** decimals[name] for name in names}


@cache
def recording(spot: str) -> Recording:
    """A log in palpate's units."""
    column = columns(spot)

    def stacked(*names: str) -> FloatArray:
        return np.stack([column[name] for name in names], axis=1)

    quaternion = stacked("qx", "qy", "qz", "qw")
    return Recording(
        source=f"robot_{spot}.csv",
        time_s=column["time_s"],
        position_mm=1e3 * stacked("x_m", "y_m", "z_m"),
        quaternion=quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
        force_N=stacked("fx_N", "fy_N", "fz_N"),
        moment_Nmm=1e3 * stacked("tx_Nm", "ty_Nm", "tz_Nm"),
        rows=np.arange(2, column["time_s"].size + 2),
    )


def settings(**steps: Any) -> ProcessingSettings:
    """Settings with the tool's weight, and what else is given."""
    return ProcessingSettings.model_validate({"gravity": WEIGHT} | steps)


@cache
def processed(spot: str) -> Processed:
    """A log after all steps."""
    return process(recording(spot), settings())


def truth(spot: str) -> Truth:
    """The simulated answer, and the frame, bias and drift of the log."""
    reported = json.loads((FOLDER / "truth.json").read_text(encoding="utf-8"))["spots"][spot]
    bias, drift = np.array(reported["bias_N_Nm"]), np.array(reported["drift_per_s"])
    return Truth(
        normal=np.array(reported["normal_base"]),
        spot_mm=1e3 * np.array(reported["spot_base_m"]),
        force_bias_N=bias[:3],
        moment_bias_Nmm=1e3 * bias[3:],
        force_drift_N_per_s=drift[:3],
        moment_drift_Nmm_per_s=1e3 * drift[3:],
        clean=np.genfromtxt(FOLDER / f"clean_{spot}.csv", delimiter=",", names=True),
    )
