"""One press as a robot logged it, in palpate's units, and what every step does with its signals.

Orientations are unit quaternions (x, y, z, w), one a row.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.api import CurveError, FloatArray, IntArray

_SIGNALS = ("time_s", "position_mm", "quaternion", "force_N", "moment_Nmm", "rows")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """Pose and wrench over time, all at the same instants, read-only; checked where they are read.

    The file, what its rows are called, and the side and frame that the wrench had in it are for messages.
    """

    source: str
    time_s: FloatArray  # (n,), strictly increasing
    position_mm: FloatArray  # (n, 3), tool tip in the base frame
    quaternion: FloatArray  # (n, 4), from the tool (and sensor) frame to the base frame, of length 1
    force_N: FloatArray  # (n, 3), tissue on tool, in the sensor frame
    moment_Nmm: FloatArray  # (n, 3), about the sensor's origin, in the sensor frame
    rows: IntArray  # (n,), line, row or message number in the file
    row_word: str = "row"
    acts_on: str = "tool"
    wrench_frame: str = "sensor"

    def __post_init__(self) -> None:
        for name in _SIGNALS:
            kind = np.int64 if name == "rows" else np.float64
            # A view, so that freezing it leaves the caller's array as it was.
            values = np.asarray(getattr(self, name), dtype=kind).view()
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    @property
    def n_rows(self) -> int:
        """Number of instants."""
        return int(self.time_s.size)

    @property
    def rate_hz(self) -> float:
        """Median sampling rate [Hz]."""
        return float(1.0 / np.median(np.diff(self.time_s)))

    def fault(self, message: str, index: int | None = None) -> CurveError:
        """Error that names the file and, where given, the row and its time stamp."""
        where = ""
        if index is not None:
            where = f"{self.row_word} {int(self.rows[index])} (t = {self.time_s[index]:.3f} s): "
        return CurveError(f"{self.source}: {where}{message}")

    def changed(self, **fields: FloatArray | IntArray) -> "Recording":
        """Copy with other fields."""
        values: dict[str, Any] = fields
        return replace(self, **values)

    def less(self, force_N: FloatArray, moment_Nmm: FloatArray) -> "Recording":
        """Copy without a part of the wrench, of shapes (3,) or (n, 3)."""
        return self.changed(force_N=self.force_N - force_N, moment_Nmm=self.moment_Nmm - moment_Nmm)

    def part(self, chosen: slice | IntArray) -> "Recording":
        """Only some rows, in order."""
        return self.changed(**{name: getattr(self, name)[chosen] for name in _SIGNALS})


def rows_between(time_s: FloatArray, start_s: float, stop_s: float) -> slice:
    """Rows among increasing time stamps (n,) from one instant up to, but not at, another."""
    return slice(*map(int, np.searchsorted(time_s, [start_s, stop_s])))


# ------------------------------------------------------------------- averages and noise


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


def noise_std(values: FloatArray) -> float:
    """Standard deviation of white noise on a smooth signal (n,).

    From the median of second differences, whose variance is six times the noise variance;
    spikes and a few kinks leave the median where it is.
    """
    bends = np.diff(values, 2)
    # 1.4826: from the median absolute deviation to the standard deviation of normal noise.
    return float(1.4826 * np.median(np.abs(bends)) / np.sqrt(6.0)) if bends.size else 0.0


def correlation_factor(residual: FloatArray) -> float:
    """Inflation of a mean's standard deviation by neighbours that err alike, at least 1.

    For noise whose correlation falls geometrically, √((1 + ρ)/(1 - ρ)) with the lag-one
    correlation ρ.
    """
    power = float(residual @ residual)
    if residual.size < 8 or power == 0.0:
        return 1.0
    rho = min(float(residual[1:] @ residual[:-1]) / power, 0.95)
    return float(np.sqrt((1.0 + rho) / (1.0 - rho))) if rho > 0.0 else 1.0


# ------------------------------------------------------------------------- orientations


def rotated(quaternion: FloatArray, vectors: FloatArray, *, inverse: bool = False) -> FloatArray:
    """Vectors (n, 3) or (3,) of the tool's frame in the base frame, or the inverse: shape (n, 3)."""
    # SciPy takes no read-only arrays.
    return Rotation.from_quat(np.array(quaternion)).apply(np.array(vectors), inverse=inverse)


def gravity_in_sensor(recording: Recording, direction: FloatArray) -> FloatArray:
    """Unit vectors (n, 3) of gravity in the sensor's frame, by its direction (3,) in the base frame."""
    return rotated(recording.quaternion, direction / np.linalg.norm(direction), inverse=True)


def cross(left: FloatArray, right: FloatArray) -> FloatArray:
    """Cross product of (n, 3) or (3,) arrays, shape (n, 3)."""
    # Column by column: several times faster than numpy.cross on a long log.
    a, b = np.atleast_2d(left).T, np.atleast_2d(right).T
    columns = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    return np.stack(columns, axis=1)


def continuous(quaternion: FloatArray) -> FloatArray:
    """The same orientations (n, 4) with signs chosen so that neighbours are close."""
    flips = np.einsum("ij,ij->i", quaternion[1:], quaternion[:-1]) < 0.0
    if not flips.any():
        return quaternion
    signs = np.where(np.cumsum(np.concatenate([[False], flips])) % 2, -1.0, 1.0)
    return quaternion * signs[:, None]


def mean_orientation(quaternion: FloatArray) -> FloatArray:
    """Normalised mean (4,) of orientations (n, 4) that are close together."""
    mean = continuous(quaternion).mean(axis=0)
    return mean / np.linalg.norm(mean)


def turn_and_tilt(
    quaternion: FloatArray, reference: FloatArray, axis: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Turn about an axis of the base frame since a reference, and the tilt that is left over.

    The relative rotation q q₀⁻¹ is split into a turn about ``axis`` and a tilt of that axis
    (swing–twist decomposition).

    The turn (n,) is right-handed about the unit vector ``axis`` (3,), without jumps of 360 degrees; the
    tilt (n,) is 0 … 180 degrees.
    """
    relative = (
        Rotation.from_quat(np.array(quaternion)) * Rotation.from_quat(np.array(reference)).inv()
    ).as_quat()
    vector, scalar = relative[:, :3], relative[:, 3]
    along = vector @ axis
    # A quaternion and its opposite are one orientation, half a turn apart on this circle.
    half = np.unwrap(np.arctan2(along, scalar), period=np.pi)
    nearest = int(np.argmax(np.abs(scalar)))
    half -= np.pi * np.round(half[nearest] / np.pi)
    across = np.linalg.norm(vector - along[:, None] * axis, axis=1)
    return np.degrees(2.0 * half), np.degrees(2.0 * np.arctan2(across, np.hypot(along, scalar)))


def angle_between_deg(first: FloatArray, second: FloatArray) -> float:
    """Angle of two vectors (3,), 0 … 180 degrees."""
    across = float(np.linalg.norm(np.cross(first, second)))
    return float(np.degrees(np.arctan2(across, float(first @ second))))
