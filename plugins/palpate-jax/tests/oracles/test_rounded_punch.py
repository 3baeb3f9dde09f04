"""A punch with a rounded edge on a bonded layer: the force of the flat one, F = 2 E* a d κ.

The rounding is a twentieth of the face's radius a = 1 mm, and at this depth the contact ends 0.2 % beyond the
face. What is left is the error of the mesh at the edge of the face, where the stress is nearly singular.
"""

from dataclasses import replace

import numpy as np
import pytest

from palpate.mesh.specimens import layer
from palpate_indentation import Punch, PunchSettings
from palpate_jax.contact import ContactLaw
from palpate_jax.load_stepping import LoadStepping, Stop
from palpate_jax.model import Model
from palpate_jax.schedule import Schedule
from palpate_materials.neo_hookean import NeoHookean

KAPPA, RATIO, NU, DEPTH = 2.5354, 0.8, 0.45, 1e-3


def force_error(n_radius):
    """Relative error of the force; the contact ends two rings of nodes beyond the face."""
    limb = layer("hex8", 1.0 / RATIO, 1.0, extent=4.0, n_radius=n_radius, n_core=6, crowding=1.8, growth=1.5)
    points = limb.mesh.points_mm
    radius, on_top = np.hypot(points[:, 0], points[:, 1]), points[:, 2] == 0.0
    rings = np.unique(np.round(radius[on_top], 3))
    touchable = np.flatnonzero(on_top & (radius <= rings[rings > 1.02][1] + 1e-3))
    limb = replace(limb, mesh=replace(limb.mesh, node_sets={**limb.mesh.node_sets, "contact": touchable}))
    theta = np.array([2.0 * (1.0 + NU), NU])
    model = Model(limb, {"soft_tissue": NeoHookean()}, mean_dilatation=True)
    law = ContactLaw(Punch(PunchSettings(radius="1.05 mm", edge="0.05 mm")), 5000.0, 0.0)
    (step,) = LoadStepping(model, {"soft_tissue": theta}, law, 1e-6).along(
        Schedule.through(np.array([[DEPTH, 0, 0, 0, 0, 0]]))
    )
    assert not isinstance(step, Stop)
    assert step.answer.contact_radius_mm == pytest.approx(1.0, abs=0.01)
    return step.answer.force_N[2] / (4.0 / (1.0 - NU) * DEPTH * KAPPA) - 1.0


@pytest.mark.slow
def test_a_rounded_punch_presses_a_layer_like_a_flat_one(observed_order):
    errors = [force_error(n) for n in (8, 12)]
    order = observed_order("rounded punch on a layer", errors, (8, 12))
    assert 0.0 < errors[1] < 0.02
    assert order > 1.0
