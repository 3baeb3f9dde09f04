"""The faces of a mesh that an indenter may touch, and their quadrature."""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray, IntArray, Mesh, MeshError
from palpate.api.mesh import outer_faces
from palpate_jax.elements import ELEMENTS, Face


@dataclass(frozen=True, slots=True, eq=False)
class ContactSurface:
    """Contact faces of one kind.

    Parameters
    ----------
    nodes : (f, n) array
    areas : (f, q) array
        Reference area of each quadrature point [mm²].
    """

    nodes: IntArray
    face: Face
    areas: FloatArray

    @property
    def values(self) -> FloatArray:
        """Shape functions (q, n) at the quadrature points."""
        return self.face.values

    def positions(self, coordinates: FloatArray) -> FloatArray:
        """Quadrature points (..., f q, 3) of node coordinates (..., n_nodes, 3)."""
        points: FloatArray = self.values @ coordinates[..., self.nodes, :]
        return points.reshape(*coordinates.shape[:-2], -1, 3)


def contact_surfaces(mesh: Mesh) -> tuple[ContactSurface, ...]:
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
        face, faces = ELEMENTS[kind].face, outer_faces(kind, cells)
        faces = faces[touchable[faces].all(axis=1)]
        if len(faces):
            found.append(ContactSurface(faces, face, face.areas(mesh.points_mm[faces])))
    if not found:
        raise MeshError(
            "mesh: no boundary face has all its nodes in the node set 'contact'; "
            "mark every node of the outer surface"
        )
    return tuple(found)
