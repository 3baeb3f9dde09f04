"""Refines tetrahedra under an indenter: longest edges are bisected until none there is too long.

An edge is bisected in all elements that share it, once it is the longest of each: the mesh conforms
after every pass, and its elements do not flatten (Rivara 1984; in three dimensions Rivara and Levin
1992). Each half keeps its part of the quadratic map of the element, so that the limb keeps its shape.
"""

from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
import scipy

from palpate.domain import BoolArray, FloatArray, IntArray, Limb, Mesh
from palpate.errors import MeshError
from palpate.mesh.midside_nodes import quadratic, surface_sets
from palpate.mesh.spot_frame import contact_edge_mm
from palpate.mesh.topology import CELLS

MOST_CELLS = 300_000
"""Elements up to which a mesh is refined: more than a solver can take."""

EDGE_OVER_REACH = 0.225
"""Longest edge under an indenter over its reach, by default: torque within 0.8 % on a forearm's phantom."""

_EDGES = CELLS["tet10"].edges
_MIDDLE = {frozenset(edge): 4 + k for k, edge in enumerate(_EDGES)}


def _turned(first: tuple[int, int]) -> list[int]:
    """Nodes of an element (10,), turned so that an edge is the first; never mirrored."""
    turns = (list(turn) for turn in permutations(range(4)) if np.linalg.det(np.eye(4)[list(turn)]) > 0.0)
    corners = next(turn for turn in turns if tuple(turn[:2]) == first)
    return corners + [_MIDDLE[frozenset((corners[a], corners[b]))] for a, b in _EDGES]


