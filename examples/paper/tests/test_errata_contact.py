"""Erratum 6, on the embedded solver: a soft contact lets the sphere sink in, and linear tetrahedra lock."""

from typing import Any

import numpy as np

from palpate.domain import Indentation, Job, Limb, Simulation, Status
from palpate.domain.indenter import Sphere
from palpate.mesh.specimens import block
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.uncoupled import Yeoh

RADIUS_MM, DEPTH_MM, HEIGHT_MM = 7.5, 2.0, 10.0
NEARLY_INCOMPRESSIBLE = np.array([0.0141, -0.0011, 1.05e-4, 40 * 2 * 0.0141])
PRESS = [(0.0, 0.0), (DEPTH_MM, 0.0)]


def solved(limb: Limb, path: list[tuple[float, float]], **settings: Any) -> Simulation:
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


def test_erratum_6a_a_sphere_sinks_into_a_contact_as_soft_as_the_tissue() -> None:
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


def test_erratum_6b_linear_tetrahedra_lock_unless_patches_share_their_volume() -> None:
    """At κ/μ = 40 plain ones triple the force on this coarse mesh; as the solver takes them they do not.

    What is left is what straight tetrahedra lose anyway: 27 % here at κ/μ = 1, 6 % with 14 cells across.
    """
    size = {"n_across": 6, "n_down": 3, "width_mm": 24.0, "height_mm": HEIGHT_MM, "grading": 1.4}
    hexes, tets = block("hex8", **size), block("tet4", **size)
    right, patched, plain = (
        solved(limb, PRESS, mean_dilatation=mean).response["force"].ordinate[-1]
        for limb, mean in ((hexes, True), (tets, True), (tets, False))
    )
    assert plain > 2.5 * right
    assert patched < 1.3 * right
