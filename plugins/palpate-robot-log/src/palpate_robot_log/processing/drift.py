"""Drift of the sensor: a straight line through the rows in free air before and after the press."""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray, IntArray
from palpate_robot_log.recording import Recording

FEWEST_ROWS = 10
"""Rows in free air that are needed before and after the press."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drift:
    """Change of the bias per second, in the sensor's frame; arrays (3,)."""

    force_N_per_s: FloatArray
    moment_Nmm_per_s: FloatArray
    force_std_N_per_s: FloatArray
    moment_std_Nmm_per_s: FloatArray


def find_drift(recording: Recording, before: IntArray, after: IntArray) -> Drift:
    """Least-squares slope of the wrench over time.

    Parameters
    ----------
    recording : Recording
        Without the tool's weight, unless the tool is oriented alike in all these rows.
    before, after : (n,) array of row indices
        In free air.

    Raises
    ------
    CurveError
        There are no rows in free air after the press.
    """
    if before.size < FEWEST_ROWS:
        raise recording.fault(
            f"{before.size} rows in free air before the press; start the log earlier, so that the sensor's "
            "drift and bias can be determined, or give drift.enabled = false",
            0,
        )
    if after.size < FEWEST_ROWS:
        raise recording.fault(
            f"the log stops before the tool is clear of the limb ({after.size} rows in free air after the "
            "press), so the sensor's drift cannot be determined; log until the tool is clear, or give "
            "drift.enabled = false",
            recording.n_rows - 1,
        )
    free = np.concatenate([before, after])
    time = recording.time_s[free] - recording.time_s[free].mean()
    force, force_std = _slope(time, recording.force_N[free])
    moment, moment_std = _slope(time, recording.moment_Nmm[free])
    return Drift(
        force_N_per_s=force,
        moment_Nmm_per_s=moment,
        force_std_N_per_s=force_std,
        moment_std_Nmm_per_s=moment_std,
    )


def without_drift(recording: Recording, drift: Drift) -> Recording:
    """Wrench as if the bias had stayed what it was at the first instant."""
    elapsed = (recording.time_s - recording.time_s[0])[:, None]
    return recording.less(elapsed * drift.force_N_per_s, elapsed * drift.moment_Nmm_per_s)


def _slope(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    power = float(time @ time)
    slope: FloatArray = time @ values / power
    residual = values - values.mean(axis=0) - time[:, None] * slope
    std: FloatArray = residual.std(axis=0) / np.sqrt(power)
    return slope, std
