"""The faces of a mesh that the indenter may touch."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from palpate.domain import IntArray, Mesh
from palpate.errors import MeshError

FACES: Mapping[str, tuple[str, int, tuple[tuple[int, ...], ...]]] = MappingProxyType(
    {
        "hex8": (
            "quad4",
            4,
            ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
        ),
        "tet4": ("tri3", 3, ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3))),
        "tet10": (
            "tri6",
            3,
            ((0, 2, 1, 6, 5, 4), (0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (2, 0, 3, 6, 7, 9)),
        ),
    }
)
"""FEBio's name of a kind's faces, their corners, and their nodes, counter-clockwise from outside."""


def skin_faces(mesh: Mesh) -> dict[str, IntArray]:
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
        name, n_corners, corners = FACES[kind]
        faces = mesh.cells[kind][:, np.array(corners)].reshape(-1, len(corners[0]))
        key = np.sort(faces[:, :n_corners], axis=1)
        _, back, counts = np.unique(key, axis=0, return_inverse=True, return_counts=True)
        outer = counts[back.reshape(-1)] == 1
        faces = faces[outer & touchable[faces].all(axis=1)]
        if len(faces):
            found[name] = faces
    if not found:
        raise MeshError(
            "mesh: no outer face has all its nodes in the node set 'contact', so FEBio would have nothing "
            "to touch; mark every node of the outer surface"
        )
    return found
