"""Contact: rows that press, the normal, how the tool moves about the spot, and where it first touches.

At first contact the normal force leaves its baseline as a contact does. The force over the travel s
is described by  F = b + k₁ τ^p + k₂ τ^(p+1),  τ = max(s - s₀, 0): a flat baseline, Hertz's law for a
paraboloid (p = 3/2; 1 for a flat punch, 2 for a cone), and its first correction for a limb that is no
half-space. The onset s₀ minimises the squared residual.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from palpate.api import FloatArray
from palpate_robot_log.checks import NOISE_MULTIPLE, check
from palpate_robot_log.press_measures import STRIDES, is_back
from palpate_robot_log.processing.change_points import ChangePoint, Design, profile
from palpate_robot_log.recording import (
    Recording,
    angle_between_deg,
    block_means,
    mean_orientation,
    noise_std,
    rotated,
    thinned,
    turn_and_tilt,
)

SHARE = 0.05  # share of the largest change of force beyond which a row counts as pressing
EXPONENT_STD = 0.075  # of the contact law: so far from it are limbs in finite elements near first contact
_TRACK_ROWS = 20_000

_FITS = ((0.2, 2), (0.1, 2), (0.4, 2), (0.05, 1), (0.1, 1))
"""Shares of the peak force up to which the law is fitted, and its terms; the first gives the onset."""

_FEWEST = 8
_ZOOM = (121, 9, 9, 9)


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactRows:
    """Rows that press, first and last, and whether the log ends with them."""

    first: int
    last: int
    ends_in_contact: bool

    @property
    def rows(self) -> slice:
        """All of them."""
        return slice(self.first, self.last + 1)


def rough_contact(recording: Recording) -> ContactRows:
    """Rows between the first and the last clear change of force."""
    contacts, time = contacts_of(recording), recording.time_s
    spans = ", ".join(f"{time[one.first]:.2f} to {time[one.last]:.2f} s" for one in contacts)
    check(recording, "presses", len(contacts), spans=spans)
    return contacts[0]


def contacts_of(recording: Recording) -> tuple[ContactRows, ...]:
    """Contacts between which the force goes back to that in free air."""
    track, block = thinned(recording, _TRACK_ROWS)
    # In the base frame the weight is constant while the tool turns.
    force = rotated(track.quaternion, track.force_N)
    n_ends = max(5, track.n_rows // 50)
    # In free air the sensor shows a line where the log ends there too, else what it shows at its start.
    start, end = np.median(force[:n_ends], axis=0), np.median(force[-n_ends:], axis=0)
    farthest = float(np.linalg.norm(force - start, axis=1).max())
    noise = float(np.linalg.norm([noise_std(column) for column in track.force_N.T]))
    calm = float(np.linalg.norm([noise_std(column) for column in force.T]))
    check(track, "zero", force, NOISE_MULTIPLE * calm)
    rest = start[None, :]
    if float(np.linalg.norm(end - start)) <= 0.15 * farthest or is_back(track):
        rest = start + np.linspace(0.0, 1.0, track.n_rows)[:, None] * (end - start)
    change = median_filter(np.linalg.norm(force - rest, axis=1), size=5, mode="nearest")
    # So many rows are averaged that noise is small against the threshold.
    n_calming = (noise / (0.005 * change.max())) ** 2 if change.any() else 1.0
    n_calming = int(np.clip(n_calming, 1, max(change.size // 50, 1)))
    change = uniform_filter1d(change, n_calming, mode="nearest")
    peak = float(change.max())
    check(recording, "contact", peak / max(noise, 1e-300), peak=peak, noise=noise)
    pressing = change > max(SHARE * peak, 3.0 * noise)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], pressing.astype(np.int8), [0]])))
    runs = [
        (int(first), int(stop) - 1)
        for first, stop in edges.reshape(-1, 2)
        if change[first:stop].max() > 0.2 * peak
    ]
    starts_at = runs[0][0]
    check(recording, "start", starts_at, starts_at)
    return tuple(
        ContactRows(
            first=first * block,
            last=min((last + 1) * block, recording.n_rows) - 1,
            ends_in_contact=bool(last >= track.n_rows - 2),
        )
        for first, last in runs
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Normal:
    """Unit outward normal (3,) in the base frame, its standard deviation, and the tool's axis to it."""

    vector: FloatArray
    std_deg: float
    to_tool_axis_deg: float


