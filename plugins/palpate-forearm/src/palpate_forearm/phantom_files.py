"""The phantom as the files that a laboratory would have: a coloured scan and a model of each bone."""

import json
from pathlib import Path

import numpy as np

from palpate_forearm.phantom import Phantom, Scanner, Surface, scan


def write_phantom(folder: Path, phantom: Phantom | None = None, scanner: Scanner | None = None) -> None:
    """Write ``scan.ply``, ``<bone>.stl`` and ``spots.json`` with the exact spots.

    Parameters
    ----------
    folder : Path
        Made if it is missing.
    """
    phantom = phantom or Phantom()
    folder.mkdir(parents=True, exist_ok=True)
    write_ply(folder / "scan.ply", scan(phantom, scanner))
    for bone in phantom.bones:
        write_stl(folder / f"{bone.name}.stl", phantom.bone_surface(bone.name))
    spots = {
        s.name: {"position_mm": s.position_mm.tolist(), "normal": s.normal.tolist()} for s in phantom.spots
    }
    (folder / "spots.json").write_text(json.dumps(spots, indent=1) + "\n")


def write_ply(path: Path, surface: Surface) -> None:
    """Write a binary PLY file, with the colours if there are any."""
    fields = [(axis, "<f4", "float") for axis in "xyz"]
    if surface.colours is not None:
        fields += [(colour, "u1", "uchar") for colour in ("red", "green", "blue")]
    vertices = np.zeros(len(surface.points_mm), dtype=[(name, kind) for name, kind, _ in fields])
    for axis, values in zip("xyz", surface.points_mm.T, strict=True):
        vertices[axis] = values
    if surface.colours is not None:
        for name, values in zip(("red", "green", "blue"), surface.colours.T, strict=True):
            vertices[name] = np.round(255.0 * values)
    faces = np.zeros(len(surface.faces), dtype=[("n", "u1"), ("nodes", "<i4", 3)])
    faces["n"], faces["nodes"] = 3, surface.faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *(f"property {kind} {name}" for name, _, kind in fields),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    path.write_bytes("\n".join(header).encode() + vertices.tobytes() + faces.tobytes())


def write_stl(path: Path, surface: Surface) -> None:
    """Write a binary STL file: triangles alone, each with corners of its own."""
    corners = surface.points_mm[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    triangles = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("n", "<u2")])
    triangles["normal"], triangles["corners"] = normals, corners
    path.write_bytes(b"palpate phantom".ljust(80) + np.uint32(len(triangles)).tobytes() + triangles.tobytes())
