"""Which rows press on the limb, roughly: where the force leaves what it was at the log's start."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from palpate.api import BoolArray, FloatArray
from palpate_robot_log.processing.noise import noise_std
from palpate_robot_log.processing.rotation import rotated
from palpate_robot_log.processing.thinning import thinned
from palpate_robot_log.recording import Recording

SHARE = 0.05
"""Share of the largest change of force beyond which a row counts as pressing."""

NOISE_MULTIPLE = 12.0
"""A change of force below this multiple of its noise is no contact."""

_PRESS_SHARE = 0.2
_DRIFT_SHARE = 0.15
_CALM_SHARE = 0.005
_TRACK_ROWS = 20_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """Rows that press, first and last, and by how much the force changes at most [N]."""

    first: int
    last: int
    peak_N: float
    noise_N: float
    ends_in_contact: bool


def rough_contact(recording: Recording) -> Contact:
    """Rows between the first and the last clear change of force.

    Raises
    ------
    CurveError
        The force never changes, the log starts in contact, or it holds several presses.
    """
    track, block = thinned(recording, _TRACK_ROWS)
    # In the base frame the weight is constant while the tool turns.
    force = rotated(track.quaternion, track.force_N)
    head = max(5, track.n_rows // 50)
    change = np.linalg.norm(force - _at_rest(force, head), axis=1)
    change = median_filter(change, size=5, mode="nearest")
    noise = float(np.linalg.norm([noise_std(column) for column in track.force_N.T]))
    # So many rows are averaged that noise is small against the threshold.
    n_calming = (noise / (_CALM_SHARE * change.max())) ** 2 if change.any() else 1.0
    n_calming = int(np.clip(n_calming, 1, max(change.size // 50, 1)))
    change = uniform_filter1d(change, n_calming, mode="nearest")
    peak = float(change.max())
    if peak < NOISE_MULTIPLE * noise or peak == 0.0:
        raise recording.fault(
            f"a press without contact: the force changes by {peak:.3g} N at most, with a noise of "
            f"{noise:.2g} N; check that the tool reached the limb, and that these are the wrench's columns"
        )
    pressing = change > max(SHARE * peak, 3.0 * noise)
    first, last = _only_press(recording, track, change, pressing)
    return Contact(
        first=first * block,
        last=min((last + 1) * block, recording.n_rows) - 1,
        peak_N=peak,
        noise_N=noise,
        ends_in_contact=bool(last >= track.n_rows - 2),
    )


def _at_rest(force: FloatArray, n_ends: int) -> FloatArray:
    """What the sensor shows in free air (n, 3): a line where the log ends there too, else its start."""
    first, last = np.median(force[:n_ends], axis=0), np.median(force[-n_ends:], axis=0)
    peak = float(np.linalg.norm(force - first, axis=1).max())
    if float(np.linalg.norm(last - first)) > _DRIFT_SHARE * peak:
        return first[None, :]
    line: FloatArray = first + np.linspace(0.0, 1.0, force.shape[0])[:, None] * (last - first)
    return line


def _only_press(
    recording: Recording, track: Recording, change: FloatArray, pressing: BoolArray
) -> tuple[int, int]:
    """First and last row of the one run of pressing rows that reaches a good part of the peak."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], pressing.astype(np.int8), [0]])))
    runs = [
        (int(start), int(stop) - 1)
        for start, stop in edges.reshape(-1, 2)
        if change[start:stop].max() > _PRESS_SHARE * change.max()
    ]
    if len(runs) > 1:
        spans = ", ".join(f"{track.time_s[a]:.2f} to {track.time_s[b]:.2f} s" for a, b in runs)
        raise recording.fault(
            f"{len(runs)} presses in one log ({spans}); give window.start and window.stop of one of "
            "them; a log must not start in contact"
        )
    first, last = runs[0]
    if first < 3:
        raise recording.fault(
            "the log starts in contact, so the sensor's bias cannot be determined; start it in free air",
            first,
        )
    return first, last
