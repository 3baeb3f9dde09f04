"""A rigid cuff on a thin layer around a rigid cylinder, against an elastic foundation and against a band.

A layer of thickness t and ν = 0 is a foundation: under a matching arc of half-angle α that is pressed by d,
p = E d cos θ/t · (R² + r²)/(R (R + r)) with r = R − t, the last factor from the hollow cylinder. So
F = ∫ p cos θ dA = p₀ R w (α + sin α cos α), and ∫ p dA = 2 p₀ R w sin α.

A band of tension T has p = T/(R w) everywhere and presses by F = 2 T sin α (rope over a drum). The mean
pressure of the rigid arc at that force is 2 sin²α/(α (α + sin α cos α)) times that of the band: 0.968 for an
arc of 120°. Turned about its axis until all of it slips, the arc needs the moment μ R ∫ p dA. For a band
that is R (T₂ − T₁) to first order of the capstan's T₂ = T₁ exp(2 α μ); an arc has no tension that grows.
"""

from dataclasses import replace

import numpy as np
import pytest

from palpate.mesh.specimens import block
from palpate_indentation import Cuff, CuffSettings
from palpate_jax.contact import ContactLaw
from palpate_jax.load_stepping import LoadStepping, Stop
from palpate_jax.model import Model
from palpate_jax.schedule import Schedule
from palpate_materials.neo_hookean import NeoHookean

RADIUS, THICK, WIDTH, HALF, MODULUS = 40.0, 1.0, 20.0, np.radians(60.0), 2.0
DEPTH, FRICTION, PENALTY = 0.01, 0.2, 200.0
"""The penalty is a hundred times the foundation's stiffness E/t, and takes a hundredth of the depth."""


def layer(n_across):
    """A bent block: a layer over ±60°, held inside, whose free edges change nothing where ν = 0."""
    limb = block("tet10", n_across=n_across, n_down=1, width_mm=2.0 * RADIUS * HALF, height_mm=THICK)
    x, y, z = limb.mesh.points_mm.T
    angle, radius = x / RADIUS, RADIUS + z
    y = y * WIDTH / (2.0 * RADIUS * HALF)
    points = np.stack([radius * np.sin(angle), y, radius * np.cos(angle) - RADIUS], axis=1)
    return replace(limb, mesh=replace(limb.mesh, points_mm=points))


@pytest.fixture(scope="module")
def along():
    """The last state of a cuff that is wider and longer than the layer, and ∫ p dA."""

    def of(n_across, poses, friction):
        model = Model(layer(n_across), {"soft_tissue": NeoHookean()}, mean_dilatation=True)
        cuff = Cuff(CuffSettings(radius=f"{RADIUS} mm", angle="150 deg", width="40 mm", edge="3 mm"))
        law = ContactLaw(cuff, PENALTY, friction)
        stepping = LoadStepping(model, {"soft_tissue": np.array([MODULUS, 0.0])}, law, 1e-8)
        *_, step = stepping.along(Schedule.through(np.array(poses)))
        assert not isinstance(step, Stop)
        touched = model.contact.touched(step.displacements, step.load)
        return step.answer, float(model.contact.areas[touched.where] @ touched.points.pressure)

    return of


@pytest.mark.slow
def test_a_rigid_arc_presses_like_a_foundation_and_nearly_like_a_band(along, observed_order):
    """Measured −3.0 and −0.2 % on meshes of 8 and 12 cells; the ratio of the mean pressures to 0.03 %."""
    inner = RADIUS - THICK
    hollow = (RADIUS**2 + inner**2) / (RADIUS * (RADIUS + inner))
    most = MODULUS * DEPTH / (THICK + MODULUS / PENALTY) * hollow
    expected = most * RADIUS * WIDTH * (HALF + np.sin(HALF) * np.cos(HALF))
    found = [along(n, [[DEPTH, 0, 0, 0, 0, 0]], 0.0) for n in (8, 12)]
    errors = [answer.force_N[2] / expected - 1.0 for answer, _ in found]
    assert observed_order("force of a cuff, tet10", errors, (8, 12)) > 2.0
    assert abs(errors[1]) < 0.005
    answer, load = found[1]
    band = answer.force_N[2] / (2.0 * np.sin(HALF)) / (RADIUS * WIDTH)
    ratio = 2.0 * np.sin(HALF) ** 2 / (HALF * (HALF + np.sin(HALF) * np.cos(HALF)))
    assert load / (2.0 * HALF * RADIUS * WIDTH) / band == pytest.approx(ratio, rel=2e-3)
    assert ratio == pytest.approx(0.968, abs=1e-3)


@pytest.mark.slow
def test_an_arc_that_slips_round_the_limb_needs_friction_times_pressure_times_radius(along):
    """Pressed, then turned about the arc's axis: a tilt, a slide and a lift together."""
    turn = 5.0 * DEPTH / RADIUS
    lateral, up = RADIUS * np.sin(turn), RADIUS * (1.0 - np.cos(turn))
    poses = [[DEPTH, 0, 0, 0, 0, 0], [DEPTH + up, lateral, 0, 0, np.degrees(turn), 0]]
    answer, load = along(6, poses, FRICTION)
    assert answer.sticking == 0.0
    centre = np.array([0.0, 0.0, -RADIUS - DEPTH])
    moment = answer.moment_Nmm + np.cross(centre, answer.force_N)  # the force on the tissue is against it
    np.testing.assert_allclose(moment / (FRICTION * RADIUS * load), [0.0, 1.0, 0.0], atol=5e-3)
    assert moment[1] == pytest.approx(FRICTION * RADIUS * load, rel=1e-5)
