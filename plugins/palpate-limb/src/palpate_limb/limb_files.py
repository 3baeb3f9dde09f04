"""A limb's mesh as VTU, with regions and node sets, and a JSON note of what it was made from."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from palpate.api import Limb
from palpate.api.mesh import CELLS
from palpate_limb.from_scan import ReadScan, ScannedLimb

# ``benchmarks/study_mesh_size.py`` presses and twists the phantom's spot p2 on meshes of several sizes, and
# ``study_real_mesh.py`` spots of real limbs. Both extrapolate y(h) = y₀ + c hᵖ to h = 0.
RATIOS = (0.233, 0.301, 0.409)
"""Mean edge under the sphere over its radius, of the meshes studied."""
FORCE = (
    (0.0042, 0.0075, 0.0158),  # phantom
    (0.004, 0.007, 0.013),  # forearm
    (0.0057, 0.0102, 0.0181),  # residual limb: two meshes, order 2
)
"""Largest force over its limit, less one; a row for each limb."""
TORQUE = (
    (0.0144, 0.0255, 0.0641),  # phantom
    (0.050, 0.066, 0.082),  # forearm: order 1, since none is seen
    (0.0374, 0.0665, 0.1183),  # residual limb: two meshes, order 2
)
"""Half the width of the torque's loop over its limit, less one."""
MEASURED_ON = (
    "the largest of three limbs, one spot each: forearm phantom, real forearm, residual limb; Yeoh's "
    "material, sphere of 7.5 mm pressed 10 mm deep and twisted by 22.5 degrees both ways, friction 1. At "
    "edges of 0.3 radii the torque of real limbs is off by 4 to 7 %, that of the phantom by 3 %"
)


def write_limb(path: Path, limb: Limb) -> None:
    """Write a mesh for the limb source ``meshio``: cell data ``region`` and fields, point data for sets."""
    import meshio

    mesh = limb.mesh
    point_data = {}
    for name, nodes in mesh.node_sets.items():
        point_data[name] = np.zeros(mesh.n_nodes, dtype=np.uint8)
        point_data[name][nodes] = 1
    cell_data = {name: [of[kind] for kind in mesh.cells] for name, of in mesh.cell_fields.items()}
    cell_data["region"] = [mesh.cell_regions[kind].astype(np.int32) for kind in mesh.cells]
    meshio.Mesh(
        mesh.points_mm,
        [(CELLS[kind].meshio, cells) for kind, cells in mesh.cells.items()],
        point_data=point_data,
        cell_data=cell_data,
    ).write(path)


def note(scan: ReadScan, made: ScannedLimb, radius_mm: float) -> dict[str, Any]:
    """What is known of a limb apart from its mesh, as plain values."""
    (kind,) = made.limb.mesh.cells
    found = made.found
    return {
        "spot": found.spot.name,
        "position_in_scan_mm": found.spot.position_mm.tolist(),
        "normal_in_scan": found.spot.normal.tolist(),
        "std_across_mm": found.across_mm,
        "std_along_normal_mm": found.along_normal_mm,
        "std_normal_deg": found.normal_deg,
        "scan_to_mesh": made.segment.to_spot.tolist(),
        "moved_to_touch_mm": made.rise_mm,
        "bones": [bone.name for bone in made.segment.bones],
        "unit": scan.unit,
        "unit_guessed": bool(scan.unit_why),
        "remarks": list(made.segment.remarks),
        "repairs": {s.name: s.repairs for s in (scan.surface, *scan.bones) if s.repairs},
        "bones_to_scan": scan.placement.motion.tolist(),
        "bones_residual_mm": scan.placement.residual_mm,
        "quality": asdict(made.quality),
        "mesh_error": mesh_error(made.quality.contact_edge_mm, radius_mm, kind),
    }


def study_tables(names: Sequence[str], regions: tuple[str, ...], folders: Iterable[Path]) -> str:
    """The tables of study.toml that read the meshes: of ``folders`` the second has the finer ones."""
    spots = [
        f'[[spot]]\nname = "{name}"\n'
        + "".join(
            f'{key} = "{(folder / name).as_posix()}.vtu"\n'
            for key, folder in zip(("mesh", "fine_mesh"), folders, strict=False)
        )
        for name in names
    ]
    numbers = ", ".join(f"{region} = {i}" for i, region in enumerate(regions))
    return "\n".join([*spots, f'[limb]\nsource = "meshio"\n\n[limb.settings]\nregions = {{ {numbers} }}\n'])


def mesh_error(edge_mm: float, radius_mm: float, kind: str) -> dict[str, Any]:
    """What a mesh with such edges under the sphere adds to force and torque.

    ``force`` and ``torque`` are shares of themselves, interpolated between the sizes studied, with what they
    were measured on; both None for sizes or elements outside of the study.
    """
    ratio = edge_mm / radius_mm
    studied = kind == "tet10" and 0.9 * RATIOS[0] <= ratio <= 1.1 * RATIOS[-1]
    return {
        "edge_over_radius": ratio,
        "force": float(np.interp(ratio, RATIOS, np.max(FORCE, axis=0))) if studied else None,
        "torque": float(np.interp(ratio, RATIOS, np.max(TORQUE, axis=0))) if studied else None,
        "measured_on": MEASURED_ON,
    }
