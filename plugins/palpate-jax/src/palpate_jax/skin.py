"""The skin at equilibrium states: its surface, and the tractions of the indenter around each node."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.api import FloatArray, IntArray, Limb, Mesh, SurfaceStates
from palpate.api.mesh import outer_faces, spot_axes, triangles_of
from palpate_jax.contact import Contact, Points
from palpate_jax.load_stepping import LoadStep
from palpate_jax.model import Model


def strain_ranges(limb: Limb, model: Model, reached: Sequence[LoadStep]) -> dict[str, dict[str, list[Any]]]:
    """Ends of the strains over the quadrature points of each region, one entry for each state.

    Strains are those that the material is given: with mean dilatation, J is the mean of the element.

    Returns
    -------
    dict
        By region: ``stretch_min`` and ``stretch_max`` of the principal stretches, ``i1_max`` of the first
        invariant of the isochoric deformation (3 at rest), ``J_min`` and ``J_max`` of the relative volume,
        and ``where_mm``, the undeformed centre of the element with the largest ``i1``, in the limb's frame.
    """
    found: dict[str, dict[str, list[Any]]] = {}
    for state in reached:
        by_region: dict[str, list[tuple[FloatArray, FloatArray]]] = {}
        for block in model.body.blocks:
            F, factor = block.deformation(state.displacements)
            squares = np.linalg.eigvalsh(F.swapaxes(-1, -2) @ F) * (factor**2)[..., None]
            centres = np.repeat(limb.mesh.points_mm[block.nodes].mean(axis=1)[:, None], F.shape[1], axis=1)
            real = block.volumes > 0.0  # points that fill up a patch are none
            by_region.setdefault(block.region, []).append((squares[real], centres[real]))
        for region, parts in by_region.items():
            squares, centres = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
            for name, value in _ends(squares, centres).items():
                found.setdefault(region, {}).setdefault(name, []).append(value)
    return found


def _ends(squares: FloatArray, centres_mm: FloatArray) -> dict[str, Any]:
    """Ends of squared stretches (n, 3) at points (n, 3)."""
    J = np.sqrt(squares.prod(axis=1))
    i1 = squares.sum(axis=1) / np.cbrt(J) ** 2
    return {
        "stretch_min": float(np.sqrt(squares.min())),
        "stretch_max": float(np.sqrt(squares.max())),
        "i1_max": float(i1.max()),
        "J_min": float(J.min()),
        "J_max": float(J.max()),
        "where_mm": centres_mm[np.argmax(i1)].tolist(),
    }


@dataclass(frozen=True, slots=True, eq=False)
class NodalTractions:
    """Contact around each node, per deformed area and in the spot's frame, as in ``SurfaceStates``."""

    areas_mm2: FloatArray
    touching: FloatArray
    pressures_MPa: FloatArray
    shears_MPa: FloatArray
    tractions_MPa: FloatArray


def nodal_tractions(contact: Contact, rest_mm: FloatArray, state: LoadStep) -> NodalTractions:
    """Means over the quadrature points around each node, n_nodes of them.

    A point counts at the nodes of its face by shares that are positive and add up to 1, so the sum of the
    forces is kept to rounding, and no mean exceeds the limit of friction that its points obey. The
    shares reproduce positions, so the moment is kept too, but on faces of tet10 that bend.
    """
    pose, memory, law = state.load.pose, state.load.memory, state.load.law
    points = Points(pose.into(contact.positions(state.displacements)), memory.anchors, memory.anchored, law)
    inside = points.depth > 0.0
    shear = np.where(inside[:, None], -points.friction, 0.0) @ pose.rotation.T
    traction = np.where(inside[:, None], points.traction, 0.0) @ pose.rotation.T
    loads = np.column_stack([points.pressure, shear, traction])
    total = np.zeros((len(rest_mm), 9))  # deformed area, what of it is touched, loads
    coordinates = rest_mm + state.displacements
    start = 0
    for surface in contact.surfaces:
        here = slice(start, start := start + surface.areas.size)
        now = surface.face.areas(coordinates[surface.nodes])
        loaded = surface.areas[..., None] * loads[here].reshape(*surface.areas.shape, 7)
        parts = np.concatenate(
            [now[..., None], (now * inside[here].reshape(now.shape))[..., None], loaded], 2
        )
        np.add.at(total, surface.nodes, np.einsum("qa,fqk->fak", _shares(surface.values), parts))
    area = total[:, 0]
    means = total[:, 1:] / np.where(area > 0.0, area, 1.0)[:, None]
    return NodalTractions(area, means[:, 0], means[:, 1], means[:, 2:5], means[:, 5:8])


def _shares(values: FloatArray) -> FloatArray:
    """Shape functions (q, n) that are linear over the parts of a face between its nodes."""
    if values.shape[1] != 6:
        return values
    corners, middles = values[:, :3], values[:, 3:]
    L = corners + 0.5 * (middles + np.roll(middles, 1, axis=1))  # barycentric coordinates
    shares = np.concatenate([np.zeros_like(L), 1.0 - 2.0 * np.roll(L, 1, axis=1)], axis=1)
    for i in range(3):
        near, j, k = L[:, i] > 0.5, (i + 1) % 3, (i + 2) % 3
        shares[near] = 0.0
        shares[near, i], shares[near, 3 + i], shares[near, 3 + k] = (
            2.0 * L[near, i] - 1.0,
            2.0 * L[near, j],
            2.0 * L[near, k],
        )
    return shares


def surface_states(limb: Limb, model: Model, reached: Sequence[LoadStep]) -> SurfaceStates:
    """The skin at equilibrium states of a model, in the frame of the limb's mesh."""
    axes = spot_axes(limb.spot.normal, limb.spot.along)
    triangles = _triangles(limb.mesh)
    nodes, numbers = np.unique(triangles, return_inverse=True)
    found = [nodal_tractions(model.contact, model.points, state) for state in reached]

    def column(arrays: Sequence[FloatArray], *shape: int) -> FloatArray:
        return np.array([array[nodes] for array in arrays]).reshape(len(reached), len(nodes), *shape)

    def turned(arrays: Sequence[FloatArray]) -> FloatArray:
        return column(arrays, 3) @ axes.T

    tips = np.array([state.load.pose.tip for state in reached]).reshape(-1, 3)
    return SurfaceStates(
        points_mm=limb.mesh.points_mm[nodes],
        triangles=numbers.reshape(-1, 3),
        depth_mm=np.array([state.depth_mm for state in reached]),
        rotation_deg=np.array([state.rotation_deg for state in reached]),
        positions_mm=limb.spot.position_mm + tips @ axes.T,
        rotations=axes @ np.array([state.load.pose.rotation for state in reached]).reshape(-1, 3, 3),
        displacements_mm=turned([state.displacements for state in reached]),
        areas_mm2=column([each.areas_mm2 for each in found]),
        touching=column([each.touching for each in found]),
        pressures_MPa=column([each.pressures_MPa for each in found]),
        shears_MPa=turned([each.shears_MPa for each in found]),
        tractions_MPa=turned([each.tractions_MPa for each in found]),
    )


def _triangles(mesh: Mesh) -> IntArray:
    """Triangles (m, 3) of the faces that may touch, or that are glued to the indenter."""
    on_skin = np.zeros(mesh.n_nodes, dtype=bool)
    for name in ("contact", "bonded"):
        on_skin[mesh.node_sets.get(name, np.empty(0, dtype=np.int64))] = True
    found = []
    for kind, cells in mesh.cells.items():
        faces = outer_faces(kind, cells)
        found.append(triangles_of(faces[on_skin[faces].all(axis=1)]))
    return np.concatenate(found)
