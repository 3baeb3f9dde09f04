"""The skin at the equilibrium states of a simulation: where it is, and what the tool does to it."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.domain.curves import FloatArray
from palpate.errors import MeshError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfaceStates:
    """The contact surface of a limb at k equilibrium states, in the order travelled.

    All vectors are in the frame of the limb's mesh. Contact quantities are means around a node, per
    deformed area, such that the sum of area × traction is the force of the contact.

    Parameters
    ----------
    points_mm : (n, 3) array
        Nodes of the surface of the undeformed limb.
    triangles : (m, 3) integer array
        Counter-clockwise seen from outside.
    depth_mm, rotation_deg : (k,) array
        Where each state is on the path.
    positions_mm : (k, 3) array
        Origin of the indenter's frame.
    rotations : (k, 3, 3) array
        Axes of the indenter's frame as columns: a point x of the indenter is at ``position + rotation @ x``.
    displacements_mm : (k, n, 3) array
    areas_mm2 : (k, n) array
        Deformed area that belongs to each node.
    touching : (k, n) array
        Share of this area that the indenter touches.
    pressures_MPa : (k, n) array
    shears_MPa, tractions_MPa : (k, n, 3) array
        Tangential and whole traction of the indenter on the skin.
    """

    points_mm: FloatArray
    triangles: NDArray[np.int64]
    depth_mm: FloatArray
    rotation_deg: FloatArray
    positions_mm: FloatArray
    rotations: FloatArray
    displacements_mm: FloatArray
    areas_mm2: FloatArray
    touching: FloatArray
    pressures_MPa: FloatArray
    shears_MPa: FloatArray
    tractions_MPa: FloatArray

    def __post_init__(self) -> None:
        n, k = len(self.points_mm), len(self.depth_mm)
        for each in fields(self):
            # Single precision, as in files: what was simulated and what was read back are the same.
            array = np.array(getattr(self, each.name), dtype=_kept(each.name))
            array = array.astype(np.int64 if each.name == "triangles" else np.float64)
            wanted = _shape(each.name, n, k)
            if array.ndim != len(wanted) or any(w not in (-1, s) for s, w in zip(array.shape, wanted)):  # noqa: B905 -- compared before
                raise MeshError(
                    f"surface states: '{each.name}' has shape {array.shape} with {n} points and {k} states; "
                    f"give {wanted}"
                )
            if not np.isfinite(array).all():
                raise MeshError(f"surface states: '{each.name}' has values that are not finite")
            array.setflags(write=False)
            object.__setattr__(self, each.name, array)
        if self.triangles.size and not (self.triangles.min() >= 0 and self.triangles.max() < n):
            raise MeshError(f"surface states: a triangle names a point beyond the {n} of the surface")

    def resultants(self, about_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Force (k, 3) [N] of the contact on the skin, and moment (k, 3) [N·mm] about a point (3,)."""
        loads = self.areas_mm2[..., None] * self.tractions_MPa
        arms = self.points_mm + self.displacements_mm - about_mm
        return loads.sum(axis=1), np.cross(arms, loads).sum(axis=1)

    def compact(self) -> dict[str, Any]:
        """Arrays by name, as files keep them."""
        return {each.name: getattr(self, each.name).astype(_kept(each.name)) for each in fields(self)}


def _kept(name: str) -> type[np.generic]:
    return np.int32 if name == "triangles" else np.float32


def _shape(name: str, n: int, k: int) -> tuple[int, ...]:
    """Shape of an array; −1 where any length is right."""
    shapes: dict[str, tuple[int, ...]] = {
        "points_mm": (n, 3),
        "triangles": (-1, 3),
        "positions_mm": (k, 3),
        "rotations": (k, 3, 3),
        **dict.fromkeys(("depth_mm", "rotation_deg"), (k,)),
        **dict.fromkeys(("areas_mm2", "touching", "pressures_MPa"), (k, n)),
    }
    return shapes.get(name, (k, n, 3))
