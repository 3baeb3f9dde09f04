"""Meshers: a closed surface, or several nested ones, into tetrahedra of a given size."""

from palpate_limb.meshing.mesher import MESHERS, Mesher, MeshingTask, mesh_in_child
from palpate_limb.meshing.size_field import SizeField

__all__ = ["MESHERS", "Mesher", "MeshingTask", "SizeField", "mesh_in_child"]
