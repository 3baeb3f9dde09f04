"""Finite elements of a press: a flat probe on skin, fat and muscle, bonded to the bone.

Linear elasticity of a quarter of the block, as small strains are: neo-Hookean layers pressed by a third of
their thickness are a fifth stiffer. The face does not stick. Compliance is in proportion to 1/modulus,
and the muscle's modulus is 1 MPa here. A direct solve of 800 nodes takes 0.15 s.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.optimize import brentq
from scipy.sparse.linalg import spsolve

from palpate.api import FloatArray, IntArray, MeshError
from palpate.api.mesh import HEX_CORNERS

LENGTH_MM = 45.0
"""Of the probe's face, along x."""

POISSON = 0.49
"""Of every layer."""

MARGIN_MM = (12.0, 60.0)
"""Least and most tissue around the probe; between them it is as wide as the tissue is thick."""

N_CELLS, GROWTH = (1, 4, 5), (1.0, 1.3, 1.35)
"""Cells down each layer, and the ratio of their sizes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedPress:
    """Result of a simulated press.

    Parameters
    ----------
    compliance : float
        Compression times the probe's area over force [mm/MPa], for a muscle of 1 MPa.
    shares : (3,) array
        Of skin, fat and muscle in the compression under the middle of the probe; their sum is 1.
    """

    compliance: float
    shares: FloatArray


def simulate_press(layers_mm: Sequence[float], ratios: Sequence[float], width_mm: float) -> SimulatedPress:
    """Press a probe of 45 mm × ``width_mm`` on three layers.

    Parameters
    ----------
    layers_mm : three floats
        Thickness of skin, fat and muscle.
    ratios : two floats
        Young's modulus of skin and of fat over that of muscle.

    Raises
    ------
    MeshError
        A thickness or a ratio is not > 0.
    """
    if not all(0.0 < value < np.inf for value in (*layers_mm, *ratios, width_mm)):
        raise MeshError(f"layers {list(layers_mm)} mm, ratios {list(ratios)}; give numbers > 0")
    x, y, depths = coordinates(layers_mm, width_mm)
    points = np.stack(np.meshgrid(x, y, -depths[::-1], indexing="ij"), axis=-1).reshape(-1, 3)
    cells = hexahedra((len(x), len(y), len(depths)))
    layer = np.searchsorted(np.cumsum(layers_mm)[:2], -points[cells, 2].mean(axis=1))
    matrix = _stiffness(points, cells, np.array([*ratios, 1.0])[layer])
    face = (points[:, 2] == 0.0) & (points[:, 0] <= 0.5 * LENGTH_MM) & (points[:, 1] <= 0.5 * width_mm)
    held = np.column_stack([points[:, 0] == 0.0, points[:, 1] == 0.0, face])
    held[points[:, 2] == points[:, 2].min()] = True
    displacements = np.zeros_like(points)
    displacements[face, 2] = -1.0
    free = ~held.ravel()
    u = displacements.ravel()
    u[free] = spsolve(matrix[free][:, free].tocsc(), -(matrix[free] @ u), permc_spec="MMD_AT_PLUS_A")
    force = -4.0 * (matrix @ u).reshape(-1, 3)[face, 2].sum()
    axis = (points[:, 0] == 0.0) & (points[:, 1] == 0.0)
    ends = -np.interp(-np.concatenate([[0.0], np.cumsum(layers_mm)]), points[axis, 2], u[2::3][axis])
    return SimulatedPress(compliance=LENGTH_MM * width_mm / force, shares=-np.diff(ends) / ends[0])


def coordinates(layers_mm: Sequence[float], width_mm: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coordinates of nodes: x, y from the middle outwards, and depths; a layer has nodes at its ends."""
    half, margin = 0.5 * LENGTH_MM, float(np.clip(np.sum(layers_mm), *MARGIN_MM))
    x = np.concatenate([[0.0, 12.0, 19.0, half], half + _growing(margin, 3.5, 4)])
    inside = width_mm * np.array([0.0, 1.0 / 6.0, 1.0 / 3.0, 0.5])
    y = np.concatenate([inside, inside[-1] + _growing(margin, width_mm / 6.0, 5)])
    tops = np.concatenate([[0.0], np.cumsum(layers_mm)])
    parts = [np.zeros(1)]
    for top, thickness, n, growth in zip(tops[:-1], layers_mm, N_CELLS, GROWTH, strict=True):
        ends = np.cumsum(growth ** np.arange(n))
        parts.append(top + thickness * ends / ends[-1])
    return x, y, np.concatenate(parts)


def _growing(length_mm: float, first_mm: float, n: int) -> FloatArray:
    """Ends of ``n`` cells along a length, each in one ratio to the one before."""
    powers = np.arange(n)
    ratio = brentq(lambda ratio: first_mm * float((ratio**powers).sum()) - length_mm, 0.1, 100.0)
    ends = np.cumsum(ratio**powers)
    scaled: FloatArray = ends * length_mm / ends[-1]
    return scaled


def hexahedra(shape: tuple[int, int, int]) -> IntArray:
    """Nodes (n, 8) of the cells of a grid with so many nodes along x, y and z."""
    corners = np.indices([n - 1 for n in shape]).reshape(3, -1).T[:, None]
    corners = corners + ((HEX_CORNERS + 1.0) / 2.0).astype(np.int64)
    cells: IntArray = np.ravel_multi_index(tuple(corners.transpose(2, 0, 1)), shape)
    return cells


def _stiffness(points: FloatArray, cells: IntArray, young: FloatArray) -> sp.csr_array:
    """Matrix of hexahedra with one volume change per element (B-bar)."""
    gauss = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij")).reshape(3, -1).T / np.sqrt(3.0)
    corners = np.asarray(HEX_CORNERS, dtype=np.float64)
    factors = 1.0 + gauss[:, None] * corners
    local = np.stack(
        [corners[:, i] / 8.0 * np.delete(factors, i, axis=2).prod(axis=2) for i in range(3)], axis=2
    )
    jacobians = np.einsum("qai,eaj->eqij", local, points[cells])
    volumes = np.linalg.det(jacobians)
    slopes = np.einsum("eqji,qai->eqaj", np.linalg.inv(jacobians), local)
    mean = np.einsum("eq,eqaj->eaj", volumes, slopes) / volumes.sum(axis=1)[:, None, None]
    strain = np.zeros((*volumes.shape, 6, 8, 3))
    for k, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]):
        strain[:, :, k, :, i] += slopes[..., j]
        if i != j:
            strain[:, :, k, :, j] += slopes[..., i]
    strain[:, :, :3] += ((mean[:, None] - slopes) / 3.0)[:, :, None]
    strain = strain.reshape(*volumes.shape, 6, 24)
    elastic = np.diag([2.0, 2.0, 2.0, 1.0, 1.0, 1.0]) / (2.0 * (1.0 + POISSON))
    elastic[:3, :3] += POISSON / ((1.0 + POISSON) * (1.0 - 2.0 * POISSON))
    weights = volumes * young[:, None]
    blocks = np.einsum("eq,eqki,kl,eqlj->eij", weights, strain, elastic, strain, optimize=True)
    unknowns = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), 24)
    rows, columns = np.repeat(unknowns, 24, axis=1).ravel(), np.tile(unknowns, (1, 24)).ravel()
    return sp.coo_array((blocks.ravel(), (rows, columns)), shape=(points.size, points.size)).tocsr()
