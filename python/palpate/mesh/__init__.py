"""Geometry of a limb's mesh: the frame of a spot, the numbering of nodes, the shape functions."""
