"""Where the tool first touches: the normal force leaves its baseline as a contact does.

The force over the travel s is described by  F = b + k₁ τ^p + k₂ τ^(p+1),  τ = max(s - s₀, 0):
a flat baseline, Hertz's law for a paraboloid (p = 3/2; 1 for a flat punch, 2 for a cone), and
its first correction for a limb that is no half-space. The onset s₀ minimises the squared
residual.
"""

from dataclasses import dataclass, replace

import numpy as np

from palpate.api import FloatArray
from palpate_robot_log.processing.change_point import Design, Fit, profile
from palpate_robot_log.processing.noise import noise_std
from palpate_robot_log.processing.thinning import block_means
from palpate_robot_log.recording import Recording

_FITS = ((0.2, 2), (0.1, 2), (0.4, 2), (0.05, 1), (0.1, 1))
"""Shares of the peak force up to which the law is fitted, and its terms; the first gives the onset."""

_FEWEST = 8
_LEAST_REACH_MM = 1.0
_CLEAR = 5.0
_ZOOM = (121, 9, 9, 9)
_ROWS = 1500


@dataclass(frozen=True, slots=True, kw_only=True)
class Onset:
    """Travel of first contact and its standard deviation [mm], and how many rows gave it.

    ``spread_mm`` is how far it moves when the law is fitted to less or more of the press, with
    and without its correction; ``std_mm`` contains it.
    """

    travel_mm: float
    std_mm: float
    spread_mm: float
    baseline_rows: int


def find_onset(
    recording: Recording, travel_mm: FloatArray, normal_force_N: FloatArray, press: slice, exponent: float
) -> Onset:
    """Onset of contact from the rows of an approach and a press.

    Parameters
    ----------
    recording : Recording
        For messages.
    travel_mm, normal_force_N : (n,) array
        Along the inward normal; of the tissue on the tool, along the outward normal.
    press : slice
        Rows from free air to the end of the press.
    exponent : float
        p of the contact law.

    Raises
    ------
    CurveError
        Too few rows in free air, or a force that does not rise with the travel.
    """
    travel, force = travel_mm[press], normal_force_N[press]
    size = abs(float(np.median(force[-_FEWEST:]) - np.median(force[:_FEWEST])))
    shares = [(share, n) for share, n in _FITS if share * size > _CLEAR * noise_std(force)] or [_FITS[2]]
    found, *others = (_fit(recording, travel, force, share, _law(exponent, n)) for share, n in shares)
    spread = float(np.sqrt(np.mean([(other.at - found.at) ** 2 for other in others] or [0.0])))
    n_free = int(np.count_nonzero(travel < found.at))
    if n_free < _FEWEST:
        raise recording.fault(
            f"{n_free} rows in free air before contact; start the log earlier, so that the sensor's "
            "bias and the onset can be determined",
            press.start,
        )
    return Onset(
        travel_mm=found.at, std_mm=float(np.hypot(found.std, spread)), spread_mm=spread, baseline_rows=n_free
    )


def _fit(recording: Recording, travel: FloatArray, force: FloatArray, share: float, law: Design) -> Fit:
    low = float(np.median(force[: max(_FEWEST, force.size // 100)]))
    top = float(np.median(force[-max(_FEWEST, force.size // 100) :]))
    beyond = np.flatnonzero(force - low > share * (top - low))
    if not top > low or beyond.size == 0:
        raise recording.fault(
            f"the normal force goes from {low:.3g} to {top:.3g} N over the press and does not rise; "
            "check the sign and the axes of the wrench"
        )
    until = float(np.median(travel[beyond[:_FEWEST]]))
    # The approach may come from far away; rows twice as far before the onset as behind it are enough.
    rising = np.flatnonzero(force - low > share / 4.0 * (top - low))
    reach = max(5.0 * (until - float(np.median(travel[rising[:_FEWEST]]))), _LEAST_REACH_MM)
    chosen = np.flatnonzero((travel <= until) & (travel > until - reach))
    block = -(-chosen.size // _ROWS)
    x, y = block_means(travel[chosen], block), block_means(force[chosen], block)
    return _sought(x, y, law)


def _sought(x: FloatArray, y: FloatArray, design: Design) -> Fit:
    between = (float(x.min()), float(x.max()))
    fit = profile(x, y, between, design, _ZOOM)
    edge = 1e-3 * (between[1] - between[0])
    at_edge = min(fit.at - between[0], between[1] - fit.at) < edge
    return replace(fit, std=between[1] - between[0]) if at_edge else fit


def _law(exponent: float, n_terms: int) -> Design:
    def design(travel: FloatArray, at: FloatArray) -> FloatArray:
        tau = np.maximum(travel - at[:, None], 0.0)
        rise = tau**exponent
        terms = [rise, rise * tau][:n_terms]
        return np.stack([np.ones_like(tau), *terms], axis=-1)

    return design
