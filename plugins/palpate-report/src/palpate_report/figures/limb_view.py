"""A limb as something to look at: its surfaces as triangles, its spot, the normal and the indenter.

A face that one element alone has is on the outside, one between two regions on an
interface. A face belongs to the smallest node set that holds all of its corners, so
that a bone is separate from the other nodes that are held still.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from palpate.api import FloatArray, Indenter, IntArray, Limb, Mesh, MeshError, Spot
from palpate.api.mesh import CELLS, barycentric, quadratic_simplex, spot_axes
from palpate_report.data.marks import in_words

Role = Literal["contact", "fixed", "free", "interface", "indenter"]

LOOKS: Mapping[Role, tuple[str, float]] = MappingProxyType(
    {
        "contact": ("#deb599", 0.45),
        "fixed": ("#efe9d6", 1.0),
        "free": ("#c98276", 0.45),
        "interface": ("#d9a5a0", 0.3),
        "indenter": ("#597399", 0.8),
    }
)
"""Colour and opacity of a role."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ViewPart:
    """Triangles that are one thing.

    Parameters
    ----------
    name : str
        As in a legend: ``contact``, ``ulna``, ``cut``, ``skin | soft_tissue``, ``sphere``.
    role : {"contact", "fixed", "free", "interface", "indenter"}
    region : str
        Of the elements behind it; at an interface, of the one named first; empty for the indenter.
    points_mm : (n, 3) array
    triangles : (m, 3) integer array
        Outward by the right-hand rule.
    """

    name: str
    role: Role
    region: str
    points_mm: FloatArray
    triangles: IntArray


def limb_view(limb: Limb, indenter: Indenter | None = None, most: int = 0) -> tuple[ViewPart, ...]:
    """Surfaces of a limb, and the indenter at rest on its spot, where one is given.

    Faces with midside nodes are curved as far as that makes no more than ``most`` triangles.

    Raises
    ------
    MeshError
        The mesh has a kind of element that has no known faces.
    """
    body = () if indenter is None else (_indenter(limb.spot, indenter),)
    return (*_surfaces(limb.mesh, most), *body)


def traces(limb: Limb, parts: Sequence[ViewPart], arrow_mm: float) -> list[dict[str, Any]]:
    """Traces for Plotly as plain values: a ``mesh3d`` of each part, the spot, and its normal as an arrow."""
    spot, look = limb.spot, {"size": 5, "color": "#207040"}
    normal = np.stack([spot.position_mm, spot.position_mm + arrow_mm * spot.normal])
    return [
        *map(_trace, parts),
        _points(f"mark {spot.name}", normal[:1], "markers") | {"marker": look},
        _points("normal", normal, "lines") | {"line": {"width": 6, "color": "#202020"}},
    ]


def _surfaces(mesh: Mesh, most: int) -> Iterator[ViewPart]:
    faces, regions, inner = _shown_faces(mesh)
    triangles = faces[:, :3]
    # Most pieces of an edge of a curved face.
    n_pieces = int(np.clip(np.sqrt(most / max(len(faces), 1)), 1, 4))
    outside = inner < 0
    labels = _labels(mesh, triangles)
    for label in dict.fromkeys(labels[outside]):
        own = outside & (labels == label)
        for region in np.unique(regions[own]):
            name, chosen = label or mesh.regions[region], own & (regions == region)
            yield _part(mesh, name, _role(mesh, label), mesh.regions[region], faces[chosen], n_pieces)
    for a, b in np.unique(np.stack([regions, inner], axis=1)[~outside], axis=0):
        chosen = (regions == a) & (inner == b)
        name = f"{mesh.regions[a]} | {mesh.regions[b]}"
        yield _part(mesh, name, "interface", mesh.regions[a], faces[chosen], n_pieces)


def _shown_faces(mesh: Mesh) -> tuple[IntArray, IntArray, IntArray]:
    """Faces (n, 6) on the outside and between regions, their region, and the other one's or −1.

    Three corners, then midside nodes, which are −1 where there are none.
    """
    faces, owners = _all_faces(mesh)
    keys = np.sort(faces[:, :4], axis=1)
    order = np.lexsort(keys.T)
    same = (keys[order][1:] == keys[order][:-1]).all(axis=1)
    other = np.full(len(faces), -1)
    other[order[:-1][same]] = owners[order[1:][same]]
    other[order[1:][same]] = owners[order[:-1][same]]
    shown = (other < 0) | (owners < other)  # an interface once, from the side of the region named first
    faces, owners, other = faces[shown], owners[shown], other[shown]
    quads = faces[:, 3] >= 0
    halves = np.full((np.count_nonzero(quads), 7), -1)
    halves[:, :3] = faces[quads][:, [0, 2, 3]]
    return (
        np.delete(np.concatenate([faces, halves]), 3, axis=1),
        np.concatenate([owners, owners[quads]]),
        np.concatenate([other, other[quads]]),
    )


