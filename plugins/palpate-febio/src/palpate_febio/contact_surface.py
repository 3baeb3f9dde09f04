"""The faces of a mesh that the indenter may touch."""

import numpy as np

from palpate.api import IntArray, Mesh, MeshError
from palpate.mesh.topology import outer_faces

FEBIO_NAMES = {3: "tri3", 4: "quad4", 6: "tri6"}
"""Kinds of faces by their number of nodes."""


def contact_faces(mesh: Mesh) -> dict[str, IntArray]:
    """Outer faces whose nodes all belong to the node set ``contact``, by FEBio's name of their kind.

    Returns
    -------
    dict of str to (n_faces, n_nodes) array
        ``quad4``, ``tri3``, ``tri6``; in the order of the elements.

    Raises
    ------
    MeshError
        There is none.
    """
    touchable = np.zeros(mesh.n_nodes, dtype=bool)
    touchable[mesh.node_sets["contact"]] = True
    found: dict[str, IntArray] = {}
    for kind in sorted(mesh.cells):
        faces = outer_faces(kind, mesh.cells[kind], febio=True)
        faces = faces[touchable[faces].all(axis=1)]
        if len(faces):
            found[FEBIO_NAMES[faces.shape[1]]] = faces
    if not found:
        raise MeshError(
            "mesh: no outer face has all its nodes in the node set 'contact', so FEBio would have nothing "
            "to touch; mark every node of the outer surface"
        )
    return found
