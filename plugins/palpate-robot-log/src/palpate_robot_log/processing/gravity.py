"""Weight of the tool: taken out of the wrench where it is known, or fitted from poses in free air.

In free air the sensor shows  f = b_f + Rᵀ g W  and  m = b_m + c × (Rᵀ g W)  with biases b, weight
W, centre c in the sensor's frame and direction g of gravity in the base frame: linear in b_f, W,
b_m and W c, so that a few orientations determine them all.
"""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray, IntArray
from palpate_robot_log.processing.noise import correlation_factor
from palpate_robot_log.processing.rotation import cross, unrotated
from palpate_robot_log.processing.thinning import thinned
from palpate_robot_log.recording import Recording

HEAVIEST_N = 100.0
"""Heaviest tool behind a hand-held-size force sensor."""

FARTHEST_MM = 500.0
"""Farthest centre of a tool from its sensor."""

LARGEST_SHARE = 0.01
"""Share of the peak force that a weight may leave in the curves without a warning."""

_LARGEST_STD = 0.1
_ROWS = 5000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolLoad:
    """Weight [N] and centre (3,) of the tool [mm, sensor frame], with standard deviations where fitted."""

    weight_N: float
    centre_mm: FloatArray
    weight_std_N: float = 0.0
    centre_std_mm: float = 0.0


def without_weight(recording: Recording, tool: ToolLoad, direction: FloatArray) -> Recording:
    """Wrench without the tool's weight; ``direction`` (3,) is that of gravity in the base frame."""
    pull = tool.weight_N * unrotated(recording.quaternion, direction / np.linalg.norm(direction))
    return recording.less(pull, cross(tool.centre_mm, pull))


def fit_tool(recording: Recording, free: IntArray, direction: FloatArray) -> ToolLoad:
    """Weight and centre from rows in free air.

    Parameters
    ----------
    recording : Recording
    free : (n,) array of row indices
    direction : (3,) array
        Of gravity, in the base frame.

    Raises
    ------
    CurveError
        The orientations do not differ enough, or the tool is not plausible.
    """
    part, _ = thinned(recording.part(free), _ROWS)
    down = unrotated(part.quaternion, direction / np.linalg.norm(direction))
    # Without its mean, what the bias imitates is gone from the unknown weight.
    lever = down - down.mean(axis=0)
    power = float(np.einsum("ij,ij->", lever, lever))
    force = part.force_N - part.force_N.mean(axis=0)
    weight = float(np.einsum("ij,ij->", lever, force) / power) if power > 0.0 else 0.0
    residual = force - weight * lever
    noise = float(residual.std()) * max(correlation_factor(column) for column in residual.T)
    std = noise / np.sqrt(power) if power > 0.0 else float("inf")
    if not std < max(_LARGEST_STD * abs(weight), 1e-3):
        raise recording.fault(
            f"{free.size} rows in free air give no weight of the tool, since its orientation hardly changes "
            "there; give gravity.weight and gravity.centre, or log a few orientations in free air",
            int(free[0]),
        )
    centre, centre_std = _fit_centre(part, lever, weight)
    # A weight that is off by a share puts the centre off by the same share.
    centre_std = float(np.hypot(centre_std, np.linalg.norm(centre) * std / weight))
    tool = ToolLoad(weight_N=weight, centre_mm=centre, weight_std_N=std, centre_std_mm=centre_std)
    check_plausible(recording, tool)
    return tool


def check_plausible(recording: Recording, tool: ToolLoad) -> None:
    """Refuse a tool that no such sensor carries."""
    if not 0.0 <= tool.weight_N <= HEAVIEST_N:
        raise recording.fault(
            f"a tool of {tool.weight_N:.4g} N is not plausible (0 to {HEAVIEST_N:g} N); check the units of "
            "the force and of gravity.weight, and the direction of gravity"
        )
    reach = float(np.linalg.norm(tool.centre_mm))
    if reach > FARTHEST_MM:
        raise recording.fault(
            f"a tool whose centre is {reach:.4g} mm from the sensor is not plausible "
            f"(up to {FARTHEST_MM:g} mm); check the units of the moment and of gravity.centre"
        )


def check_shown(recording: Recording, free: IntArray, tool: ToolLoad) -> None:
    """Refuse a known weight that the sensor could only hide behind a bias larger than all it shows."""
    shown = float(np.linalg.norm(recording.force_N[free].mean(axis=0)))
    span = float(np.ptp(recording.force_N, axis=0).max())
    if tool.weight_N > 2.0 * (shown + span):
        raise recording.fault(
            f"in free air the sensor shows {shown:.3g} N, but gravity gives the tool {tool.weight_N:.4g} N: "
            "heavier than plausible; check gravity.weight (in N, 9.81 times the mass in kg)",
            int(free[0]),
        )


def _fit_centre(part: Recording, lever: FloatArray, weight: float) -> tuple[FloatArray, float]:
    """Centre from m - mean = c × (W lever), three linear unknowns."""
    pull = weight * lever
    zero = np.zeros(pull.shape[0])
    x, y, z = pull.T
    columns = ([zero, -z, y], [z, zero, -x], [-y, x, zero])
    rows = np.stack([np.concatenate(column) for column in columns], axis=1)
    moment = (part.moment_Nmm - part.moment_Nmm.mean(axis=0)).T.ravel()
    centre, *_ = np.linalg.lstsq(rows, moment, rcond=None)
    noise = float(np.std(moment - rows @ centre))
    spread = np.linalg.pinv(rows.T @ rows)
    return centre, noise * float(np.sqrt(np.trace(spread)))


def weight_left_in(
    recording: Recording, bias_N: FloatArray, direction: FloatArray, peak_N: float
) -> str | None:
    """Say so where what is in the bias may be a weight, and the tool tilts enough for it to matter.

    Parameters
    ----------
    recording : Recording
    bias_N : (3,) array
        Mean force in free air, with the weight in it.
    direction : (3,) array
        Of gravity, in the base frame.
    peak_N : float
        Largest force of the press.
    """
    offset = float(np.linalg.norm(bias_N))
    down = unrotated(recording.quaternion, direction / np.linalg.norm(direction))
    change = float(np.linalg.norm(down - down[0], axis=1).max())
    if offset * change < LARGEST_SHARE * peak_N:
        return None
    return (
        f"the force in free air is {offset:.2g} N ({offset / peak_N:.0%} of the peak) and the tool tilts by "
        f"{np.degrees(2.0 * np.arcsin(min(change / 2.0, 1.0))):.0f} degrees; if it is the tool's weight, up "
        f"to {offset * change:.2g} N of it stay in the curves: give gravity.method"
    )
