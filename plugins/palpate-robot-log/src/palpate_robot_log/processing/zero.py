"""Zero of the sensor over a log: a jump at rest shows that it was zeroed in contact."""

import numpy as np
from scipy.ndimage import median_filter

from palpate.api import FloatArray
from palpate_robot_log.recording import Recording, noise_std

LARGEST_JUMP_SHARE = 0.3  # share of the largest change of force by which no contact jumps
_SAME_SHARE = 0.3
_NOISE_MULTIPLE = 12.0
_STILL_MM = 0.03
_BACK_SHARE = 0.05
_WINDOW = 5


def check_zero(track: Recording, force_N: FloatArray) -> None:
    """Refuse a log whose force (n, 3) in the base frame jumps between two rows while the tip rests."""
    n_rows = track.n_rows
    if n_rows < 4 * _WINDOW:
        return
    level = median_filter(force_N, size=(_WINDOW, 1), mode="nearest")
    half, before = _WINDOW // 2, np.arange(_WINDOW - 1, n_rows - _WINDOW)
    jumps = np.linalg.norm(level[before + half + 1] - level[before - half], axis=1)
    moved_mm = track.position_mm[before + _WINDOW] - track.position_mm[before - _WINDOW + 1]
    # A jump to another level, within one step.
    jumps = np.minimum(jumps, np.linalg.norm(force_N[before + 1] - force_N[before], axis=1))
    at = int(np.argmax(jumps * (np.linalg.norm(moved_mm, axis=1) < _STILL_MM)))
    row, jump_N = int(before[at]), float(jumps[at])
    n_ends = max(n_rows // 50, _WINDOW)
    begin, end = (np.median(part, axis=0) for part in (force_N[:n_ends], force_N[-n_ends:]))
    noise_N = float(np.linalg.norm([noise_std(column) for column in force_N.T]))
    least_N = max(
        LARGEST_JUMP_SHARE * float(np.linalg.norm(force_N - begin, axis=1).max()), _NOISE_MULTIPLE * noise_N
    )
    if jump_N < least_N:
        return
    off, off_N = "", float(np.linalg.norm(end - begin))
    if is_back(track):
        if abs(off_N - jump_N) > _SAME_SHARE * jump_N:
            return
        off = f", and is {off_N:.3g} N off when the tool is back at its height"
    raise track.fault(
        f"the force jumps by {jump_N:.3g} N while the tip rests{off}: the sensor was zeroed in contact; "
        "zero it in free air, and log the press again",
        row + 1,
    )


def is_back(track: Recording) -> bool:
    """Whether the tool ends where it began, so that the sensor shows the same if its zero is the same."""
    position = track.position_mm
    n_ends = max(track.n_rows // 50, 3)
    begin, end = position[:n_ends].mean(axis=0), position[-n_ends:].mean(axis=0)
    farthest = float(np.linalg.norm(position - begin, axis=1).max())
    return float(np.linalg.norm(end - begin)) <= _BACK_SHARE * farthest
