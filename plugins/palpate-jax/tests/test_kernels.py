"""The compiled element kernels against those that JAX differentiates as a whole."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from palpate.domain.material import AnisotropicMaterial
from palpate.mesh.specimens import block
from palpate_jax.autodiff import AutodiffKernel
from palpate_jax.body import Body, blocks
from palpate_jax.compiled import POINTS, CompiledKernel, serves
from palpate_materials.neo_hookean import NeoHookean
from palpate_materials.uncoupled import Ogden, Yeoh, modulus

COUPLED = (NeoHookean(), np.array([0.07, 0.44]))
OGDEN = (Ogden(), np.array([0.061, 3.1, 1.3]))
YEOH = (Yeoh(), np.array([0.0141, -0.0011, 1.05e-4, 0.8]))
STATES = ("rest", "pulled", "almost", "scattered")


def displaced(points, state):
    """Rest, two equal stretches, almost equal ones, and any."""
    noise = np.random.default_rng(8).standard_normal(points.shape)
    pulled = points * (np.array([0.9, 0.9, 1.3]) - 1.0)
    return {
        "rest": np.zeros_like(points),
        "pulled": pulled,
        "almost": pulled + 1e-7 * noise,
        "scattered": pulled + 0.05 * noise,
    }[state]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "mean", "law"),
    [
        ("hex8", True, COUPLED),
        ("tet10", True, YEOH),
        ("tet4", True, OGDEN),
        ("hex8", False, OGDEN),
        ("tet10", False, COUPLED),
    ],
    ids=lambda v: v if isinstance(v, str) else "mean" if v is True else "plain" if v is False else v[0].name,
)
def test_compiled_kernels_agree_with_autodiff(kind, mean, law):
    mesh = block(kind, n_across=2, n_down=2, width_mm=4.0, height_mm=3.0).mesh
    (part,) = blocks(mesh, mean)
    size = 3 * mesh.n_nodes
    unknowns = (3 * part.nodes[:, :, None] + np.arange(3)).reshape(len(part.nodes), -1)
    places = unknowns[:, :, None] * size + unknowns[:, None, :]
    material, theta = law
    kernels = [
        kernel(material, part.nodes, part.gradients, part.volumes, mean)
        for kernel in (CompiledKernel, AutodiffKernel)
    ]
    for kernel in kernels:
        kernel.bind(places)
    for state in STATES:
        u = displaced(mesh.points_mm, state)
        answers = []
        for kernel in kernels:
            total, values = np.zeros(u.shape), np.zeros(size**2 + 1)
            least = kernel.add_tangent(u, theta, total, values)
            answers.append((total, values, least))
        alone = np.zeros(u.shape)
        assert kernels[0].add_force(u, theta, alone) == answers[0][2]
        np.testing.assert_allclose(alone, answers[0][0], atol=1e-14)
        (force, stiffness, least), (forces, stiffnesses, smallest) = answers
        assert least == pytest.approx(smallest, rel=1e-13)
        # At rest there is no force: what rounding leaves is measured by the stiffness.
        scale = np.abs(forces).max() + 1e-4 * np.abs(stiffnesses).max()
        np.testing.assert_allclose(force, forces, atol=1e-10 * scale)
        np.testing.assert_allclose(stiffness, stiffnesses, atol=1e-10 * np.abs(stiffnesses).max())


def test_more_points_than_are_differentiated_at_a_time_change_nothing():
    mesh = block("hex8", n_across=8, n_down=9, width_mm=4.0, height_mm=3.0).mesh
    (part,) = blocks(mesh, True)
    assert part.volumes.size > POINTS
    material, theta = YEOH
    u = displaced(mesh.points_mm, "scattered") * 0.1
    whole, halves = np.zeros(u.shape), np.zeros(u.shape)
    CompiledKernel(material, part.nodes, part.gradients, part.volumes, True).add_force(u, theta, whole)
    for half in (slice(None, 300), slice(300, None)):
        own = (part.nodes[half], part.gradients[half], part.volumes[half])
        CompiledKernel(material, *own, True).add_force(u, theta, halves)
    np.testing.assert_allclose(halves, whole, atol=1e-14 * np.abs(whole).max())


class InF(AnisotropicMaterial):
    """The coupled neo-Hookean material written in F, as if it had directions."""

    name, summary = "in_f", ""
    parameters = (modulus("mu", 0.1, 1.0, "shear modulus"), modulus("lame", 0.1, 1.0, "Lamé's first"))

    def energy_from_F(self, F, theta):  # noqa: N802 - the interface's name
        log = jnp.log(jnp.linalg.det(F))
        return 0.5 * theta[0] * (jnp.sum(F * F) - 3.0) - theta[0] * log + 0.5 * theta[1] * log**2


def test_a_material_with_directions_takes_the_other_kernels():
    assert serves(NeoHookean())
    assert not serves(InF())
    mesh = block("hex8", n_across=2, n_down=1, width_mm=4.0, height_mm=3.0).mesh
    young, poisson = COUPLED[1]
    lame = [young / (2 * (1 + poisson)), young * poisson / ((1 + poisson) * (1 - 2 * poisson))]
    u = displaced(mesh.points_mm, "scattered")
    same, expected = (
        Body(mesh, {"soft_tissue": material}, True).force(u, {"soft_tissue": np.asarray(theta)})
        for material, theta in ((InF(), lame), COUPLED)
    )
    np.testing.assert_allclose(same[0], expected[0], atol=1e-12 * np.abs(expected[0]).max())
    assert same[1] == pytest.approx(expected[1])


def test_a_gpu_takes_the_other_kernels(monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert not serves(NeoHookean())


def test_a_tangent_without_places_is_refused():
    mesh = block("hex8", n_across=1, n_down=1, width_mm=4.0, height_mm=3.0).mesh
    body = Body(mesh, {"soft_tissue": COUPLED[0]}, True)
    with pytest.raises(RuntimeError, match="call `bind` first"):
        body.tangent(np.zeros_like(mesh.points_mm), {"soft_tissue": COUPLED[1]})
