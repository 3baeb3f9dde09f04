"""A sphere on round specimens, in the units of the analytic solutions."""

import numpy as np
import pytest

from palpate.domain import Indentation, Job, Sphere, Status
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
    settings = JaxSettings(depth_steps=2, rotation_step_deg=90.0, tolerance=1e-5, penalty=penalty)
    simulation = JaxSolver(settings).simulate(job, limb)
    assert simulation.status is Status.OK, simulation.message
    rows = simulation.diagnostics
    return {name: np.array(rows[name]) for name in ("force_N", "moment_Nmm", "penetration_mm", "sticking")}


@pytest.fixture(scope="session")
def simulated():
    return _simulated


@pytest.fixture(scope="session")
def radius_mm():
    return RADIUS_MM