def _all_faces(mesh: Mesh) -> tuple[IntArray, IntArray]:
    """Faces (n, 7) of every element, and their elements' regions (n,).

    Four corners, the last −1 in a triangle, then the midside nodes of a triangle, −1 where there are none.
    """
    faces, owners = [], []
    for kind, cells in mesh.cells.items():
        if kind not in CELLS:
            raise MeshError(f"mesh: elements of kind '{kind}' cannot be drawn; use {', '.join(CELLS)}")
        n = CELLS[kind].n_face_corners
        for nodes in CELLS[kind].faces:
            block = np.full((len(cells), 7), -1, dtype=np.int64)
            block[:, :n] = cells[:, list(nodes[:n])]
            block[:, 4 : 4 + len(nodes) - n] = cells[:, list(nodes[n:])]
            faces.append(block)
            owners.append(mesh.cell_regions[kind])
    return np.concatenate(faces), np.concatenate(owners)


def _labels(mesh: Mesh, triangles: IntArray) -> "np.ndarray[tuple[int], np.dtype[np.object_]]":
    """The smallest node set that holds each triangle, or nothing."""
    labels = np.full(len(triangles), "", dtype=object)
    for name, nodes in sorted(mesh.node_sets.items(), key=lambda item: -item[1].size):
        labels[np.isin(triangles, nodes).all(axis=1)] = name
    return labels


def _role(mesh: Mesh, label: str) -> Role:
    if label == "contact":
        return "contact"
    fixed = label and np.isin(mesh.node_sets[label], mesh.node_sets.get("fixed", ())).all()
    return "fixed" if fixed else "free"


def _part(mesh: Mesh, name: str, role: Role, region: str, faces: IntArray, n_pieces: int) -> ViewPart:
    """Triangles of faces (n, 6) with the points that they use alone."""
    curved = faces[:, 3] >= 0
    points, triangles = _pieces(mesh.points_mm[faces[curved]], n_pieces)
    points = np.concatenate([mesh.points_mm[faces[~curved, :3]].reshape(-1, 3), points])
    flat = np.arange(3 * np.count_nonzero(~curved)).reshape(-1, 3)
    used, numbers = np.unique(np.round(points, 9), axis=0, return_inverse=True)
    corners = np.concatenate([flat, flat.size + triangles])
    return ViewPart(
        name=name,
        role=role,
        region=region,
        points_mm=used,
        triangles=numbers.ravel()[corners].astype(np.int64),
    )


def _pieces(faces_mm: FloatArray, n: int) -> tuple[FloatArray, IntArray]:
    """Points and triangles of quadratic faces (k, 6, 3) whose edges are in n pieces."""
    lattice = [(i, j) for i in range(n + 1) for j in range(n + 1 - i)]
    values, _ = quadratic_simplex(barycentric(np.array(lattice) / n), ((0, 1), (1, 2), (2, 0)))
    at = {place: number for number, place in enumerate(lattice)}
    inner = [
        corners
        for i, j in lattice
        for corners in (((i, j), (i + 1, j), (i, j + 1)), ((i + 1, j), (i + 1, j + 1), (i, j + 1)))
        if all(place in at for place in corners)
    ]
    one = np.array([[at[place] for place in corners] for corners in inner])
    first = len(lattice) * np.arange(len(faces_mm))[:, None, None]
    return np.einsum("qn,knx->kqx", values, faces_mm).reshape(-1, 3), (first + one).reshape(-1, 3)


def _indenter(spot: Spot, indenter: Indenter) -> ViewPart:
    """The indenter at rest on a spot."""
    points, triangles = indenter.surface()
    return ViewPart(
        name=indenter.name,
        role="indenter",
        region="",
        points_mm=spot.position_mm + points @ spot_axes(spot.normal, spot.along).T,
        triangles=triangles,
    )


def _trace(part: ViewPart) -> dict[str, Any]:
    colour, opacity = LOOKS[part.role]
    about = part.name if part.region in ("", part.name) else f"{part.name} ({in_words(part.region)})"
    return {
        "type": "mesh3d",
        "name": about,
        **dict(zip("xyz", np.round(part.points_mm, 2).T.tolist(), strict=True)),
        **dict(zip("ijk", part.triangles.T.tolist(), strict=True)),
        "color": "#c98276" if part.name == "cut" else colour,
        "opacity": opacity,
        "flatshading": part.role != "indenter",
        "showlegend": True,
        "hoverinfo": "name",
        **({"visible": "legendonly"} if part.role == "interface" else {}),
    }


def _points(name: str, points_mm: FloatArray, mode: str) -> dict[str, Any]:
    """Trace for Plotly of points (n, 3), as plain values."""
    x, y, z = np.round(points_mm, 2).T.tolist()
    return {"type": "scatter3d", "name": name, "mode": mode, "x": x, "y": y, "z": z, "hoverinfo": "name"}
