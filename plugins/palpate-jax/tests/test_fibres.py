"""Fibres of a built-in material under a press and two slides: slopes, limits and directions."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.api import Indentation, Job, Status
from palpate.domain.channels import LATERAL_FORCE
from palpate.domain.indenter import Sphere
from palpate.mesh.specimens import block
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials import HolzapfelGasserOgden, Yeoh
from palpate_materials.fibres import FibreSettings
from palpate_materials.uncoupled import YeohSettings

SOLVER = JaxSolver(JaxSettings(depth_steps=3, tolerance=1e-11))
FIBRES = HolzapfelGasserOgden(FibreSettings(dispersion=True))
THETA = np.array([0.004, 0.015, 1.0, 0.1, 0.16])
PRESS, DEPTH_MM, SHIFT_MM = "soft_tissue", 2.0, 1.0


def limb(axis=(1.0, 0.0, 0.0)):
    """A block whose mesh has the direction of the limb's axis."""
    found = block("hex8", n_across=6, n_down=2, width_mm=24.0, height_mm=10.0)
    axes = {"axis": {"hex8": np.tile(axis, (found.mesh.n_cells, 1))}}
    return replace(found, mesh=replace(found.mesh, cell_fields=axes))


def curves(theta=THETA, material=FIBRES, slide=(1.0, 0.0), of=None, **job):
    """Force, and lateral force of a slide, each (n,) with slopes by full name if asked for."""
    path = np.array([[0.0, 0.0], [DEPTH_MM, 0.0], [DEPTH_MM, 0.0]])
    lateral = np.zeros((3, 4))
    lateral[2, :2] = SHIFT_MM * np.asarray(slide)
    protocol = Indentation(indenter=Sphere(radius_mm=7.5), path=path, friction=0.5, lateral=lateral)
    asked = Job(
        spot="block",
        set_id=0,
        materials={PRESS: material},
        thetas={PRESS: np.asarray(theta)},
        protocol=protocol,
        channels=(*Job(spot="", set_id=0).channels, LATERAL_FORCE),
        **job,
    )
    found = SOLVER.simulate(asked, of or limb())
    assert found.status is Status.OK, found.message
    return found.response.curves


def largest(curve):
    return float(np.abs(curve.ordinate).max())


@pytest.mark.slow
def test_slopes_of_a_press_and_a_slide_are_those_of_differences():
    found = curves(slopes=True)
    for k, parameter in enumerate(FIBRES.parameters):
        step = np.zeros(THETA.size)
        step[k] = 1e-5 * THETA[k]
        ahead, behind = curves(THETA + step), curves(THETA - step)
        for channel in ("force", "lateral_force"):
            rise = (ahead[channel].ordinate - behind[channel].ordinate) / (2.0 * step[k])
            slope = found[channel].slopes[f"{PRESS}.{parameter.name}"]
            np.testing.assert_allclose(slope, rise, atol=1e-4 * np.abs(rise).max(), err_msg=parameter.name)


@pytest.mark.slow
def test_fibres_are_felt_by_the_difference_of_two_slides():
    """A press alone is the same for fibres along x and along y; its slides are not."""
    along, across = curves(slide=(1.0, 0.0)), curves(slide=(0.0, 1.0))
    turned = curves(slide=(0.0, 1.0), of=limb(axis=(0.0, 3.0, 0.0)))
    np.testing.assert_allclose(turned["force"].ordinate, along["force"].ordinate, rtol=1e-7)
    # One of them needs the limits of friction held in a step, which changes the force of slip a little.
    assert largest(turned["lateral_force"]) == pytest.approx(largest(along["lateral_force"]), rel=2e-3)
    assert largest(across["lateral_force"]) > 1.05 * largest(along["lateral_force"])


@pytest.mark.slow
def test_without_stiffness_fibres_are_their_ground():
    bare = curves([THETA[0], 0.0, 1.0, 0.1, THETA[-1]])
    ground = curves(THETA[[0, -1]], Yeoh(YeohSettings(terms=1)))
    for channel in ("force", "lateral_force"):
        np.testing.assert_allclose(bare[channel].ordinate, ground[channel].ordinate, atol=1e-8)
