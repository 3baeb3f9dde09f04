"""A limb's mesh as VTU, with regions and node sets, and a JSON note of what it was made from."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from palpate.api import Limb
from palpate.mesh.topology import CELLS
from palpate_limb.from_scan import ReadScan, ScannedLimb
from palpate_limb.mesh_error import mesh_error


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
