"""How large elements are under the indenter: the size that decides the error of force and torque."""

import numpy as np

from palpate.domain import FloatArray, Limb
from palpate.errors import MeshError
from palpate.mesh.topology import CELLS, outer_faces

NEAR = 1.2
"""Distance from the spot up to which edges count, over the indenter's radius."""


def contact_edge_mm(limb: Limb, near_mm: float) -> float:
    """Mean length of the edges of contact faces near the spot; of the nearest six where none is near."""
    mesh = limb.mesh
    on = np.zeros(mesh.n_nodes, dtype=np.bool_)
    on[mesh.node_sets["contact"]] = True
    pairs = []
    for kind, cells in mesh.cells.items():
        n = CELLS[kind].n_face_corners
        faces = outer_faces(kind, cells)[:, :n]
        faces = faces[on[faces].all(axis=1)]
        pairs.append(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2))
    if not sum(map(len, pairs)):
        raise MeshError("mesh: node set 'contact' holds no face of the surface; mark all nodes of the skin")
    ends: FloatArray = mesh.points_mm[np.unique(np.sort(np.concatenate(pairs), axis=1), axis=0)]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    away = np.linalg.norm(ends.mean(axis=1) - limb.spot.position_mm, axis=1)
    near = away <= near_mm
    return float(lengths[near if near.any() else np.argsort(away)[:6]].mean())