_TURNED = np.array([_turned(edge) for edge in _EDGES])
_ACROSS = np.array([-0.125, -0.125, 0.0, 0.25, 0.5, 0.5])
"""Those of a face's corners a, b, c and middles ab, bc, ac, between ab and c."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Elements:
    """Quadratic tetrahedra between two passes.

    Parameters
    ----------
    points : (n, 3) array
    cells : (m, 10) integer array
    origin : (m,) integer array
        The element of the unrefined mesh that each is a part of.
    in_sets : (n, n_sets) boolean array
        Whether a node is in each node set.
    on_surface : (n_sets,) boolean array
        Whether a node set has nodes on the surface alone.
    """

    points: FloatArray
    cells: IntArray
    origin: IntArray
    in_sets: BoolArray
    on_surface: BoolArray


def automatic_edge_mm(limb: Limb, reach_mm: float, near_mm: float) -> float:
    """Longest edge to which a mesh is refined where none is named; 0 unless all cells are tetrahedra.

    Parameters
    ----------
    reach_mm : float
        Distance from the spot up to which the indenter touches, at most.
    near_mm : float
        Distance from the spot up to which edges are under the indenter.
    """
    if limb.mesh.cells.keys() not in ({"tet4"}, {"tet10"}):
        return 0.0
    # Nor longer than the mesh's mean edge: two meshes of nearly one size would not tell the error.
    return min(EDGE_OVER_REACH * reach_mm, contact_edge_mm(limb, near_mm))


def refined(limb: Limb, near_mm: float, edge_mm: float, beyond_mm: float = 0.0) -> Limb:
    """Bisect edges until none near the spot is longer than asked for, at the contact surface.

    Below it, and nearer to the spot than ``beyond_mm``, edges may be longer by their distance
    from there. A new node is in a node set if all nodes of its edge, or of its face, are.

    Parameters
    ----------
    limb : Limb
        Of tetrahedra of one kind, straight or curved.
    near_mm : float
        Distance from the spot that an edge comes within.
    edge_mm : float
        Longest edge, between its ends.
    beyond_mm : float
        Distance from the spot that an edge reaches; below ``near_mm`` an annulus is left, 0: a disc.

    Raises
    ------
    MeshError
        The mesh has other elements, or would get too many.
    """
    mesh = limb.mesh
    if not mesh.cells.keys() <= {"tet4", "tet10"} or len(mesh.cells) != 1:
        raise MeshError(
            f"elements of kind {', '.join(sorted(mesh.cells))} cannot be refined, only tet4 or only tet10; "
            "mesh the limb again with smaller elements"
        )
    now, contact = _quadratic(limb), list(mesh.node_sets).index("contact")
    where = limb.spot.position_mm, near_mm, beyond_mm
    while (wanted := _too_long(now, contact, *where, edge_mm)).any():
        now = _bisected(now, *_longest(now, wanted))
        if len(now.cells) > MOST_CELLS:
            raise MeshError(
                f"edges of {edge_mm:g} mm within {near_mm:g} mm of spot '{limb.spot.name}' need more than "
                f"{MOST_CELLS} elements; ask for longer edges"
            )
    return replace(limb, mesh=_mesh(mesh, now))


def _quadratic(limb: Limb) -> _Elements:
    """The elements of a mesh; straight ones with nodes in the middle of their edges."""
    mesh = quadratic(limb.mesh)
    cells, in_sets = mesh.cells["tet10"], np.zeros((mesh.n_nodes, len(mesh.node_sets)), dtype=np.bool_)
    for k, nodes in enumerate(mesh.node_sets.values()):
        in_sets[nodes, k] = True
    return _Elements(
        points=mesh.points_mm,
        cells=cells,
        origin=np.arange(len(cells)),
        in_sets=in_sets,
        on_surface=np.array(list(map(surface_sets(mesh).__contains__, mesh.node_sets)), dtype=np.bool_),
    )


def _mesh(mesh: Mesh, now: _Elements) -> Mesh:
    """The elements as a mesh, of the kind that they were made from."""
    ((kind, cells),) = mesh.cells.items()
    kept, numbers = np.unique(now.cells[:, : cells.shape[1]], return_inverse=True)
    return replace(
        mesh,
        points_mm=now.points[kept],
        cells={kind: numbers.reshape(-1, cells.shape[1])},
        cell_regions={kind: mesh.cell_regions[kind][now.origin]},
        node_sets={name: np.flatnonzero(now.in_sets[kept, k]) for k, name in enumerate(mesh.node_sets)},
        cell_fields={name: {kind: of[kind][now.origin]} for name, of in mesh.cell_fields.items()},
    )


def _edges_of(now: _Elements) -> tuple[IntArray, IntArray]:
    """Ends (n_edges, 2) of every edge, and the edges (m, 6) of each element."""
    pairs = np.sort(now.cells[:, np.array(_EDGES)], axis=2).reshape(-1, 2)
    keys, edges = np.unique(pairs @ [len(now.points), 1], return_inverse=True)
    return np.stack(np.divmod(keys, len(now.points)), axis=1), edges.reshape(-1, 6)


def _too_long(
    now: _Elements, contact: int, spot_mm: FloatArray, near_mm: float, beyond_mm: float, edge_mm: float
) -> BoolArray:
    """Mask (n_edges,) of the edges that are longer than they may be where they are."""
    ends, _ = _edges_of(now)
    first, other = now.points[ends.T]
    along = other - first
    squares = (along**2).sum(axis=1)
    share = np.clip(((spot_mm - first) * along).sum(axis=1) / squares, 0.0, 1.0)
    away = ((first + share[:, None] * along - spot_mm) ** 2).sum(axis=1)
    wanted: BoolArray = (squares > edge_mm**2) & (away <= near_mm**2)
    depths = np.asarray(
        scipy.spatial.cKDTree(now.points[now.in_sets[:, contact]]).query(now.points[ends[wanted]])[0]
    )
    reached = np.linalg.norm(now.points[ends[wanted]] - spot_mm, axis=2).max(axis=1)
    away = np.maximum(depths.min(axis=1), beyond_mm - reached)
    wanted[wanted] = squares[wanted] > (edge_mm + away) ** 2
    return wanted


def _longest(now: _Elements, wanted: BoolArray) -> tuple[IntArray, IntArray]:
    """Elements (k,) to bisect, and which edge (k,) of each, on the way to bisecting the wanted edges."""
    ends, edges = _edges_of(now)
    first, other = now.points[ends.T]
    squares = ((other - first) ** 2).sum(axis=1)
    # Rounded, so that equal edges of a regular mesh rank by their nodes on every machine.
    rank = np.empty(len(ends), dtype=np.int64)
    rank[np.lexsort((ends[:, 1], ends[:, 0], np.round(squares / squares.max(), 12)))] = np.arange(len(ends))
    local = rank[edges].argmax(axis=1)
    longest = edges[np.arange(len(edges)), local]
    reached = np.zeros_like(wanted)
    while not np.array_equal(reached, wanted):
        reached, wanted = wanted, wanted.copy()
        wanted[longest[wanted[edges].any(axis=1)]] = True
    wanted &= np.bincount(longest, minlength=len(ends)) == np.bincount(edges.ravel())
    chosen = np.flatnonzero(wanted[longest])
    return chosen, local[chosen]


def _bisected(now: _Elements, chosen: IntArray, local: IntArray) -> _Elements:
    """Bisect an edge of each chosen element, in all elements that share it."""
    a, b, c, d, ab, bc, ac, ad, bd, cd = np.take_along_axis(now.cells[chosen], _TURNED[local], axis=1).T
    edges = np.stack([np.concatenate([a, b]), np.concatenate([b, a]), np.concatenate([ab, ab])], axis=1)
    faces = np.stack(
        [np.concatenate(pair) for pair in ((a, a), (b, b), (c, d), (ab, ab), (bc, bd), (ac, ad))], axis=1
    )
    edges, on_edge, _ = _listed_once(edges, edges[:, [0, 2]], len(now.points))
    faces, on_face, n_shared = _listed_once(faces, faces[:, [3, 2]], len(now.points))
    # Shape functions of an edge's ends and middle, a quarter of its length from its first end.
    quarters = np.einsum("k,nkd->nd", np.array([0.375, -0.125, 0.75]), now.points[edges])
    points = np.vstack([now.points, quarters, np.einsum("k,nkd->nd", _ACROSS, now.points[faces])])
    inner = (n_shared > 1)[:, None] & now.on_surface
    in_sets = np.vstack(
        [now.in_sets, now.in_sets[edges].all(axis=1), now.in_sets[faces].all(axis=1) & ~inner]
    )
    near_a, near_b = np.split(len(now.points) + on_edge, 2)
    to_c, to_d = np.split(len(now.points) + len(edges) + on_face, 2)
    halves = [
        np.stack([a, ab, c, d, near_a, to_c, ac, ad, to_d, cd], axis=1),
        np.stack([ab, b, c, d, near_b, bc, to_c, to_d, bd, cd], axis=1),
    ]
    whole = np.ones(len(now.cells), dtype=np.bool_)
    whole[chosen] = False
    origin = np.concatenate([now.origin[whole], now.origin[chosen], now.origin[chosen]])
    cells = np.concatenate([now.cells[whole], *halves])
    return replace(now, points=points, cells=cells, origin=origin, in_sets=in_sets)


def _listed_once(rows: IntArray, pairs: IntArray, n_points: int) -> tuple[IntArray, IntArray, IntArray]:
    """Rows without repeats of their pair, each row's place in them, and how often each was there."""
    _, first, place, count = np.unique(
        pairs @ [n_points, 1], return_index=True, return_inverse=True, return_counts=True
    )
    return rows[first], place, count
