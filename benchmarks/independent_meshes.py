"""Meshes of the demo's forearm that had no part in the demo: of its exact surfaces, with curved faces.

The forearm of ``forearm-demo`` has half-axes that are linear along the limb, and two round bones. Nodes of
its mesh files are on these surfaces to 3e-8 mm, but for midside nodes of the bones, whose faces are on the
bones on average. :func:`true_limb` has edges of 1.0 mm at the edge of the contact (about 15,000 nodes): with
20 steps of depth and twist steps of 2.25° its curves are within 0.3 % of the force and 1.2 % of the torque
of converged ones. :func:`other_limb` has edges of half the radius under the sphere (4,500 to 5,000 nodes).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from study_mesh_size import RADIUS_MM, exact_segment, meshed

from palpate import Limb
from palpate_forearm import Phantom
from palpate_forearm.phantom import CrossSection, InkMark, PhantomBone
from palpate_limb.from_scan import sound_mesh
from palpate_limb.meshing import SizeField
from palpate_limb.options import ScanOptions
from palpate_limb.volume import MeshPlan, mesh_segment, moved_to_contact

FOREARM = {
    "p1": (38.0, 0.05, 32.0, 0.05, 90.0, ((14.0, 2.0, 6.0), (-13.0, -3.0, 6.5))),
    "p2": (36.0, 0.05, 30.0, 0.05, 62.0, ((13.0, 3.0, 6.0), (-12.0, -2.0, 6.5))),
    "p3": (32.0, 0.05, 26.0, 0.05, 100.0, ((12.0, 1.0, 6.5), (-11.0, 0.0, 6.0))),
    "p4": (41.5, 0.0375, 36.0, 0.05, 125.0, ((15.0, -1.0, 6.0), (-14.0, -5.0, 7.0))),
}
"""Half width and half height [mm] with their slopes, angle of the spot [°], centres and radii of bones."""
REACH_MM = 8.5
"""Distance from the spot within which edges of :func:`true_limb` are fine."""
OTHER_RATIO = 0.5
"""Edge over radius under the sphere of :func:`other_limb`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ring(SizeField):
    """Edges that are fine on a ring of the skin, where the contact ends, and grow away from it."""

    inner_mm: float = 5.5
    middle_mm: float = 3.0

    def at(self, points_mm: np.ndarray) -> np.ndarray:
        """Edge length [mm] wanted at points (n, 3) in the spot's frame."""
        out = np.hypot(points_mm[:, 0], points_mm[:, 1])
        across = np.maximum(np.maximum(out - self.radius_mm, self.inner_mm - out), 0.0)
        down = np.maximum(-points_mm[:, 2] - 1.5, 0.0)
        at_ring = self.fine_mm + self.growth * np.hypot(across, down)
        under = self.middle_mm + 0.8 * np.hypot(np.maximum(out - self.radius_mm, 0.0), down)
        size: np.ndarray = np.minimum(np.minimum(at_ring, under), self.coarse_mm)
        return size


def forearm(spot: str) -> Phantom:
    """The forearm around a spot, which is its only mark."""
    width, wider, height, higher, angle_deg, bones = FOREARM[spot]
    return Phantom(
        sections=tuple(
            CrossSection(station_mm=x, half_width_mm=width + wider * x, half_height_mm=height + higher * x)
            for x in (-60.0, 60.0)
        ),
        bones=tuple(
            PhantomBone(
                name=name, start_mm=(-64.0, y, z), end_mm=(64.0, y, z), start_radius_mm=r, end_radius_mm=r
            )
            for name, (y, z, r) in zip(("radius", "ulna"), bones, strict=True)
        ),
        marks=(InkMark(name=spot, station_mm=0.0, angle_deg=angle_deg, colour=(0.8, 0.1, 0.1)),),
    )


def true_limb(spot: str, fine_mm: float = 1.0, layers_mm: Mapping[str, float] = MappingProxyType({})) -> Limb:
    """Mesh of a spot whose curves are nearly converged; with longer edges, for an extrapolation to none."""
    phantom = forearm(spot)
    size = Ring(fine_mm=fine_mm, middle_mm=3.0 * fine_mm, coarse_mm=18.0, radius_mm=REACH_MM, growth=0.5)
    wanted = MeshPlan(size=size, tolerance_mm=0.4, layers_mm=layers_mm)
    segment = exact_segment(phantom, phantom.spots[0])
    return moved_to_contact(mesh_segment(segment, wanted), RADIUS_MM)[0]


def other_limb(spot: str) -> Limb:
    """Mesh of a spot for a fit, as ``palpate limb`` makes it with these edges."""
    phantom = forearm(spot)
    return meshed(exact_segment(phantom, phantom.spots[0]), OTHER_RATIO)[0]


def layered_limb(spot: str, layers_mm: Mapping[str, float]) -> Limb:
    """Mesh of a spot with layers for a fit: edges under the sphere as those above, flat faces farther off."""
    phantom = forearm(spot)
    layer = {name: f"{mm} mm" for name, mm in layers_mm.items()}
    wanted = ScanOptions(size=f"{OTHER_RATIO * RADIUS_MM} mm", layer=layer).mesh_at(spot)
    segment = exact_segment(phantom, phantom.spots[0])
    return moved_to_contact(sound_mesh(segment, replace(wanted, tolerance_mm=0.8)), RADIUS_MM)[0]
