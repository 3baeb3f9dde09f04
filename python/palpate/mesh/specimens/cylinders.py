"""Round specimens, fine where an indenter touches and coarse far away: O-grids of hexahedra.

Seen from above, a square core of ``n_core`` × ``n_core`` cells passes into
rings of 4 ``n_core`` cells, so that no cell degenerates at the axis and the
rings follow the edge of the contact. A hexahedron may be split into six tet10.
"""

from typing import Literal

import numpy as np

from palpate.domain import BoolArray, FloatArray, IntArray, Limb, Mesh, Spot
from palpate.errors import MeshError
from palpate.mesh.splitting import cut
from palpate.mesh.topology import CELLS, with_midpoints

Kind = Literal["hex8", "tet10"]

_ROUND_AFTER = 2.0
"""From here on rings are circles, in half-widths of the core."""

_INWARD_FACES = np.array(CELLS["hex8"].corner_faces)[:, [0, 3, 2, 1]]
_INWARD_FACES.setflags(write=False)


def spacing(
    edge_mm: float, n_inside: int, extent_mm: float, *, growth: float, crowding: float = 1.0
) -> FloatArray:
    """Coordinates from 0 through ``edge_mm`` to ``extent_mm``: cells that grow away from the edge.

    Parameters
    ----------
    edge_mm : float
        Where the contact ends; one of the coordinates.
    n_inside : int
        Cells between 0 and the edge.
    extent_mm : float
        The last coordinate.
    growth : float
        Ratio of adjacent cells outside, at least 1.
    crowding : float
        Ratio of adjacent cells inside, at least 1; above 1 they shrink towards the edge.

    Returns
    -------
    (n,) array
        Strictly rising.

    Raises
    ------
    MeshError
        Nothing is beyond the edge, or cells would not grow.

    Examples
    --------
    >>> spacing(1.0, 2, 3.0, growth=2.0).round(3)
    array([0.   , 0.5  , 1.   , 1.667, 3.   ])
    """
    if not (extent_mm > edge_mm > 0.0 and growth >= 1.0 and crowding >= 1.0 and n_inside >= 1):
        raise MeshError(
            f"specimen: edge {edge_mm} mm, extent {extent_mm} mm, growth {growth}, crowding {crowding}, "
            f"{n_inside} cells inside; give 0 < edge < extent, ratios of at least 1 and at least one cell"
        )
    inside = np.cumsum(crowding ** -np.arange(n_inside, dtype=np.float64))
    inside = edge_mm * np.concatenate([[0.0], inside / inside[-1]])
    return np.concatenate([inside, _growing(edge_mm, growth * (inside[-1] - inside[-2]), extent_mm, growth)])


def _growing(start_mm: float, first_mm: float, end_mm: float, growth: float) -> FloatArray:
    """Coordinates beyond ``start_mm`` to ``end_mm``, whose first cell is at most ``first_mm``."""
    cells = [first_mm]
    while sum(cells) < (end_mm - start_mm) * (1.0 - 1e-9):
        cells.append(growth * cells[-1])
    return np.asarray(start_mm + np.cumsum(cells) * (end_mm - start_mm) / sum(cells))


def cylinder(kind: Kind, rings_mm: FloatArray, depths_mm: FloatArray, *, n_core: int) -> Limb:
    """An upright cylinder held at its base and its wall, its spot in the middle of the upper face.

    Parameters
    ----------
    rings_mm : (n + 1,) array
        Radii of the rings, rising from 0; n > ``n_core``/2.
    depths_mm : (m + 1,) array
        Depths of the layers of nodes, rising from 0.
    n_core : int
        Cells across the core (even); a ring has four times as many. Eight around
        suffice for tet10; hex8 needs 24 and more.

    Returns
    -------
    Limb
        Spot ``cylinder`` at the origin with normal +z, region ``soft_tissue``; node
        sets ``fixed`` (base and wall) and ``contact`` (upper face).

    Raises
    ------
    MeshError
        An odd core, too few rings, or coordinates that do not rise from 0.
    """
    return _limb(kind, *_stacked(rings_mm, depths_mm, n_core))


