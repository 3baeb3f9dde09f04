"""Cell data of a mesh for materials, and the frame of their directions."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.domain import FloatArray, Limb, Mesh, RegionMaterial
from palpate.errors import MeshError, StudyError


def with_fields(limb: Limb, regions: Iterable[RegionMaterial]) -> Limb:
    """Limb with only the cell fields that its materials use, checked.

    Raises
    ------
    MeshError
        A field is missing or has no finite value, or no direction, in an element.
    """
    mesh, kept = limb.mesh, {}
    for region in regions:
        for name in region.material.fields if region.region in mesh.used_regions else ():
            if name not in mesh.cell_fields:
                there = ", ".join(mesh.cell_fields) or "none"
                raise MeshError(
                    f"mesh: material '{region.material.name}' of region '{region.region}' takes cell data "
                    f"'{name}', which the mesh does not have (there: {there}); write them to its file"
                )
            kept[name] = mesh.cell_fields[name]
            _check_values(mesh, region.region, name)
    return replace(limb, mesh=replace(mesh, cell_fields=kept))


def _check_values(mesh: Mesh, region: str, name: str) -> None:
    for kind, cells in mesh.cells.items():
        values = mesh.cell_fields[name].get(kind, np.empty(0))
        if values.shape not in ((len(cells),), (len(cells), 3)):
            raise MeshError(
                f"mesh: cell data '{name}' of {kind} has shape {values.shape}; give ({len(cells)},) or "
                f"({len(cells)}, 3)"
            )
        rows = values.reshape(len(cells), -1)
        bad = ~np.isfinite(rows).all(axis=1)
        if rows.shape[1] == 3:
            bad |= ~rows.any(axis=1)
        bad &= mesh.cell_regions[kind] == mesh.regions.index(region)
        if bad.any():
            raise MeshError(
                f"mesh: cell data '{name}' is {rows[bad][0].tolist()} in {kind} element "
                f"{np.flatnonzero(bad)[0]} of region '{region}'; give finite numbers, and no vector of zeros"
            )


def check_frames(
    region: RegionMaterial,
    meshes: Mapping[str, Path],
    notes: Iterable[Mapping[str, Any] | None],
    *,
    one_frame: bool,
) -> None:
    """Refuse one direction for several meshes that may be in different frames.

    Parameters
    ----------
    region : RegionMaterial
        With directions in its settings.
    one_frame : bool
        Whether the study declares that all meshes are in one frame.

    Raises
    ------
    StudyError
    """
    n_meshes = len(set(meshes.values()))
    known = [turn for note in notes if (turn := _turn(note)) is not None]
    differ = any(not np.allclose(turn, known[0], atol=1e-6) for turn in known[1:])
    if n_meshes < 2 or (not differ and (one_frame or len(known) == len(meshes))):
        return
    raise StudyError(
        f"region '{region.region}': the directions of material '{region.material.name}' are in the frame of "
        f"the mesh, and the spots have {n_meshes} meshes, "
        + ("whose notes give different frames" if differ else "each of which may have another frame")
        + "; write the directions to each mesh as cell data"
        + ("" if differ else ", or set one_frame = true under [limb] if all meshes share a frame")
    )


def _turn(note: Mapping[str, Any] | None) -> FloatArray | None:
    """Rotation (3, 3) from the scan's frame to the mesh's; None if the note does not have it."""
    try:
        turn = np.array((note or {})["scan_to_mesh"], dtype=np.float64)
    except (KeyError, TypeError, ValueError):
        return None
    return turn[:3, :3] if turn.shape == (4, 4) else None
