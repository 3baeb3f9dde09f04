"""The contract of a material, closed forms along and across the fibres, and its symmetry."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import palpate_fibre
from palpate import mechanics
from palpate.api import HomogeneousTests, Job, Status
from palpate.api.mesh import block
from palpate.testing import MaterialContract, plugins_with
from palpate_fibre import Reinforced, ReinforcedSettings
from palpate_jax.body import Body
from palpate_jax.homogeneous import HomogeneousSettings, HomogeneousSolver

MU, K1, K2, KAPPA = THETA = np.array([0.02, 0.05, 2.0, 1.0])
ALONG, ACROSS = (Reinforced(ReinforcedSettings(direction=a)) for a in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
OBLIQUE = Reinforced(ReinforcedSettings(direction=(1.0, -1.0, 0.5)))
IN_FIELD = Reinforced(ReinforcedSettings(field="fibre"))


class TestReinforced(MaterialContract):
    @pytest.fixture(params=[ALONG, IN_FIELD], ids=["one direction", "a field"])
    def material(self, request):
        return request.param

    @pytest.fixture
    def gradients(self):
        """Leave out rest: the tangent of fibres that bear tension alone jumps there."""
        e = self.largest_strain
        random = np.random.default_rng(1).uniform(-e, e, (3, 3, 3))
        return np.eye(3) + np.concatenate([[np.diag([e, -e / 2, -e / 2]), np.diag([e, e, e]) / 3], random])


def pulled(material, t):
    """Nominal stress of an incompressible strip that is pulled along e1."""
    job = Job(
        spot="strip",
        set_id=0,
        materials={"strip": material},
        thetas={"strip": THETA},
        protocol=HomogeneousTests(paths={"uniaxial": t}),
    )
    solver = HomogeneousSolver(HomogeneousSettings(incompressible=True))
    simulation = solver.simulate(job, None)
    assert simulation.status is Status.OK, simulation.message
    return simulation.response["uniaxial"].ordinate


def fibre_slope(stretch):
    """Derivative of the fibres' energy in their stretch; none when shortened."""
    longer = np.maximum(stretch**2 - 1, 0)
    return 2 * K1 * longer * np.exp(K2 * longer**2) * stretch


def across(t):
    """Stress across the fibres, whose stretch y is where the energy is least."""
    y = brentq(lambda y: MU * (y - 1 / (t * t * y**3)) + fibre_slope(y), 0.3, 2.0, xtol=1e-15)
    return MU * (t - 1 / (t**3 * y * y))


def test_a_strip_across_the_fibres():
    t = np.linspace(0.7, 1.4, 8)
    np.testing.assert_allclose(pulled(ACROSS, t), [across(x) for x in t], atol=1e-12)


def test_a_strip_along_the_fibres():
    t = np.linspace(0.7, 1.4, 8)
    P = np.asarray(mechanics.stress(ALONG, np.array([np.diag([x, x**-0.5, x**-0.5]) for x in t]), THETA))
    # The pressure that keeps the volume also frees the sides: it is what they bear.
    nominal = P[:, 0, 0] - P[:, 1, 1] * t**-1.5
    np.testing.assert_allclose(nominal, MU * (t - t**-2) + fibre_slope(t), atol=1e-12)


def test_turning_the_body_about_its_fibres_changes_nothing():
    F = np.eye(3) + np.random.default_rng(0).uniform(-0.2, 0.2, (3, 3))
    axis, angle = np.array([1.0, -1.0, 0.5]) / 1.5, 0.7
    cross = np.cross(np.eye(3), axis)
    about_fibre = np.eye(3) - np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    energy = float(OBLIQUE.energy_from_F(jnp.asarray(F), THETA))
    assert float(OBLIQUE.energy_from_F(jnp.asarray(F @ about_fibre), THETA)) == pytest.approx(
        energy, rel=1e-12
    )
    other = about_fibre[[1, 2, 0]][:, [1, 2, 0]]
    assert float(OBLIQUE.energy_from_F(jnp.asarray(F @ other), THETA)) != pytest.approx(energy, rel=1e-3)


def test_fibres_may_bear_compression_too():
    F = jnp.diag(jnp.array([0.8, 1.0, 1.0]))
    both = Reinforced(ReinforcedSettings(tension_only=False))
    more = both.energy_from_F(F, THETA) - ALONG.energy_from_F(F, THETA)
    assert float(more) == pytest.approx(K1 / (2 * K2) * np.expm1(K2 * 0.36**2), rel=1e-12)


def test_fibres_change_the_result_of_finite_elements():
    """In an affinely deformed block the moment of the nodal forces, Σ f ⊗ X, is P times the volume."""
    mesh = block("hex8", n_across=2, n_down=1, width_mm=4.0, height_mm=3.0).mesh
    F = np.eye(3) + np.array([[0.1, 0.05, 0.0], [0.0, -0.05, 0.02], [0.0, 0.0, -0.03]])
    u = mesh.points_mm @ (F - np.eye(3)).T
    body = Body(mesh, {"soft_tissue": OBLIQUE}, True)
    forces, _ = body.force(u, {"soft_tissue": THETA})
    P = np.asarray(mechanics.stress(OBLIQUE, F, THETA))
    np.testing.assert_allclose(forces.T @ mesh.points_mm, P * 4.0 * 4.0 * 3.0, atol=1e-12)


def test_fibres_may_be_in_the_mesh():
    mesh = block("hex8", n_across=2, n_down=1, width_mm=4.0, height_mm=3.0).mesh
    of_mesh = Reinforced(ReinforcedSettings(field="fibre"))
    fibres = {"fibre": {"hex8": np.tile([2.0, -2.0, 1.0], (mesh.n_cells, 1))}}
    u = 0.05 * np.random.default_rng(1).standard_normal(mesh.points_mm.shape)
    expected, _ = Body(mesh, {"soft_tissue": OBLIQUE}, True).force(u, {"soft_tissue": THETA})
    found, _ = Body(replace(mesh, cell_fields=fibres), {"soft_tissue": of_mesh}, True).force(
        u, {"soft_tissue": THETA}
    )
    np.testing.assert_allclose(found, expected, atol=1e-14)


def test_palpate_finds_both():
    plugins = plugins_with(palpate_fibre)
    assert plugins.materials["reinforced"] is Reinforced
    assert "strip" in plugins.loaders


def test_fibres_have_a_direction():
    with pytest.raises(ValueError, match="points nowhere"):
        ReinforcedSettings(direction=(0.0, 0.0, 0.0))