def half_space(
    kind: Kind,
    contact_radius_mm: float,
    *,
    n_radius: int,
    n_core: int,
    fine: float = 1.5,
    crowding: float = 1.0,
    extent: float = 400.0,
    growth: float = 2.0,
) -> Limb:
    """A body with fixed outer boundary, large enough to respond like a half-space.

    A fine cylinder around the contact passes into hemispheres.

    Parameters
    ----------
    contact_radius_mm : float
        Expected radius of the contact; a ring of nodes is there.
    n_radius : int
        Rings within the contact, more than ``n_core``/2; the cells of the core fill half of it.
    n_core : int
        Cells across the core; see :func:`cylinder`.
    fine : float
        Radius and height of the fine cylinder in contact radii.
    crowding : float
        Ratio of adjacent cells in the fine cylinder, which shrink towards the edge of the contact.
    extent : float
        Radius of the outermost hemisphere in contact radii. Fixing it
        adds about 1.1/extent to the force (incompressible).
    growth : float
        Ratio of adjacent cells outside the fine cylinder.

    Returns
    -------
    Limb
        As from :func:`cylinder`, with the outermost hemisphere ``fixed``.
    """
    rings = _rings(contact_radius_mm, n_radius, n_core, fine * contact_radius_mm, crowding, crowding)
    points, hexes, held = _stacked(rings, _depths(rings, contact_radius_mm, rings[-1], crowding), n_core)
    first = growth * (rings[-1] - rings[-2])
    shells = _growing(rings[-1], first, extent * contact_radius_mm, growth)
    return _limb(kind, *_in_hemispheres(points, hexes, held, shells / rings[-1]))


def layer(
    kind: Kind,
    thickness_mm: float,
    contact_radius_mm: float,
    *,
    n_radius: int,
    n_core: int,
    growth: float = 1.5,
    crowding: float = 1.0,
    extent: float = 8.0,
) -> Limb:
    """A layer bonded to a rigid base.

    Parameters
    ----------
    extent : float
        Radius beyond the contact in thicknesses; what the wall changes falls off exponentially with it.
    n_radius, n_core, growth, crowding
        See :func:`half_space`.
    """
    far = contact_radius_mm + extent * thickness_mm
    rings = _rings(contact_radius_mm, n_radius, n_core, far, growth, crowding)
    depths = _depths(rings, contact_radius_mm, thickness_mm, growth)
    return cylinder(kind, rings, depths, n_core=n_core)


def _limb(kind: Kind, points_mm: FloatArray, hexes: IntArray, held: BoolArray) -> Limb:
    cells = hexes
    if kind == "tet10":
        points_mm, cells, ends = with_midpoints(points_mm, cut(points_mm, (("hexahedron", hexes),)).tets)
        held = np.concatenate([held, held[ends].all(axis=1)])
    mesh = Mesh(
        points_mm=points_mm,
        cells={kind: cells},
        cell_regions={kind: np.zeros(len(cells), dtype=np.int64)},
        regions=("soft_tissue",),
        node_sets={"fixed": np.flatnonzero(held), "contact": np.flatnonzero(points_mm[:, 2] == 0.0)},
    )
    return Limb(spot=Spot(name="cylinder"), mesh=mesh)


def _in_hemispheres(
    points: FloatArray, hexes: IntArray, held: BoolArray, scales: FloatArray
) -> tuple[FloatArray, IntArray, BoolArray]:
    """Wrap the held faces of a body into shells at multiples of its size, ever rounder outwards."""
    faces = hexes[:, _INWARD_FACES].reshape(-1, 4)
    skin, local = np.unique(faces[held[faces].all(axis=1)], return_inverse=True)
    faces, start = local.reshape(-1, 4), points[skin]
    sphere = np.abs(start).max() * start / np.linalg.norm(start, axis=1)[:, None]
    shells, layers, inner = [points], [hexes], skin
    for k, scale in enumerate(scales):
        outer = len(points) + len(skin) * k + np.arange(len(skin))
        share = min((scale - 1.0) / _ROUND_AFTER, 1.0)
        shells.append(scale * ((1.0 - share) * start + share * sphere))
        layers.append(np.hstack([outer[faces], inner[faces]]))
        inner = outer
    wrapped = np.concatenate(shells)
    return wrapped, np.concatenate(layers), np.arange(len(wrapped)) >= inner[0]


def _stacked(
    rings_mm: FloatArray, depths_mm: FloatArray, n_core: int
) -> tuple[FloatArray, IntArray, BoolArray]:
    """Nodes, hexahedra and which nodes lie on the base or the wall."""
    _check(rings_mm, depths_mm, n_core)
    plane, quads = _plane(rings_mm, n_core)
    n = len(plane)
    points = np.concatenate([np.column_stack([plane, np.full(n, -depth)]) for depth in depths_mm])
    tops = n * np.arange(len(depths_mm) - 1)
    cells = np.concatenate([np.hstack([quads + top + n, quads + top]) for top in tops])
    node = np.arange(len(points))
    return points, cells, (node % n >= n - 4 * n_core) | (node >= len(points) - n)


