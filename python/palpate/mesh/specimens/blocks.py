"""Square blocks on a rigid base."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

import numpy as np

from palpate.domain import FloatArray, IntArray, Limb, Mesh, Spot
from palpate.mesh.topology import CUBE, SIX_TETS, with_midpoints


def block(
    kind: Literal["hex8", "tet10", "tet4"] = "hex8",
    *,
    width_mm: float = 36.0,
    height_mm: float = 18.0,
    n_across: int = 6,
    n_down: int = 3,
    grading: float = 1.0,
    layers_mm: Mapping[str, float] = MappingProxyType({}),
) -> Limb:
    """A square block bonded to a rigid base, its spot in the middle of the upper face.

    Parameters
    ----------
    width_mm, height_mm : float
        The block spans ±width/2 in x and y, and −height to 0 in z.
    n_across, n_down : int
        Cells along the width (even, so that a node is at the spot) and the height.
    grading : float
        Above 1, nodes crowd towards the spot: coordinates follow |t|^grading.
    layers_mm : mapping of region to thickness, from the top, optional
        Cells whose middle is deeper than all of them belong to ``soft_tissue``.

    Returns
    -------
    Limb
        Spot ``block`` at the origin with normal +z; node sets ``fixed`` (base) and
        ``contact`` (upper face).
    """
    points, hexes = _grid(width_mm, height_mm, n_across, n_down, grading)
    cells = hexes if kind == "hex8" else hexes[:, SIX_TETS].reshape(-1, 4)
    if kind == "tet10":
        points, cells, _ = with_midpoints(points, cells)
    depth = -points[cells[:, : 8 if kind == "hex8" else 4], 2].mean(axis=1)
    mesh = Mesh(
        points_mm=points,
        cells={kind: cells},
        cell_regions={kind: np.searchsorted(np.cumsum(list(layers_mm.values())), depth)},
        regions=(*layers_mm, "soft_tissue"),
        node_sets={
            "fixed": np.flatnonzero(points[:, 2] == -height_mm),
            "contact": np.flatnonzero(points[:, 2] == 0),
        },
    )
    return Limb(spot=Spot(name="block"), mesh=mesh)


def _grid(
    width_mm: float, height_mm: float, n_across: int, n_down: int, grading: float
) -> tuple[FloatArray, IntArray]:
    """Points and hexahedra of a block."""
    across, down = np.linspace(-1.0, 1.0, n_across + 1), np.linspace(1.0, 0.0, n_down + 1)
    x = 0.5 * width_mm * (np.sign(across) * np.abs(across) ** grading)
    z = -height_mm * down**grading
    points = np.stack(np.meshgrid(x, x, z, indexing="ij"), axis=-1).reshape(-1, 3)
    corner = np.indices((n_across, n_across, n_down)).reshape(3, -1).T[:, None] + CUBE
    return points, np.ravel_multi_index(tuple(corner.transpose(2, 0, 1)), (len(x), len(x), len(z)))
