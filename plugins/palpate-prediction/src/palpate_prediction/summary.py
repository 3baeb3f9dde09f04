"""Rows of the summary: quantities of the contact at the largest force, and how far draws spread them.

Draws make the tissue stiffer or softer. With a factor s on all moduli, whatever the tool, the same depth
needs s times the force and has s times the pressures. A tool that is pressed by force F then has s times
what this tissue has at F/s, which the states along its path show.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from palpate.api import Curve, FloatArray, Indentation, Simulation, Status, SurfaceStates, convert
from palpate.api.experiment import DEPTH
from palpate_prediction.bands import ends, scores


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


class SummaryRow(NamedTuple):
    """A row of the summary: name, unit and attribute, and where it has a linear band.

    ``at_depth``: at one depth a stiffer tissue has more of it. ``at_force``: it is smooth enough along the
    path for a band at one force; areas, and what is divided by them, change by whole faces.
    """

    name: str
    unit: str
    attribute: str
    at_depth: bool
    at_force: bool


QUANTITIES = (
    SummaryRow("depth", "mm", "depth_mm", False, True),
    SummaryRow("normal force", "N", "force_N", True, True),
    SummaryRow("contact area", "mm²", "area_mm2", False, False),
    SummaryRow("peak pressure", "MPa", "peak_MPa", True, True),
    SummaryRow("95th percentile of pressure", "MPa", "p95_MPa", True, True),
    SummaryRow("mean pressure", "MPa", "mean_MPa", True, False),
    SummaryRow("peak shear", "MPa", "shear_peak_MPa", True, False),
    SummaryRow("area above the threshold", "mm²", "above_mm2", False, False),
)
"""Rows of the summary."""

SAME_FORCE = 0.01
"""Relative difference of two forces that count as one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PressStates:
    """A tool at its equilibrium states, (k,) each: depth, normal force and contact."""

    depth_mm: FloatArray
    force_N: FloatArray
    contact: ContactMeasures

    @property
    def at(self) -> int:
        """The state with the largest force."""
        return int(np.argmax(self.force_N))

    def along(self, attribute: str) -> FloatArray | None:
        """A quantity (k,) at the states; None for an area without a threshold."""
        if attribute in ("depth_mm", "force_N"):
            return np.asarray(getattr(self, attribute))
        return getattr(self.contact, attribute)

    def value(self, attribute: str) -> float | None:
        """The quantity at the largest force."""
        found = self.along(attribute)
        return None if found is None else float(found[self.at])

    def growth(self, attribute: str) -> float | None:
        """Power of the force with which a quantity grows along the path; None where it cannot be seen."""
        values = self.along(attribute)
        if values is None:
            return None
        most = self.force_N[self.at]
        until = int(np.argmax(self.force_N >= (1.0 - SAME_FORCE) * most))  # from there on it may be held
        # Share of the largest force from which on states show how a quantity grows with the force.
        seen = (self.force_N >= 0.5 * most) & (values > 0.0) & (np.arange(len(values)) <= until)
        forces, sizes = self.force_N[seen], values[seen]
        # Largest over least force of these states, below which they show no growth.
        if not forces.size or not forces.max() > 1.05 * forces.min():
            return None
        return float(np.polyfit(np.log(forces), np.log(sizes), 1)[0])


def press_states(simulation: Simulation, threshold_MPa: float | None) -> PressStates:
    """Measure a simulation with a surface, by the force along the axis of the tool as it first touches."""
    states = simulation.surface
    assert states is not None
    force, _ = states.resultants(states.positions_mm[0])
    return PressStates(
        depth_mm=states.depth_mm,
        force_N=np.asarray(-(force @ states.rotations[0][:, 2])),
        contact=contact_of(states, threshold_MPa),
    )


def is_by_force(protocol: Indentation) -> bool:
    """Whether a force is to be reached somewhere along the path."""
    return protocol.loads is not None and bool(np.isfinite(protocol.loads[:, DEPTH]).any())


def ends_by_force(protocol: Indentation, status: Status, pressed: PressStates) -> bool:
    """Whether the largest force is one that was to be reached, so that its depth is predicted."""
    if protocol.loads is None or status is not Status.OK:
        return False
    wanted = protocol.loads[:, DEPTH]
    wanted = wanted[np.isfinite(wanted)]
    return bool(np.isclose(wanted, pressed.force_N[pressed.at], rtol=SAME_FORCE, atol=0.0).any())


def mesh_error(value: float | None, coarser: float | None, left_over: float, least: float) -> float:
    """Relative standard deviation of a value by its mesh.

    It is the share ``left_over`` of the change from a coarser mesh, since nothing is extrapolated; ``least``
    where the share is less, or unknown.
    """
    if not value or coarser is None:
        return least
    return max(abs(1.0 - coarser / value) * left_over, least)