def _rings(
    edge_mm: float, n_inside: int, n_core: int, extent_mm: float, growth: float, crowding: float
) -> FloatArray:
    """Radii whose core fills half of the contact, so that the edge of the contact is a circle."""
    core = 0.5 * edge_mm
    beyond = spacing(
        edge_mm - core, n_inside - n_core // 2, extent_mm - core, growth=growth, crowding=crowding
    )
    return np.concatenate([np.linspace(0.0, core, n_core // 2 + 1), core + beyond[1:]])


def _depths(rings_mm: FloatArray, edge_mm: float, extent_mm: float, growth: float) -> FloatArray:
    """Depths whose first cell is as high as the ring inside the edge is wide."""
    edge = int(np.argmin(np.abs(rings_mm - edge_mm)))
    first = min(rings_mm[edge] - rings_mm[edge - 1], 0.25 * extent_mm)
    return spacing(first, 1, extent_mm, growth=growth)


def _check(rings_mm: FloatArray, depths_mm: FloatArray, n_core: int) -> None:
    for name, values, least in (("rings", rings_mm, n_core // 2 + 2), ("depths", depths_mm, 2)):
        if len(values) < least or values[0] != 0.0 or not (np.diff(values) > 0.0).all():
            raise MeshError(
                f"specimen: {name} must rise strictly from 0 and be at least {least}; got {values}"
            )
    if n_core < 2 or n_core % 2:
        raise MeshError(f"specimen: a core of {n_core} cells; give an even number of at least 2")


def _plane(rings_mm: FloatArray, n_core: int) -> tuple[FloatArray, IntArray]:
    """Nodes (n, 2) and cells (m, 4) of the O-grid, counter-clockwise, the outermost ring last."""
    half = n_core // 2
    i, j = np.meshgrid(np.arange(-half, half + 1), np.arange(-half, half + 1), indexing="ij")
    square = np.stack([i.ravel(), j.ravel()], axis=1)
    level = np.abs(square).max(axis=1)
    core = _placed(square / np.maximum(level, 1)[:, None], level, rings_mm, half)
    border = _border(half)
    outer = [
        _placed(border / half, np.full(len(border), m), rings_mm, half)
        for m in range(half + 1, len(rings_mm))
    ]
    # Node (i, j) of the core has number (i + half) (n_core + 1) + j + half.
    corner = np.arange(n_core)[:, None] * (n_core + 1) + np.arange(n_core)
    cells = [corner.reshape(-1, 1) + np.array([0, n_core + 1, n_core + 2, 1])]
    inner = (border[:, 0] + half) * (n_core + 1) + border[:, 1] + half
    for m in range(len(outer)):
        ring = len(core) + m * len(border) + np.arange(len(border))
        cells.append(np.column_stack([inner, ring, np.roll(ring, -1), np.roll(inner, -1)]))
        inner = ring
    return np.concatenate([core, *outer]), np.concatenate(cells)


def _border(half: int) -> IntArray:
    """Lattice points around the square of half-width ``half``, counter-clockwise."""
    side = np.arange(-half, half)
    full = np.full(len(side), half)
    sides = (full, side), (-side, full), (-full, -side), (side, -full)
    return np.concatenate([np.column_stack(each) for each in sides])


def _placed(square: FloatArray, level: IntArray, rings_mm: FloatArray, half: int) -> FloatArray:
    """Points of the unit square's border (n, 2), moved to the ring of their level: ever rounder outwards."""
    # The core stays even for any rings: crowded squares would turn its corners inside out.
    even = np.concatenate([rings_mm[half] * np.arange(half) / half, rings_mm[half:]])
    radius = even[level][:, None]
    along = np.clip(radius / (_ROUND_AFTER * even[half]), 0.0, 1.0)
    x, y = square[:, 0], square[:, 1]
    wide = np.abs(x) >= np.abs(y)
    longer = np.maximum(np.maximum(np.abs(x), np.abs(y)), 1e-300)
    ratio = np.where(wide, y * np.sign(x), -x * np.sign(y)) / longer
    centre = np.where(wide, np.where(x >= 0.0, 0.0, np.pi), np.where(y >= 0.0, 0.5, -0.5) * np.pi)
    angle = centre + 0.25 * np.pi * ratio
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points: FloatArray = radius * ((1.0 - along) * square + along * circle)
    points[level == 0] = 0.0
    return points
