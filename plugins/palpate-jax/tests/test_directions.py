"""Directions that come with the mesh, in its frame: turning mesh and fibres together changes no force."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate import AnisotropicMaterial, Parameter
from palpate.domain import Limb, Spot
from palpate.mesh.specimens import block
from palpate.mesh.spot_frame import spot_axes
from palpate_jax.body import Body, blocks
from palpate_jax.model import Model

Q = Rotation.from_euler("xyz", [40.0, -70.0, 25.0], degrees=True).as_matrix()
THETA = {"soft_tissue": np.array([0.02, 0.05])}
SMALL = {"n_across": 2, "n_down": 1, "width_mm": 4.0, "height_mm": 3.0}


class Fibred(AnisotropicMaterial):
    """A soft matrix and stiff fibres, along e1 or the directions of the mesh."""

    name, summary = "fibred", "one family of fibres"
    parameters = tuple(
        Parameter(name=n, unit="MPa", lower=0.01, upper=0.1, kind="modulus", description=n)
        for n in ("mu", "k")
    )

    def energy_from_F(self, F, theta, fields=None):  # noqa: N802 - the interface's name
        a = fields["fibre"] if fields else jnp.array([1.0, 0.0, 0.0])
        J = jnp.linalg.det(F)
        matrix = theta[0] / 2 * (jnp.sum(F * F) * J ** (-2 / 3) - 3.0) + jnp.log(J) ** 2
        return matrix + theta[1] * (jnp.sum((F @ a) ** 2) - 1.0) ** 2


class FromMesh(Fibred):
    fields = ("fibre",)


def with_fibres(limb, fibres):
    kind = next(iter(limb.mesh.cells))
    return replace(limb, mesh=replace(limb.mesh, cell_fields={"fibre": {kind: fibres}}))


def unit_vectors(n):
    found = np.random.default_rng(1).standard_normal((n, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def turned(limb, rotation):
    mesh = limb.mesh
    fields = {n: {k: v @ rotation.T for k, v in by_kind.items()} for n, by_kind in mesh.cell_fields.items()}
    spot = Spot(
        name="turned", position_mm=rotation @ limb.spot.position_mm, normal=rotation @ limb.spot.normal
    )
    return Limb(spot=spot, mesh=replace(mesh, points_mm=mesh.points_mm @ rotation.T, cell_fields=fields))


def forces_in_mesh_frame(limb, material, displacements):
    """Nodal forces of the model, which computes in the frame of the spot."""
    axes = spot_axes(limb.spot.normal)
    body = Model(limb, {"soft_tissue": material}, True).body
    return body.force(displacements @ axes, THETA)[0] @ axes.T


@pytest.mark.parametrize("kind", ["hex8", "tet4"])
def test_a_turned_mesh_with_turned_fibres_has_turned_forces(kind):
    limb = block(kind, **SMALL)
    limb = with_fibres(limb, unit_vectors(limb.mesh.n_cells))
    u = 0.1 * np.random.default_rng(2).standard_normal(limb.mesh.points_mm.shape)
    here = forces_in_mesh_frame(limb, FromMesh(), u)
    there = forces_in_mesh_frame(turned(limb, Q), FromMesh(), u @ Q.T)
    np.testing.assert_allclose(there, here @ Q.T, atol=1e-12 * np.abs(here).max())
    still = replace(turned(limb, Q).mesh, cell_fields=limb.mesh.cell_fields)
    other = forces_in_mesh_frame(replace(turned(limb, Q), mesh=still), FromMesh(), u @ Q.T)
    assert np.abs(other - here @ Q.T).max() > 1e-2 * np.abs(here).max()


def test_a_direction_of_the_settings_is_in_the_frame_of_the_mesh_and_not_of_the_spot():
    limb = turned(block("hex8", **SMALL), Q)
    along_x = with_fibres(limb, np.tile([1.0, 0.0, 0.0], (limb.mesh.n_cells, 1)))
    u = 0.1 * np.random.default_rng(2).standard_normal(limb.mesh.points_mm.shape)
    expected = forces_in_mesh_frame(along_x, FromMesh(), u)
    found = forces_in_mesh_frame(limb, Fibred(), u)
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


def test_the_stiffness_is_the_derivative_of_the_forces():
    limb = turned(block("hex8", **(SMALL | {"n_across": 1})), Q)
    limb = with_fibres(limb, unit_vectors(limb.mesh.n_cells))
    mesh, u = limb.mesh, 0.05 * np.random.default_rng(3).standard_normal((2, *limb.mesh.points_mm.shape))
    body = Body(mesh, {"soft_tissue": FromMesh()}, True, Q)
    n = mesh.points_mm.size
    unknowns = [(3 * b.nodes[:, :, None] + np.arange(3)).reshape(len(b.nodes), -1) for b in body.blocks]
    body.bind([n * each[:, :, None] + each[:, None, :] for each in unknowns], n * n)
    _, values, _ = body.tangent(u[0], THETA)
    stiffness = values.reshape(n, n)
    step = 1e-6
    ahead, behind = (body.force(u[0] + sign * step * u[1], THETA)[0] for sign in (1.0, -1.0))
    np.testing.assert_allclose(
        (stiffness @ u[1].ravel()).reshape(-1, 3), (ahead - behind) / (2 * step), atol=1e-7 * stiffness.max()
    )
    np.testing.assert_allclose(stiffness, stiffness.T, atol=1e-12 * stiffness.max())


def test_each_point_of_a_patch_has_the_field_of_its_cell():
    limb = block("tet4", **SMALL)
    fibres = np.arange(limb.mesh.n_cells, dtype=float)[:, None] + [1.0, 2.0, 3.0]
    limb = with_fibres(limb, fibres)
    (part,) = blocks(limb.mesh)
    real = part.volumes > 0.0
    assert sorted(part.fields["fibre"][real][:, 0].tolist()) == fibres[:, 0].tolist()
    assert np.abs(part.fields["fibre"][~real]).min(initial=1.0) > 0.0
    corners = limb.mesh.points_mm[limb.mesh.cells["tet4"]]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6.0
    order = np.argsort(part.fields["fibre"][real][:, 0])
    np.testing.assert_allclose(part.volumes[real][order], volumes)
