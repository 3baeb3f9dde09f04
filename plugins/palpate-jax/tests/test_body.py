import numpy as np
import pytest

from palpate.mesh.specimens import block
from palpate_jax.body import Body, blocks
from palpate_jax.elements import ELEMENTS
from palpate_materials.neo_hookean import NeoHookean
from palpate_materials.uncoupled import Yeoh

YEOH = np.array([0.0141, -0.0011, 1.05e-4, 0.8])
SMALL = {"n_across": 2, "n_down": 2, "width_mm": 4.0, "height_mm": 3.0}


def dense_places(nodes, n_nodes):
    """Places (e, 3n, 3n) in a dense matrix over the unknowns of all nodes."""
    unknowns = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1)
    return unknowns[:, :, None] * (3 * n_nodes) + unknowns[:, None, :]


@pytest.mark.parametrize("kind", ["hex8", "tet10", "tet4"])
def test_shape_functions_sum_to_one_and_slopes_to_zero(kind):
    element = ELEMENTS[kind]
    np.testing.assert_allclose(element.slopes.sum(axis=1), 0.0, atol=1e-14)
    np.testing.assert_allclose(element.face.values.sum(axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(element.face.slopes.sum(axis=1), 0.0, atol=1e-14)


@pytest.mark.parametrize("kind", ["hex8", "tet10", "tet4"])
def test_volumes_add_up_to_the_block(kind):
    total = sum(b.volumes.sum() for b in blocks(block(kind, **SMALL).mesh))
    assert total == pytest.approx(4.0 * 4.0 * 3.0, rel=1e-13)


@pytest.mark.parametrize("mean_dilatation", [True, False])
@pytest.mark.parametrize("kind", ["hex8", "tet10"])
def test_patch_of_constant_deformation_balances_inside(kind, mean_dilatation):
    mesh = block(kind, **SMALL).mesh
    body = Body(mesh, {"soft_tissue": Yeoh()}, mean_dilatation)
    F = np.array([[1.1, 0.2, 0.0], [0.05, 0.9, 0.1], [0.0, -0.1, 1.05]])
    forces, least = body.force(mesh.points_mm @ (F - np.eye(3)).T, {"soft_tissue": YEOH})
    span = np.abs(mesh.points_mm - mesh.points_mm.mean(axis=0)).max(axis=0)
    inside = (np.abs(mesh.points_mm - mesh.points_mm.mean(axis=0)) < span - 1e-9).all(axis=1)
    assert inside.any()
    assert least == pytest.approx(np.linalg.det(F), rel=1e-12)
    assert np.abs(forces[inside]).max() < 1e-12 * np.abs(forces).max()


@pytest.mark.parametrize("mean_dilatation", [True, False])
@pytest.mark.parametrize(
    ("kind", "material", "theta"), [("hex8", Yeoh(), YEOH), ("tet10", NeoHookean(), [0.07, 0.44])]
)
def test_stiffness_is_the_derivative_of_the_forces_and_symmetric(kind, material, theta, mean_dilatation):
    mesh = block(kind, **SMALL).mesh
    body = Body(mesh, {"soft_tissue": material}, mean_dilatation)
    thetas = {"soft_tissue": np.asarray(theta)}
    rng = np.random.default_rng(3)
    u, d = 0.1 * rng.standard_normal((2, mesh.n_nodes, 3))
    body.bind([dense_places(b.nodes, mesh.n_nodes) for b in body.blocks], u.size**2)
    _, values, _ = body.tangent(u, thetas)
    stiffness = values.reshape(u.size, u.size)
    np.testing.assert_allclose(stiffness, stiffness.T, atol=1e-12 * np.abs(stiffness).max())
    h = 1e-6
    slope = (body.force(u + h * d, thetas)[0] - body.force(u - h * d, thetas)[0]) / (2 * h)
    np.testing.assert_allclose((stiffness @ d.ravel()).reshape(-1, 3), slope, atol=1e-7 * np.abs(slope).max())


def test_force_is_the_slope_of_the_energy_at_the_mean_dilatation():
    mesh, material = block("hex8", **SMALL).mesh, Yeoh()
    body = Body(mesh, {"soft_tissue": material}, True)
    (part,) = body.blocks
    rng = np.random.default_rng(5)
    u, d = 0.1 * rng.standard_normal((2, mesh.n_nodes, 3))

    def energy(displacements):
        F = np.eye(3) + np.einsum("eai,eqaj->eqij", displacements[part.nodes], part.gradients)
        J = np.linalg.det(F)
        mean = (part.volumes * J).sum(axis=1, keepdims=True) / part.volumes.sum(axis=1, keepdims=True)
        stretches = np.linalg.svd(np.cbrt(mean / J)[..., None, None] * F, compute_uv=False)
        return (part.volumes * material.energy(stretches, YEOH)).sum()

    h = 1e-5
    slope = (energy(u + h * d) - energy(u - h * d)) / (2 * h)
    forces, _ = body.force(u, {"soft_tissue": YEOH})
    assert (forces * d).sum() == pytest.approx(slope, rel=1e-7)


def test_rigid_motion_costs_no_force():
    mesh = block("tet10", **SMALL).mesh
    body = Body(mesh, {"soft_tissue": Yeoh()}, True)
    c, s = np.cos(1.0), np.sin(1.0)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    forces, _ = body.force(mesh.points_mm @ turn.T + 3.0 - mesh.points_mm, {"soft_tissue": YEOH})
    assert np.abs(forces).max() < 1e-13


def test_an_inverted_element_shows_in_the_least_jacobian():
    mesh = block("hex8", **SMALL).mesh
    flat = np.zeros_like(mesh.points_mm)
    flat[:, 2] = -2.0 * mesh.points_mm[:, 2]
    assert Body(mesh, {"soft_tissue": Yeoh()}, True).force(flat, {"soft_tissue": YEOH})[1] < 0.0
