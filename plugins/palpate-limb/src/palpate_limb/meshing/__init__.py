"""Meshers: a closed surface, or several nested ones, into tetrahedra of a given size."""

from palpate_limb.meshing.adapting import AdaptTask, adapt_in_child
from palpate_limb.meshing.mesher import MESHERS, Mesher, MeshingTask, mesh_in_child
from palpate_limb.meshing.size_field import SizeField

__all__ = ["MESHERS", "AdaptTask", "Mesher", "MeshingTask", "SizeField", "adapt_in_child", "mesh_in_child"]
