"""Meshers: a closed surface, or several nested ones, into tetrahedra of a given size."""

from palpate_limb.meshing.adapting import AdaptTask, run_mmg
from palpate_limb.meshing.mesher import MESHERS, Mesher, MeshingTask, run_mesher
from palpate_limb.meshing.size_field import SizeField

__all__ = ["MESHERS", "AdaptTask", "Mesher", "MeshingTask", "SizeField", "run_mesher", "run_mmg"]
