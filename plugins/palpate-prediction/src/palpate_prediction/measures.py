"""Numbers of the contact at an equilibrium state: how large it is, and how it presses."""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray, SurfaceStates


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactMeasures:
    """Contact at the states of a simulation, (k,) each; pressures are means around a node.

    Parameters
    ----------
    area_mm2 : (k,) array
        Deformed area that the tool touches.
    peak_MPa, p95_MPa, mean_MPa : (k,) array
        Largest pressure, the pressure that 5 % of the touched area exceed, and the mean; 0 without contact.
    shear_peak_MPa : (k,) array
    above_mm2 : (k,) array or None
        Area with more than the threshold.
    """

    area_mm2: FloatArray
    peak_MPa: FloatArray
    p95_MPa: FloatArray
    mean_MPa: FloatArray
    shear_peak_MPa: FloatArray
    above_mm2: FloatArray | None


def contact_of(states: SurfaceStates, threshold_MPa: float | None) -> ContactMeasures:
    """Measure the contact at every state."""
    touched = states.areas_mm2 * states.touching
    pressure = states.pressures_MPa  # the mean around a node: that of its touched part alone is all noise
    shear = np.linalg.norm(states.shears_MPa, axis=2)
    area = touched.sum(axis=1)
    load = (states.areas_mm2 * pressure).sum(axis=1)
    return ContactMeasures(
        area_mm2=area,
        peak_MPa=pressure.max(axis=1, initial=0.0),
        p95_MPa=np.array([weighted_quantile(p, w, 0.95) for p, w in zip(pressure, touched, strict=True)]),
        mean_MPa=load / np.where(area > 0.0, area, 1.0),
        shear_peak_MPa=shear.max(axis=1, initial=0.0),
        above_mm2=None if threshold_MPa is None else area_above(states, threshold_MPa),
    )


def weighted_quantile(values: FloatArray, weights: FloatArray, share: float) -> float:
    """Value that a share of the weight does not exceed; 0 without weight."""
    order = np.argsort(values)
    heaped = np.cumsum(weights[order])
    if not heaped[-1] > 0.0:
        return 0.0
    # The middle of each value's own weight, between which it is linear.
    middle = (heaped - 0.5 * weights[order]) / heaped[-1]
    held = weights[order] > 0.0
    return float(np.interp(share, middle[held], values[order][held]))


def area_above(states: SurfaceStates, threshold_MPa: float) -> FloatArray:
    """Area (k,) [mm²] that is touched with more than a threshold; pressures are linear over each triangle."""
    corners = (states.points_mm + states.displacements_mm)[:, states.triangles]
    sides = corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]
    areas = 0.5 * np.linalg.norm(np.cross(*sides), axis=2)
    touching = states.touching[:, states.triangles]
    low, middle, high = np.moveaxis(np.sort(states.pressures_MPa[:, states.triangles], axis=2), 2, 0)
    t = threshold_MPa
    with np.errstate(divide="ignore", invalid="ignore"):
        rising = 1.0 - (t - low) ** 2 / ((middle - low) * (high - low))
        falling = (high - t) ** 2 / ((high - low) * (high - middle))
    share = np.select([t <= low, t >= high, t <= middle], [1.0, 0.0, rising], falling)
    return np.asarray((areas * touching.mean(axis=2) * share).sum(axis=1))
