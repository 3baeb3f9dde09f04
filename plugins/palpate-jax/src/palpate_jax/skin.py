"""The faces of a mesh that an indenter may touch, and their quadrature."""

from dataclasses import dataclass

import numpy as np

from palpate.domain import FloatArray, IntArray, Mesh
from palpate.errors import MeshError
from palpate.topology import outer_faces
from palpate_jax.elements import ELEMENTS


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """Contact faces of one kind.

    Parameters
    ----------
    nodes : (f, n) array
    values : (q, n) array
        Shape functions at the face's quadrature points.
    areas : (f, q) array
        Reference area of each point [mm²].
    """

    nodes: IntArray
    values: FloatArray
    areas: FloatArray

    def positions(self, coordinates: FloatArray) -> FloatArray:
        """Quadrature points (f q, 3) of node coordinates (n_nodes, 3)."""
        points: FloatArray = self.values @ coordinates[self.nodes]
        return points.reshape(-1, 3)


def skins(mesh: Mesh) -> tuple[Skin, ...]:
    """Boundary faces whose nodes all belong to the node set ``contact``.

    None where nodes are ``bonded``: an indenter that is glued on touches nothing else.

    Raises
    ------
    MeshError
        There is none.
    """
    if np.size(mesh.node_sets.get("bonded", ())):
        return ()
    touchable = np.zeros(mesh.n_nodes, dtype=bool)
    touchable[mesh.node_sets["contact"]] = True
    found = []
    for kind, cells in mesh.cells.items():
        element = ELEMENTS[kind]
        faces = outer_faces(kind, cells)
        faces = faces[touchable[faces].all(axis=1)]
        if len(faces):
            slopes = np.einsum("qak,fai->fqki", element.face.slopes, mesh.points_mm[faces])
            areas = np.linalg.norm(np.cross(slopes[:, :, 0], slopes[:, :, 1]), axis=2)
            found.append(Skin(faces, element.face.values, areas * element.face.weights))
    if not found:
        raise MeshError(
            "mesh: no boundary face has all its nodes in the node set 'contact'; "
            "mark every node of the outer surface"
        )
    return tuple(found)
