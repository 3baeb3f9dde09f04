"""Bias of the sensor, from rows in free air."""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray, IntArray
from palpate_robot_log.processing.noise import correlation_factor
from palpate_robot_log.recording import Recording

FEWEST_ROWS = 10
"""Rows in free air that are needed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bias:
    """Constant part of the wrench at the log's first instant, in the sensor's frame; arrays (3,)."""

    force_N: FloatArray
    moment_Nmm: FloatArray
    force_std_N: FloatArray
    moment_std_Nmm: FloatArray
    n_rows: int


def find_bias(recording: Recording, free: IntArray) -> Bias:
    """Mean wrench over rows in free air, once weight and drift are out.

    Raises
    ------
    CurveError
        There are too few rows in free air.
    """
    if free.size < FEWEST_ROWS:
        raise recording.fault(
            f"{free.size} rows in free air before the press, so the bias cannot be determined; start "
            "the log earlier, or give tare.enabled = false",
            0,
        )
    force, force_std = _mean(recording.force_N[free])
    moment, moment_std = _mean(recording.moment_Nmm[free])
    return Bias(
        force_N=force,
        moment_Nmm=moment,
        force_std_N=force_std,
        moment_std_Nmm=moment_std,
        n_rows=int(free.size),
    )


def tared(recording: Recording, bias: Bias) -> Recording:
    """Wrench without a bias."""
    return recording.less(bias.force_N, bias.moment_Nmm)


def _mean(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    mean = values.mean(axis=0)
    factors = np.array([correlation_factor(column) for column in (values - mean).T])
    std: FloatArray = factors * values.std(axis=0, ddof=1) / np.sqrt(values.shape[0])
    return mean, std