def mesh_errors(
    pressed: PressStates, coarser: PressStates | None, left_over: float, least: float
) -> dict[str, float]:
    """Relative standard deviation of each quantity by its mesh."""
    names = [quantity.attribute for quantity in QUANTITIES]
    others = {name: None if coarser is None else coarser.value(name) for name in names}
    return {name: mesh_error(pressed.value(name), others[name], left_over, least) for name in names}


def curve_errors(
    curves: Mapping[str, Curve],
    coarser: Mapping[str, Curve] | None,
    left_over: Mapping[str, float],
    least: Mapping[str, float],
) -> dict[str, float]:
    """Relative standard deviation of the largest ordinate of each channel by its mesh."""
    others = {} if coarser is None else {name: _largest(curve) for name, curve in coarser.items()}
    return {n: mesh_error(_largest(c), others.get(n), left_over[n], least[n]) for n, c in curves.items()}


def force_error(pressed: PressStates, mesh: Mapping[str, float]) -> float | None:
    """Relative standard deviation, by the mesh, of the force at a depth where the force was given.

    All meshes carry that force, each at a depth of its own. None where the growth with the force is unknown.
    """
    growth = pressed.growth("depth_mm")
    return mesh["depth_mm"] / growth if growth else None


def change_by_mesh(value: float, coarser: float | None) -> float | None:
    """Value over that on a coarser mesh; None where one of them is zero, as areas may be."""
    if not value or not coarser:
        return None if value or coarser else 1.0
    return value / coarser


def _largest(curve: Curve) -> float:
    return float(curve.ordinate[np.argmax(np.abs(curve.ordinate))])


def with_mesh(values: FloatArray, sd: float) -> FloatArray:
    """Draws (n, ...) with an error by the mesh each, of a relative standard deviation."""
    errors = scores(len(values), 1).reshape(-1, *(1 for _ in values.shape[1:]))
    return np.asarray(values * (1.0 + sd * errors))


def stiffer_by(curve: Curve | None, lines: FloatArray | None) -> FloatArray:
    """Force of each draw (n,) over the largest force of the fit, there; empty where none is known."""
    if curve is None or lines is None or not len(lines) or not curve.ordinate.max() > 0.0:
        return np.empty(0)
    at = int(np.argmax(curve.ordinate))
    return np.asarray(lines[:, at] / curve.ordinate[at])


def spread(
    pressed: PressStates,
    quantity: SummaryRow,
    stiffer: FloatArray,
    *,
    by_force: bool,
    mesh: Mapping[str, float] = MappingProxyType({}),
) -> FloatArray | None:
    """Values (n,) of a quantity for draws that are stiffer by factors (n,); None where none are known.

    ``mesh`` has the relative standard deviation of its error by the mesh.
    """
    value = pressed.value(quantity.attribute)
    if value is None or not len(stiffer) or not (quantity.at_force if by_force else quantity.at_depth):
        return None
    growth = pressed.growth(quantity.attribute) if by_force else 0.0
    if growth is None:
        return None
    is_given = by_force and quantity.attribute == "force_N"
    sd = 0.0 if is_given else mesh.get(quantity.attribute, 0.0)
    return with_mesh(value * stiffer ** (float(quantity.at_depth) - growth), sd)


def summary_rows(
    spot: str,
    pressed: PressStates,
    stiffer: FloatArray,
    solved: Sequence[PressStates],
    *,
    apart: FloatArray | None = None,
    by_force: bool,
    mesh: Mapping[str, float] = MappingProxyType({}),
    pressure_unit: str = "MPa",
    coarser: PressStates | None = None,
) -> Iterator[dict[str, Any]]:
    """Value, ends of the linear band, and ends of the band of simulated draws, of each quantity at a spot.

    ``apart`` are factors (n_solved,) on forces of the simulated draws by their model errors. ``coarser`` is
    of the fitted values on the mesh of the draws, where that is not the one of ``pressed``.
    """
    per_MPa = convert("1 MPa", pressure_unit)
    for quantity in QUANTITIES:
        unit, factor = (pressure_unit, per_MPa) if quantity.unit == "MPa" else (quantity.unit, 1.0)
        value = pressed.value(quantity.attribute)
        if value is None or (quantity.attribute == "depth_mm" and not by_force):
            continue
        row: dict[str, Any] = {"spot": spot, "quantity": quantity.name, "unit": unit, "value": factor * value}
        drawn = spread(pressed, quantity, stiffer, by_force=by_force, mesh=mesh)
        band = (None, None) if drawn is None else ends(drawn)
        row |= {
            f"linear_{end}": None if at is None else factor * float(at)
            for end, at in zip(("lower", "upper"), band, strict=True)
        }
        if solved:
            share = 1.0 if coarser is None else change_by_mesh(value, coarser.value(quantity.attribute))
            values = np.array([each.value(quantity.attribute) for each in solved])
            if apart is not None and value:
                others = spread(pressed, quantity, apart, by_force=by_force, mesh=mesh)
                values = values if others is None else values * others / value
            row |= {
                f"solved_{end}": None if share is None else factor * share * float(at)
                for end, at in zip(("lower", "upper"), ends(values), strict=True)
            }
        yield row
