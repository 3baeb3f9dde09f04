"""A box pressed into a block: the same force on a finer mesh and after a turn, and no moment that tilts it.

Measured at 8, 16 and 24 cells across: 7.948, 8.053 and 7.953 N.
"""

import numpy as np
import pytest

from palpate.domain import Indentation, Job, Status
from palpate.mesh.specimens import block
from palpate_indentation import Box, BoxSettings
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.neo_hookean import NeoHookean


@pytest.fixture(scope="module")
def pressed():
    def of(n_across, turn):
        sides = {"length": "20 mm", "width": "10 mm", "height": "8 mm", "edge": "3 mm"}
        box = Box(BoxSettings(**sides, turn=turn))
        job = Job(
            spot="block",
            set_id=0,
            materials={"soft_tissue": NeoHookean()},
            thetas={"soft_tissue": np.array([0.1, 0.45])},
            protocol=Indentation(indenter=box, path=[(0, 0), (3, 0)], friction=0.0),
        )
        limb = block("hex8", n_across=n_across, n_down=n_across // 2, width_mm=40.0, height_mm=15.0)
        simulation = JaxSolver(JaxSettings(depth_steps=3)).simulate(job, limb)
        assert simulation.status is Status.OK, simulation.message
        last = simulation.diagnostics
        return np.array(last["force_N"][-1]), np.array(last["moment_Nmm"][-1])

    return of


@pytest.mark.slow
def test_a_finer_mesh_gives_the_same_force(pressed):
    (coarse, _), (fine, _) = pressed(8, "0 deg"), pressed(16, "0 deg")
    assert coarse[2] == pytest.approx(fine[2], rel=0.02)


@pytest.mark.slow
def test_a_turned_box_on_a_square_block_presses_alike_and_does_not_tilt(pressed):
    (straight, _), (turned, moment) = pressed(8, "0 deg"), pressed(8, "90 deg")
    assert turned[2] == pytest.approx(straight[2], rel=1e-4)
    np.testing.assert_allclose(turned[:2], 0.0, atol=1e-4 * turned[2])
    np.testing.assert_allclose(moment, 0.0, atol=1e-3 * turned[2])
