"""Directions that come with the mesh, in its frame: turning mesh and fibres together changes no force."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate import AnisotropicMaterial, Parameter
from palpate.domain import Job, Limb, RegionMaterial, Spot
from palpate.errors import MeshError, SolverError, StudyError
from palpate.mesh.spot_frame import spot_axes
from palpate.plugins.interfaces import LimbSource
from palpate.run.keys import limb_key
from palpate.specimens import block
from palpate.stages.cell_fields import check_frames, with_fields
from palpate.stages.limb import load_limbs
from palpate.stages.simulation import check_jobs
from palpate_febio.settings import FebioSettings
from palpate_febio.solver import FebioSolver
from palpate_jax.body import Body, blocks
from palpate_jax.model import Model

Q = Rotation.from_euler("xyz", [40.0, -70.0, 25.0], degrees=True).as_matrix()
THETA = {"soft_tissue": np.array([0.02, 0.05])}
SMALL = {"n_across": 2, "n_down": 1, "width_mm": 4.0, "height_mm": 3.0}


class Fibred(AnisotropicMaterial):
    """A soft matrix and stiff fibres, along e1 or along what the mesh says."""

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


def test_a_field_is_part_of_the_key_of_the_limb():
    limb = block("hex8", **SMALL)
    fibres = unit_vectors(limb.mesh.n_cells)
    keys = {limb_key(each) for each in (limb, with_fibres(limb, fibres), with_fibres(limb, -fibres))}
    assert len(keys) == 3


def region_of(material):
    return RegionMaterial(region="soft_tissue", material=material, searched=material.parameters, fixed={})


def test_a_limb_keeps_the_fields_that_its_materials_take():
    limb = block("hex8", **SMALL)
    limb = with_fibres(limb, unit_vectors(limb.mesh.n_cells))
    assert list(with_fields(limb, [region_of(FromMesh())]).mesh.cell_fields) == ["fibre"]
    assert list(with_fields(limb, [region_of(Fibred())]).mesh.cell_fields) == []
    with pytest.raises(
        MeshError, match=r"'fibred' of region 'soft_tissue' takes cell data 'fibre', .*there: none"
    ):
        with_fields(block("hex8", **SMALL), [region_of(FromMesh())])


@pytest.mark.parametrize(("row", "message"), [([0, 0, 0], r"\[0.0, 0.0, 0.0\]"), ([1, np.nan, 0], "nan")])
def test_an_element_without_a_direction_is_named(row, message):
    limb = block("hex8", **SMALL)
    fibres = unit_vectors(limb.mesh.n_cells)
    fibres[2] = row
    with pytest.raises(MeshError, match=rf"cell data 'fibre' is .*{message}.* in hex8 element 2 of region"):
        with_fields(with_fibres(limb, fibres), [region_of(FromMesh())])
    with pytest.raises(MeshError, match=r"'fibre' of hex8 has shape \(3, 3\); give \(4,\) or \(4, 3\)"):
        with_fields(with_fibres(limb, fibres[:3]), [region_of(FromMesh())])


def note(rotation):
    motion = np.eye(4)
    motion[:3, :3] = rotation
    return {"scan_to_mesh": motion.tolist()}


@pytest.mark.parametrize(
    ("meshes", "notes", "one_frame", "message"),
    [
        ("ab", [None, None], False, "each of which may have a frame of its own; .* or set one_frame = true"),
        ("ab", [note(np.eye(3)), None], False, "each of which may have a frame of its own"),
        ("ab", [note(np.eye(3)), note(Q)], False, "whose notes give different frames; write the directions"),
        ("ab", [note(np.eye(3)), note(Q)], True, "whose notes give different frames"),
        ("ab", [note(Q), note(Q)], False, None),
        ("ab", [None, {"scan_to_mesh": "no"}], True, None),
        ("aa", [None, None], False, None),
    ],
)
def test_one_direction_for_meshes_of_several_frames_is_refused(tmp_path, meshes, notes, one_frame, message):
    files = {f"p{k}": tmp_path / name for k, name in enumerate(meshes)}
    if message is None:
        check_frames(region_of(Fibred()), files, notes, one_frame=one_frame)
        return
    with pytest.raises(StudyError, match=f"directions of material 'fibred' .* have 2 meshes, {message}"):
        check_frames(region_of(Fibred()), files, notes, one_frame=one_frame)


def test_a_solver_that_gives_no_fields_is_refused_a_material_that_takes_them(make_study):
    study = make_study()
    job = Job(
        spot="p1",
        set_id=0,
        materials={"soft_tissue": FromMesh()},
        thetas={"soft_tissue": np.array([0.02, 0.05])},
        protocol=study.protocol,
    )
    with pytest.raises(
        StudyError, match="material 'fibred' takes cell data fibre and solver 'analytic' gives"
    ):
        check_jobs(study, [job], {"p1": block("hex8", **SMALL)})


def test_a_study_says_that_its_meshes_share_a_frame(make_study, tissue, tmp_path):
    class Meshed(tissue.Analytic):
        needs_limb = True

    class Blocks(LimbSource):
        name, summary = "blocks", "blocks"

        def load(self, path, spot):
            return replace(block("hex8", **SMALL), spot=spot)

    study = make_study(solver=Meshed(), limb_source=Blocks(), protocol=None)
    spots = tuple(
        replace(each, mesh=tmp_path / f"{each.spot.name}.vtu", spot=Spot(name=each.spot.name))
        for each in study.spots[:2]
    )
    study = replace(study, spots=spots, space=replace(study.space, regions=(region_of(Fibred()),)))
    with pytest.raises(StudyError, match="set one_frame = true under"):
        load_limbs(study)
    assert len(load_limbs(replace(study, one_frame=True))) == 2
    assert len(load_limbs(replace(study, spots=spots[:1]))) == 1


def test_febio_refuses_directions_where_its_deck_is_turned_against_the_mesh(make_study):
    limb = turned(block("hex8", **SMALL), Rotation.from_euler("x", 20.0, degrees=True).as_matrix())
    job = Job(
        spot="p1",
        set_id=0,
        materials={"soft_tissue": Fibred()},
        thetas=THETA,
        protocol=make_study().protocol,
    )
    with pytest.raises(SolverError, match="has directions, and FEBio's deck is in the frame of the spot"):
        FebioSolver(FebioSettings()).check(job, limb)
