"""Colours of a scan's points as scanners spell them: properties of PLY, columns of OBJ and OFF."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.api import FloatArray, MeshError

GEOMETRY = frozenset({"x", "y", "z", "nx", "ny", "nz", "s", "t", "u", "v", "texture_u", "texture_v"})


def point_colours(path: Path, mesh: Any) -> FloatArray | None:  # noqa: ANN401 - a Trimesh
    """SRGB (n, 3) of each point of a mesh, 0 to 1, as its file writes them; None where it writes none.

    Raises
    ------
    MeshError
        The columns may be colours in two ways.
    """
    from scipy.spatial import cKDTree

    if (elements := _ply(mesh)) is not None:
        return _of_ply(elements, mesh)
    rows = {".obj": _obj_rows, ".off": _off_rows}.get(path.suffix.lower(), lambda _: None)(path)
    if rows is None:
        return None
    points, colours = rows
    # Readers split and sort points; equal points have one colour.
    return np.asarray(_scaled(colours)[cKDTree(points).query(np.asarray(mesh.vertices))[1]])


def other_columns(mesh: Any) -> tuple[str, ...]:  # noqa: ANN401 - a Trimesh
    """Properties of a PLY's points that are no coordinates, for a message."""
    elements = _ply(mesh) or {}
    return tuple(n for n in elements.get("vertex", {}).get("properties", ()) if n.lower() not in GEOMETRY)


def _ply(mesh: Any) -> Mapping[str, Any] | None:  # noqa: ANN401 - a Trimesh
    """Elements of a PLY as trimesh keeps them."""
    return mesh.metadata.get("_ply_raw")


def _of_ply(elements: Mapping[str, Any], mesh: Any) -> FloatArray | None:  # noqa: ANN401 - a Trimesh
    """Colours of the points, or the mean colour of the faces around each."""
    for element in ("vertex", "face"):
        of = elements.get(element, {})
        names = _channels(list(of.get("properties", ())))
        if not names or not of.get("length"):
            continue
        kinds = {str(of["properties"][name]) for name in names}
        columns = [np.asarray(of["data"][name], dtype=np.float64).ravel() for name in names]
        found = _scaled(np.stack(columns, axis=1), _largest(kinds))
        if element == "vertex":
            return found if len(found) == len(mesh.vertices) else None
        if len(found) == len(mesh.faces):
            corners = np.asarray(mesh.faces).ravel()
            counts = np.maximum(np.bincount(corners, minlength=len(mesh.vertices)), 1)
            sums = [np.bincount(corners, np.repeat(c, 3), minlength=len(mesh.vertices)) for c in found.T]
            return np.stack(sums, axis=1) / counts[:, None]
    return None


def _channels(names: Sequence[str]) -> list[str]:
    """Names of red, green and blue among properties: with one beginning, such as diffuse_, and any case."""
    for spelling in (("r", "g", "b"), ("red", "green", "blue")):
        for name in names:
            if (found := re.fullmatch(rf"(?i)(.*?){spelling[0]}", name)) is None:
                continue
            wanted = [f"{found[1]}{channel}".lower() for channel in spelling]
            chosen = [next((n for n in names if n.lower() == each), None) for each in wanted]
            if all(chosen):
                return [str(each) for each in chosen]
    return []


def _largest(kinds: set[str]) -> float | None:
    """Value of full intensity of whole numbers; None for others."""
    known = {"u1": 255.0, "u2": 65535.0}
    found = {known.get(kind.lstrip("<>|=")) for kind in kinds}
    return found.pop() if len(found) == 1 else None


def _scaled(colours: FloatArray, largest: float | None = None) -> FloatArray:
    """Colours from 0 to 1; without a type, values above 1 are from 0 to 255, above that from 0 to 65535."""
    if largest is None:
        most = float(np.nanmax(colours, initial=0.0))
        largest = 1.0 if most <= 1.0 else 255.0 if most <= 255.0 else 65535.0
    return np.clip(np.nan_to_num(colours / largest), 0.0, 1.0)


def _obj_rows(path: Path) -> tuple[FloatArray, FloatArray] | None:
    """Points and colours of the lines v: x y z, a weight or not, red, green, blue, opacity or not."""
    lines = re.findall(rb"^[ \t]*v[ \t]+([^\r\n#]+)", path.read_bytes(), re.MULTILINE)
    table = _table(lines)
    if table is None or table.shape[1] not in (6, 7, 8):
        return None
    start = 3
    if table.shape[1] == 8:
        start = 4
    elif table.shape[1] == 7:
        # Such a column is 1, or 255, throughout.
        is_weight, is_opacity = ((c == c[0]).all() and c[0] in (1.0, 255.0) for c in table[:, (3, 6)].T)
        if is_weight and is_opacity:
            raise MeshError(
                f"{path}: lines v have seven numbers, of which the fourth and the last are one number each; "
                "write x y z r g b, without a weight and without opacity"
            )
        start = 4 if is_weight else 3
    return table[:, :3], table[:, start : start + 3]


def _off_rows(path: Path) -> tuple[FloatArray, FloatArray] | None:
    """Points and colours of a COFF: x y z, a normal where the header has N, red, green, blue."""
    text = re.sub(rb"#[^\r\n]*", b"", path.read_bytes()).strip()
    head = re.match(rb"(ST)?(C)?(N)?OFF\b(?! BINARY)", text)
    if head is None:
        return None
    lines = [line for line in text[head.end() :].splitlines() if line.strip()]
    table = _table(lines[1 : 1 + int(lines[0].split()[0])])
    start = 6 if head[3] else 3
    if table is None or table.shape[1] < start + 3 or (head[1] and not head[2]):
        return None
    return table[:, :3], table[:, start : start + 3]


def _table(lines: Sequence[bytes]) -> FloatArray | None:
    """Numbers of lines as long as the first one; None where some differ or are no numbers."""
    try:
        return np.array([line.split() for line in lines], dtype=np.float64)
    except ValueError:
        return None
