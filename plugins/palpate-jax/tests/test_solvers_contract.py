"""The embedded solver under the contract of solvers, on a block small enough to solve in a second.

What cannot be solved, and finer steps, are in ``test_solver_checks.py`` and ``oracles``.
"""

import numpy as np
import pytest

from palpate.domain import Indentation, Job
from palpate.domain.indenter import Sphere
from palpate.mesh.specimens import block
from palpate.testing import SolverContract
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials import NeoHookean

SOLVER = JaxSolver(JaxSettings(depth_steps=4, rotation_step_deg=5.0, tolerance=1e-9))
LIMB = block(n_across=4, n_down=2, width_mm=16.0, height_mm=10.0, layers_mm={"skin": 5.0})


def press(depth_mm, thetas=((0.2, 0.45), (0.05, 0.4))):
    return Job(
        spot="block",
        set_id=0,
        materials=dict.fromkeys(("skin", "soft_tissue"), NeoHookean()),
        thetas=dict(zip(("skin", "soft_tissue"), map(np.array, thetas), strict=True)),
        protocol=Indentation(
            indenter=Sphere(radius_mm=7.5),
            path=[(0.0, 0.0), (depth_mm, 0.0), (depth_mm, -10.0), (depth_mm, 0.0)],
            friction=0.6,
        ),
    )


class TestEmbeddedSolver(SolverContract):
    @pytest.fixture
    def solver(self):
        return SOLVER

    @pytest.fixture
    def job(self):
        return press(2.0)

    @pytest.fixture
    def limb(self):
        return LIMB