def spot_normal(recording: Recording, contact: ContactRows) -> Normal:
    """Direction opposite to the one in which the tool moved while the force rose.

    The principal direction of the displacements over strides of the contact; a dwell adds no
    displacement and so has no effect.
    """
    rows = contact.rows
    position = recording.position_mm[rows]
    stride = max(1, position.shape[0] // STRIDES)
    steps = position[stride:] - position[:-stride]
    _, lengths, directions = np.linalg.svd(steps[:: max(1, stride // 4)], full_matrices=False)
    check(recording, "movement", lengths[0])
    across = float(np.hypot(*lengths[1:]) / lengths[0])
    std_deg = float(np.degrees(across / np.sqrt(STRIDES)))
    check(recording, "line", across, contact.first)
    # Inward is where the tool moves as the force grows.
    before = max(contact.first // 4, 1)
    travel = (position - position[0]) @ directions[0]
    force = rotated(recording.quaternion[rows], recording.force_N[rows])
    rest = rotated(recording.quaternion[:before], recording.force_N[:before]).mean(axis=0)
    change = np.linalg.norm(force - rest, axis=1)
    inward = directions[0] * (1.0 if float(travel @ (change - change[0])) >= 0.0 else -1.0)
    return described(recording, contact, -inward, std_deg)


def described(
    recording: Recording, contact: ContactRows, vector: FloatArray | None, std_deg: float
) -> Normal:
    """A normal (3,) scaled to length 1, or else the tool's axis, with the angle from that axis to it."""
    orientation = mean_orientation(recording.quaternion[contact.rows])
    axis = rotated(orientation[None, :], np.array([0.0, 0.0, 1.0]))[0]
    outward = -axis if vector is None else vector
    unit = outward / np.linalg.norm(outward)
    return Normal(vector=unit, std_deg=std_deg, to_tool_axis_deg=angle_between_deg(axis, -unit))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolMotion:
    """Motion of the tool about a spot; arrays of shape (n,)."""

    time_s: FloatArray
    travel_mm: FloatArray  # along the inward normal, from the first row that clearly presses
    lateral_mm: FloatArray  # distance from the line along the normal through that row's position
    turn_deg: FloatArray  # about the outward normal since the press began
    tilt_deg: FloatArray  # what is left of the rotation
    origin_mm: FloatArray  # (3,), tool tip at travel 0, in the base frame


def motion_about(recording: Recording, contact: ContactRows, normal: FloatArray) -> ToolMotion:
    """Motion along and about a unit normal (3,) of the base frame."""
    origin = recording.position_mm[contact.first]
    offset = recording.position_mm - origin
    travel = -offset @ normal
    n_head = max((contact.last - contact.first) // 20, 1)
    head = recording.quaternion[contact.first : contact.first + n_head]
    turn, tilt = turn_and_tilt(recording.quaternion, mean_orientation(head), normal)
    return ToolMotion(
        time_s=recording.time_s,
        travel_mm=travel,
        lateral_mm=np.linalg.norm(offset + travel[:, None] * normal, axis=1),
        turn_deg=turn,
        tilt_deg=tilt,
        origin_mm=origin,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Onset:
    """Travel of first contact and its standard deviation [mm], and how many rows gave it.

    ``spread_mm`` is how far it moves when the law is fitted to less or more of the press, with
    and without its correction, and no less than by a law whose exponent is off by ``EXPONENT_STD``;
    ``std_mm`` contains it.
    """

    travel_mm: float
    std_mm: float
    spread_mm: float
    baseline_rows: int


def find_onset(
    recording: Recording, travel_mm: FloatArray, normal_force_N: FloatArray, press: slice, exponent: float
) -> Onset:
    """Onset of contact from the rows ``press``, from free air to the end of the press.

    Travel (n,) is along the inward normal, and force (n,) acts from the tissue on the tool along the
    outward normal; ``exponent`` is p of the contact law, and the recording is for messages.
    """
    travel, force = travel_mm[press], normal_force_N[press]
    size = abs(float(np.median(force[-_FEWEST:]) - np.median(force[:_FEWEST])))
    fits = [(share, n) for share, n in _FITS if share * size > 5.0 * noise_std(force)] or [_FITS[2]]
    found, *others = (_fit(recording, travel, force, share, exponent, n) for share, n in fits)
    spread = float(np.sqrt(np.mean([(other.at - found.at) ** 2 for other in others] or [0.0])))
    # The fits agree by chance in some logs, and miss alike where the force grows by another law.
    share, n_terms = fits[0]
    low, high = (
        _fit(recording, travel, force, share, exponent + off, n_terms).at
        for off in (EXPONENT_STD, -EXPONENT_STD)
    )
    spread = max(spread, abs(high - low) / 2.0)
    n_free = int(np.count_nonzero(travel < found.at))
    check(recording, "onset", n_free, press.start)
    return Onset(
        travel_mm=found.at, std_mm=float(np.hypot(found.std, spread)), spread_mm=spread, baseline_rows=n_free
    )


def _fit(
    recording: Recording, travel: FloatArray, force: FloatArray, share: float, exponent: float, n_terms: int
) -> ChangePoint:
    """Onset by the law with so many terms, up to a share of the peak force."""
    low, top = _ends(force)
    is_rising = (force - low > share * (top - low)).any()
    check(recording, "rising", top - low if is_rising else 0.0, low=low, top=top)
    return place_of_contact(travel, force, share, exponent, n_terms)


def _ends(force: FloatArray) -> tuple[float, float]:
    n_ends = max(_FEWEST, force.size // 100)
    return float(np.median(force[:n_ends])), float(np.median(force[-n_ends:]))


def place_of_contact(
    travel: FloatArray, force: FloatArray, share: float = 0.2, exponent: float = 1.5, n_terms: int = 2
) -> ChangePoint:
    """Travel of first contact by the law, up to a share of the force, which is larger at its end."""
    low, top = _ends(force)
    beyond = np.flatnonzero(force - low > share * (top - low))
    until = float(np.median(travel[beyond[:_FEWEST]]))
    # The approach may come from far away; rows twice as far before the onset as behind it are enough.
    rising = np.flatnonzero(force - low > share / 4.0 * (top - low))
    reach = max(5.0 * (until - float(np.median(travel[rising[:_FEWEST]]))), 1.0)
    chosen = np.flatnonzero((travel <= until) & (travel > until - reach))
    block = -(-chosen.size // 1500)
    x, y = block_means(travel[chosen], block), block_means(force[chosen], block)
    first, last = float(x.min()), float(x.max())
    fit = profile(x, y, (first, last), _law(exponent, n_terms), _ZOOM, rising=1)
    at_edge = min(fit.at - first, last - fit.at) < 1e-3 * (last - first)
    return replace(fit, std=last - first) if at_edge else fit


def _law(exponent: float, n_terms: int) -> Design:
    def design(travel: FloatArray, at: FloatArray) -> FloatArray:
        tau = np.maximum(travel - at[:, None], 0.0)
        rise = tau**exponent
        return np.stack([np.ones_like(tau), *[rise, rise * tau][:n_terms]], axis=-1)

    return design
