"""Meshes of limbs: loading and checking them."""
