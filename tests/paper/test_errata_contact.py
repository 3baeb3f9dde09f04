"""Erratum 6, on the embedded solver: a soft contact lets the sphere sink in, and linear tetrahedra lock."""

import numpy as np
import pytest

from palpate.domain import Indentation, Job, Limb, Simulation, Sphere, Status
from palpate.errors import MeshError
from palpate.specimens import block
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.yeoh import Yeoh

RADIUS_MM, DEPTH_MM, HEIGHT_MM = 7.5, 2.0, 10.0
NEARLY_INCOMPRESSIBLE = np.array([0.0141, -0.0011, 1.05e-4, 40 * 2 * 0.0141])
PRESS = [(0.0, 0.0), (DEPTH_MM, 0.0)]


def solved(limb: Limb, path: list[tuple[float, float]], **settings: float) -> Simulation:
    job = Job(
        spot="block",
        set_id=0,
        materials={"soft_tissue": Yeoh()},
        thetas={"soft_tissue": NEARLY_INCOMPRESSIBLE},
        protocol=Indentation(indenter=Sphere(radius_mm=RADIUS_MM), path=np.array(path), friction=1.0),
    )
    solver = JaxSolver(JaxSettings(depth_steps=2, rotation_step_deg=10.0, **settings))
    simulation = solver.simulate(job, limb)
    assert simulation.status is Status.OK, simulation.message
    return simulation


def test_erratum_6a_a_contact_as_soft_as_the_tissue_lets_the_sphere_sink_in() -> None:
    """Penalty = modulus / thickness, as an automatic one is: the dent is not in the tissue."""
    limb = block("hex8", n_across=6, n_down=3, width_mm=24.0, height_mm=HEIGHT_MM, grading=1.4)
    path = [*PRESS, (DEPTH_MM, 10.0)]
    default = solved(limb, path)
    automatic = solved(limb, path, penalty=RADIUS_MM / HEIGHT_MM)
    sunk, kept = (max(s.diagnostics["penetration_mm"]) for s in (automatic, default))
    assert kept < 0.05 * DEPTH_MM
    assert sunk > 10.0 * kept
    for channel in ("force", "torque"):
        capped, true = (np.abs(s.response[channel].ordinate).max() for s in (automatic, default))
        assert capped < 0.5 * true, channel


def test_erratum_6b_linear_tetrahedra_lock_and_are_refused() -> None:
    """At κ/μ = 40 they overstate the force by half and more; the solver does not take them."""
    size = {"n_across": 4, "n_down": 2, "width_mm": 24.0, "height_mm": HEIGHT_MM, "grading": 1.4}
    linear, quadratic = (solved(block(kind, **size), PRESS) for kind in ("tet4", "tet10"))
    ratio = linear.response["force"].ordinate[-1] / quadratic.response["force"].ordinate[-1]
    assert ratio > 1.5
    with pytest.raises(MeshError, match=r"tet4.*lock.*overstate force by half and more.*tet10"):
        JaxSolver().check(linear.job, block("tet4", **size))
