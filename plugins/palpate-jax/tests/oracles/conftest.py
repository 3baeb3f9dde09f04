"""A sphere on round specimens, in the units of the analytic solutions."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import Indentation, Job, Status
from palpate.domain.indenter import Sphere
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.neo_hookean import NeoHookean

RADIUS_MM = 7.5


def _simulated(limb, path, *, friction=0.0, nu=0.4975, penalty=500.0):
    """Diagnostics of a path of (depth mm, rotation degrees) on a material of shear modulus 1 MPa.

    Penalty 500 sinks the sphere in by 0.7 % of the depth at the axis (incompressible). A stiffer one
    asks more of a face than its nodes can follow, and force grows with it.
    """
    job = Job(
        spot="cylinder",
        set_id=0,
        materials={"soft_tissue": NeoHookean()},
        thetas={"soft_tissue": np.array([2.0 * (1.0 + nu), nu])},
        protocol=Indentation(
            indenter=Sphere(radius_mm=RADIUS_MM), path=np.array([(0.0, 0.0), *path]), friction=friction
        ),
    )
    settings = JaxSettings(depth_steps=2, rotation_step_deg=90.0, tolerance=1e-4, penalty=penalty)
    simulation = JaxSolver(settings).simulate(job, limb)
    assert simulation.status is Status.OK, simulation.message
    rows = simulation.diagnostics
    return {name: np.array(rows[name]) for name in ("force_N", "moment_Nmm", "penetration_mm", "sticking")}


def _within(limb, radius_mm):
    """Nodes of the upper face within a radius of the axis."""
    points = limb.mesh.points_mm
    near = np.hypot(points[:, 0], points[:, 1]) <= radius_mm * (1.0 + 1e-9)
    return np.flatnonzero((points[:, 2] == 0.0) & near)


def _with_disc(limb, node_set, radius_mm):
    """The limb with the disc as its node set ``bonded`` (glued on) or ``contact`` (all that is touched).

    The rim is a polygon inscribed in the circle. Of n sides it has the area of a circle smaller by
    π²/(3 n²): 1.3 % at 16 sides and 0.6 % at 24, three times as much in a torque.
    """
    sets = {**limb.mesh.node_sets, node_set: _within(limb, radius_mm)}
    return replace(limb, mesh=replace(limb.mesh, node_sets=sets))


def _observed_order(what, errors, cells):
    """Order p of errors ~ cells^−p between two meshes; printed, for ``pytest -rP``."""
    order = np.log(errors[0] / errors[1]) / np.log(cells[1] / cells[0])
    print(f"{what}: {errors[0]:+.2%}, {errors[1]:+.2%} at {cells[0]} and {cells[1]} cells, order {order:.2f}")  # noqa: T201
    return order


@pytest.fixture(scope="session")
def simulated():
    return _simulated


@pytest.fixture(scope="session")
def with_disc():
    return _with_disc


@pytest.fixture(scope="session")
def observed_order():
    return _observed_order


@pytest.fixture(scope="session")
def radius_mm():
    return RADIUS_MM
