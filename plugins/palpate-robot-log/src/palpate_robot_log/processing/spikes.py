"""Spikes in the wrench: single rows far off their neighbours, as of a lost bit or a radio burst."""

import numpy as np
from scipy.ndimage import median_filter

from palpate.api import BoolArray, FloatArray, IntArray
from palpate_robot_log.processing.noise import noise_std
from palpate_robot_log.recording import Recording

NOISE_MULTIPLE = 8.0
"""Standard deviations of the noise by which a spike exceeds its neighbours."""

RANGE_SHARE = 0.02
"""Least share of a channel's range by which it exceeds them, where the noise is less than a digit."""

LARGEST_SHARE = 0.01
"""Share of rows with spikes beyond which a log is refused."""

_NEIGHBOURS = 5


def without_spikes(recording: Recording) -> tuple[Recording, IntArray]:
    """Wrench with spikes replaced by the median of their neighbours, and the rows that had one.

    Raises
    ------
    CurveError
        More than a hundredth of the rows has one.
    """
    force, force_hit = _repaired(recording.force_N)
    moment, moment_hit = _repaired(recording.moment_Nmm)
    hit = np.flatnonzero(force_hit | moment_hit)
    if hit.size > LARGEST_SHARE * recording.n_rows:
        raise recording.fault(
            f"{hit.size} of {recording.n_rows} rows have a spike in force or moment; check the "
            "sensor's cable and range, or give spikes.enabled = false",
            int(hit[0]),
        )
    return (recording.changed(force_N=force, moment_Nmm=moment) if hit.size else recording), hit


def _repaired(values: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Columns (n, 3) with their spikes replaced, and which rows had one."""
    middle = median_filter(values, size=(_NEIGHBOURS, 1), mode="mirror")
    # A range without the spikes themselves.
    spans = np.ptp(middle, axis=0)
    noises = np.array([noise_std(column) for column in values.T])
    least = np.maximum(NOISE_MULTIPLE * noises, RANGE_SHARE * spans)
    off: BoolArray = np.abs(values - middle) > np.maximum(least, 1e-300)
    hit: BoolArray = np.any(off, axis=1)
    return np.where(off, middle, values), hit
