"""Small generated limbs, for the tests and oracles of solvers."""

from palpate.mesh.specimens.blocks import block
from palpate.mesh.specimens.cylinders import cylinder, half_space, layer, spacing

__all__ = ["block", "cylinder", "half_space", "layer", "spacing"]
