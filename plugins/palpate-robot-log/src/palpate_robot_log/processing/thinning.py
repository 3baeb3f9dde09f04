"""Averages of neighbouring rows, for logs with far more rows than a press needs."""

import numpy as np

from palpate.api import FloatArray
from palpate_robot_log.processing.rotation import continuous
from palpate_robot_log.recording import Recording


def block_means(values: FloatArray, block: int) -> FloatArray:
    """Means of ``block`` successive rows (n // block, …); rows left over at the end are dropped."""
    if block == 1:
        return values
    n_blocks = values.shape[0] // block
    means: FloatArray = values[: n_blocks * block].reshape(n_blocks, block, -1).mean(axis=1)
    return means.reshape(n_blocks, *values.shape[1:])


def thinned(recording: Recording, max_rows: int) -> tuple[Recording, int]:
    """Recording of at most ``max_rows`` rows, and how many rows each of them averages."""
    block = -(-recording.n_rows // max_rows)
    if block == 1:
        return recording, 1
    fields = ("time_s", "position_mm", "force_N", "moment_Nmm")
    means = {name: block_means(getattr(recording, name), block) for name in fields}
    quaternion = block_means(continuous(recording.quaternion), block)
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    rows = recording.rows[::block][: quaternion.shape[0]]
    return recording.changed(quaternion=quaternion, rows=rows, **means), block
