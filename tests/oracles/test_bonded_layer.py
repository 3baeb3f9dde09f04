"""A flat punch glued to a layer on a rigid base: force and torque against the layer's thickness.

F = 2 E* a d κ and T = 16/3 G a³ β λ. κ is that of a punch without friction; glued, a
half-space (κ = 1) would answer (1 − ν) ln(3 − 4ν)/(1 − 2ν) times as much: 1.003 at ν = 0.45
and 1 at a half. Incompressible is ν = 0.4975 here, which takes off up to 1 % of κ.
"""

from dataclasses import replace

import numpy as np
import pytest

from palpate.specimens import layer

FORCE = {(0.4, 0.45): 1.5993, (0.4, 0.5): 1.6837, (0.8, 0.45): 2.5354, (0.8, 0.5): 2.8602}
TORQUE = {0.4: 1.00558, 0.8: 1.03587}
"""κ by a/h and ν, and λ by a/h."""

MESHES = [
    {"n_radius": 5, "n_core": 4, "crowding": 1.8, "growth": 1.6},
    {"n_radius": 9, "n_core": 8, "crowding": 1.8, "growth": 1.3},
]


def glued(limb, a):
    """The limb with the nodes of the upper face within ``a`` of the axis bonded to the indenter."""
    points = limb.mesh.points_mm
    inside = (points[:, 2] == 0.0) & (np.hypot(points[:, 0], points[:, 1]) <= a * (1.0 + 1e-9))
    sets = {**limb.mesh.node_sets, "bonded": np.flatnonzero(inside)}
    return replace(limb, mesh=replace(limb.mesh, node_sets=sets))


@pytest.fixture(scope="module", params=sorted(FORCE), ids=str)
def errors(request, simulated):
    """Relative errors (mesh, force or torque), coarse mesh first."""
    ratio, nu = request.param
    depth, degrees = 1e-3, 0.1
    found = []
    for mesh in MESHES:
        limb = glued(layer("hex8", 1.0 / ratio, 1.0, extent=4.0, **mesh), 1.0)
        rows = simulated(limb, [(depth, 0.0), (depth, degrees)], nu=min(nu, 0.4975))
        force = 4.0 / (1.0 - nu) * depth * FORCE[request.param]
        torque = 16.0 / 3.0 * np.deg2rad(degrees) * TORQUE[ratio]
        found.append((rows["force_N"][1, 2] / force - 1.0, rows["moment_Nmm"][-1, 2] / torque - 1.0))
    return np.array(found)


def test_errors_fall_with_the_mesh(errors):
    assert (np.abs(errors[1]) < np.abs(errors[0])).all()


def test_torque_is_the_layers(errors):
    """Measured +1.1 to +1.2 %, from +3.2 to +4.2 % on the coarse mesh."""
    assert abs(errors[1, 1]) < 0.015


def test_force_is_the_layers(errors, request):
    """Measured +1.0, +0.8, +2.0 % and, where an incompressible layer is thin, +4.7 %; coarse 2.9 to 8.9 %."""
    thin_incompressible = "0.8, 0.5" in request.node.name
    assert abs(errors[1, 0]) < (0.05 if thin_incompressible else 0.022)
