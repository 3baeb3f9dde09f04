"""Fibres along the limb's axis, as ``palpate limb`` writes it: simulated, and their stiffness found again."""

from collections.abc import Mapping
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import palpate_indentation
import palpate_jax
from palpate import AnisotropicMaterial, Parameter, hookimpl, open_problem, read_study
from palpate.api import NO_FIELDS
from palpate.api.mechanics import Array
from palpate.simulation.synthesis import synthesise
from palpate.testing import plugins_with

from .block_study import study_of, write_block

STUDY = (
    study_of(("p1",), ("muscle",))
    + """
[region.muscle]
material = "along_the_limb"

[truth]
muscle.k = "30 kPa"
"""
)


class AlongTheLimb(AnisotropicMaterial):
    """A soft matrix, and fibres along the axis of the mesh."""

    name, summary, fields = "along_the_limb", "fibres along the limb", ("axis",)
    parameters = (
        Parameter(name="k", unit="MPa", lower=0.005, upper=0.1, kind="modulus", description="fibres"),
    )

    def energy_from_F(  # noqa: N802 - the interface's name
        self, F: Array, theta: Array, fields: Mapping[str, Array] = NO_FIELDS
    ) -> Array:
        along = fields["axis"] if fields else jnp.array([1.0, 0.0, 0.0])
        J = jnp.linalg.det(F)
        matrix = 0.005 * (jnp.sum(F * F) * J ** (-2 / 3) - 3.0) + 0.1 * jnp.log(J) ** 2
        return matrix + theta[0] * (jnp.sum((F @ along) ** 2) - 1.0) ** 2


class Provides:
    """The plugin."""

    @hookimpl
    def palpate_materials(self) -> list[type[AlongTheLimb]]:
        return [AlongTheLimb]


@pytest.mark.slow
def test_the_stiffness_of_fibres_along_the_axis_is_found(tmp_path: Path) -> None:
    plugins = plugins_with(palpate_indentation, palpate_jax, Provides())
    (tmp_path / "study.toml").write_text(STUDY)
    write_block(tmp_path / "p1.vtu", {}, fields={"axis": np.array([1.0, 0.0, 0.0])})
    study = read_study(tmp_path / "study.toml", plugins, need_measured=False)
    synthesise(study, plugins.channels)
    with open_problem(study, plugins=plugins) as problem:
        k = problem.start
        for _ in range(4):  # Gauss-Newton
            slope = problem.jacobian(k)[:, 0]
            k = np.clip(k - slope @ problem.residuals(k) / (slope @ slope), *problem.bounds)
        assert k == pytest.approx([0.03], rel=1e-3)
        assert problem.fopt(k) < 1e-6
    write_block(tmp_path / "p1.vtu", {}, fields={"axis": np.array([0.0, 0.0, 1.0])})
    with open_problem(study, plugins=plugins) as problem:
        assert problem.fopt([0.03]) > 1e-3, "the field of the mesh decides"
