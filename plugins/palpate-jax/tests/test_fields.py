"""Fields of equilibrium states, as files that other programs read."""

import xml.etree.ElementTree as ET
from types import SimpleNamespace

import meshio
import numpy as np
import pytest

from palpate.domain import Indentation, Job, Limb, Mesh, Spot, Status
from palpate.domain.indenter import Sphere
from palpate.errors import StudyError
from palpate.mechanics import stress
from palpate.mesh.specimens import block
from palpate_jax.body import Body, blocks
from palpate_jax.contact_surface import contact_surfaces
from palpate_jax.fields import cell_fields
from palpate_jax.skin import nodal_tractions
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.neo_hookean import NeoHookean
from palpate_materials.uncoupled import Yeoh

YEOH = np.array([0.0141, -0.0011, 1.05e-4, 0.8])
TURN = np.linalg.qr(np.random.default_rng(8).standard_normal((3, 3)))[0]
SHIFT = np.array([5.0, -7.0, 3.0])


def turned(limb):
    """The same limb elsewhere in space, so that the spot's frame is not the mesh's."""
    turn = TURN * np.linalg.det(TURN)
    mesh = limb.mesh
    moved = Mesh(
        points_mm=mesh.points_mm @ turn.T + SHIFT,
        cells=mesh.cells,
        cell_regions=mesh.cell_regions,
        regions=mesh.regions,
        node_sets=mesh.node_sets,
    )
    return Limb(spot=Spot(name="../p 1", position_mm=SHIFT, normal=turn[:, 2]), mesh=moved), turn


def simulated(limb, folder, set_id=12, **settings):
    job = Job(
        spot=limb.spot.name,
        set_id=set_id,
        materials={"soft_tissue": Yeoh()},
        thetas={"soft_tissue": YEOH},
        protocol=Indentation(
            indenter=Sphere(radius_mm=7.5), path=np.array([(0, 0), (2, 0), (2, -10)]), friction=0.5
        ),
    )
    solver = JaxSolver(
        JaxSettings(depth_steps=2, rotation_step_deg=10.0, fields_folder=str(folder), **settings)
    )
    solver.check(job, limb)
    simulation = solver.simulate(job, limb)
    assert simulation.status is Status.OK, simulation.message
    return simulation


SMALL = {"n_across": 4, "n_down": 2, "width_mm": 24.0, "height_mm": 12.0, "grading": 1.4}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fields")
    limb, turn = turned(block("hex8", **(SMALL | {"n_across": 8, "n_down": 4})))
    simulation = simulated(limb, folder, fields="all")
    return SimpleNamespace(
        limb=limb, turn=turn, simulation=simulation, folder=folder / "%2E%2E%2Fp 1" / "set-12"
    )


@pytest.mark.slow
def test_every_load_step_has_a_file_and_the_pvd_lists_them(written):
    listed = [e.attrib["file"] for e in ET.parse(written.folder / "path.pvd").iter("DataSet")]
    assert listed == ["000.vtu", "001.vtu", "002.vtu"]
    assert sorted(p.name for p in written.folder.iterdir()) == [*listed, "path.pvd"]
    for name in listed:
        read = meshio.read(written.folder / name)
        np.testing.assert_array_equal(read.points, written.limb.mesh.points_mm)
        assert set(read.point_data) == {"displacement_mm", "contact_pressure_MPa", "contact_shear_MPa"}
        assert set(read.cell_data) == {"cauchy_stress_MPa", "principal_stretches", "J", "region"}


def test_fields_agree_with_the_curves(written):
    """Tractions over the deformed skin give the force; the base carries it as stress."""
    read = meshio.read(written.folder / "001.vtu")
    force = written.simulation.response["force"].ordinate[-1]
    displacement = read.point_data["displacement_mm"] @ written.turn
    assert displacement[:, 2].min() == pytest.approx(-2.0, abs=0.2)
    pressure = read.point_data["contact_pressure_MPa"]
    (skin,) = contact_surfaces(written.limb.mesh)
    corners = (written.limb.mesh.points_mm + read.point_data["displacement_mm"])[skin.nodes]
    normals = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]) @ written.turn
    assert (pressure[skin.nodes].mean(axis=1) * normals[:, 2]).sum() == pytest.approx(force, rel=0.25)
    stress_ = written.turn.T @ read.cell_data["cauchy_stress_MPa"][0].reshape(-1, 3, 3) @ written.turn
    rest = written.limb.mesh.points_mm @ written.turn
    cells = rest[written.limb.mesh.cells["hex8"]]
    at_base = cells[:, :, 2].min(axis=1) < rest[:, 2].min() + 1e-9
    across = np.ptp(cells[at_base], axis=1)
    carried = -(stress_[at_base][:, 2, 2] * across[:, 0] * across[:, 1]).sum()
    assert carried == pytest.approx(force, rel=0.1)


def test_shear_is_tangential_below_its_limit_and_there_only_under_the_sphere(written):
    read = meshio.read(written.folder / "002.vtu")
    pressure, shear = (read.point_data[f"contact_{n}_MPa"] for n in ("pressure", "shear"))
    assert (pressure >= 0.0).all()
    assert 0.0 < (pressure > 0.0).mean() < 0.2
    size = np.linalg.norm(shear, axis=1)
    assert size.max() > 0.0
    assert (size <= 0.5 * pressure * (1 + 1e-9)).all()
    moment = written.simulation.response["torque"].ordinate[-1]
    arms = (written.limb.mesh.points_mm + read.point_data["displacement_mm"] - SHIFT) @ written.turn
    local = shear @ written.turn
    assert np.sign((arms[:, 0] * local[:, 1] - arms[:, 1] * local[:, 0]).sum()) == np.sign(moment)


@pytest.mark.parametrize(("fields", "names"), [("end", ["000.vtu", "path.pvd"]), ("none", None)])
def test_fields_are_written_on_request(fields, names, tmp_path):
    limb = block("tet10", **(SMALL | {"n_across": 2, "n_down": 1}))
    simulated(limb, tmp_path / "out", fields=fields)
    folder = tmp_path / "out" / "block" / "set-12"
    assert (sorted(p.name for p in folder.iterdir()) if folder.exists() else None) == names
    if names:
        assert 'name="depth 2 mm, rotation -10 degrees"' in (folder / "path.pvd").read_text()
        assert meshio.read(folder / "000.vtu").point_data["contact_pressure_MPa"].max() > 0.0


def test_a_set_outside_the_design_writes_none(tmp_path):
    simulated(block("tet10", **(SMALL | {"n_across": 2, "n_down": 1})), tmp_path, set_id=-1, fields="end")
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_folder_that_cannot_be_made_is_refused_before_the_first_step(tmp_path):
    (tmp_path / "taken").touch()
    with pytest.raises(StudyError, match=r"taken.*fields cannot be written there"):
        simulated(block("hex8", **SMALL), tmp_path / "taken", fields="end")


# -------------------------------------------------------------------- the numbers

F = np.array([[1.1, 0.2, 0.0], [0.05, 0.9, 0.1], [0.0, -0.1, 1.05]])


@pytest.mark.slow
@pytest.mark.parametrize("mean", [True, False])
@pytest.mark.parametrize("kind", ["hex8", "tet10", "tet4"])
def test_a_constant_deformation_has_the_material_s_stress(kind, mean):
    mesh = block(kind, **SMALL).mesh
    (part,) = blocks(mesh, mean)
    material, theta = NeoHookean(), np.array([0.07, 0.44])
    cauchy, stretches, J = cell_fields(material, theta, part, mesh.points_mm @ (F - np.eye(3)).T)
    expected = np.asarray(stress(material, F[None], theta))[0] @ F.T / np.linalg.det(F)
    assert len(cauchy) == len(mesh.cells[kind])
    np.testing.assert_allclose(cauchy, np.broadcast_to(expected, cauchy.shape), atol=1e-12)
    np.testing.assert_allclose(
        stretches, np.broadcast_to(np.linalg.svd(F, compute_uv=False), stretches.shape), rtol=1e-12
    )
    np.testing.assert_allclose(J, np.linalg.det(F), rtol=1e-12)


@pytest.mark.parametrize("mean", [True, False])
def test_one_point_elements_and_patches_carry_the_solver_s_forces_as_stress(mean):
    """Σ V J σ F^−T ∇N over the tetrahedra is the internal force, with each cell's own stress."""
    mesh = block("tet4", **SMALL).mesh
    body, material = Body(mesh, {"soft_tissue": Yeoh()}, mean), Yeoh()
    u = 0.1 * np.random.default_rng(9).standard_normal((mesh.n_nodes, 3))
    (part,), (plain,) = body.blocks, blocks(mesh, False)
    cauchy, _, J = cell_fields(material, YEOH, part, u)
    gradients, volumes = plain.gradients[:, 0], plain.volumes[:, 0]
    deformation = np.eye(3) + np.einsum("eai,eaj->eij", u[plain.nodes], gradients)
    piola = J[:, None, None] * cauchy @ np.linalg.inv(deformation).swapaxes(1, 2)
    forces = np.zeros_like(u)
    np.add.at(forces, plain.nodes, np.einsum("e,eij,eaj->eai", volumes, piola, gradients))
    expected, _ = body.force(u, {"soft_tissue": YEOH})
    np.testing.assert_allclose(forces, expected, atol=1e-12 * np.abs(expected).max())


def test_a_nodal_mean_of_a_uniform_traction_is_that_traction():
    """On tet10, whose corner functions are negative across the face, as on the others."""
    for kind in ("hex8", "tet10", "tet4"):
        mesh = block(kind, **SMALL).mesh
        from palpate_jax.contact import Contact

        contact = Contact(mesh)
        n = len(contact.positions(np.zeros_like(mesh.points_mm)))
        load = SimpleNamespace(
            pose=SimpleNamespace(into=lambda x: x, rotation=np.eye(3)),
            memory=SimpleNamespace(anchors=np.zeros((n, 3)), anchored=np.zeros(n, dtype=bool)),
            law=SimpleNamespace(
                shape=SimpleNamespace(
                    distance=lambda x: np.full(len(x), -0.1),
                    normals=lambda x: (np.tile([0.0, 0.0, 1.0], (len(x), 1)), np.zeros((len(x), 3, 3))),
                ),
                penalty=3.0,
                friction=0.0,
            ),
        )
        state = SimpleNamespace(displacements=mesh.points_mm * [1.0, 0.0, 0.0], load=load)
        found = nodal_tractions(contact, mesh.points_mm, state)
        pressure, shear = found.pressures_MPa, found.shears_MPa
        on_skin = mesh.points_mm[:, 2] == 0.0
        # Stretched to twice its area, the skin carries half the nominal pressure.
        np.testing.assert_allclose(pressure[on_skin], 0.15, rtol=1e-12)
        assert not pressure[~on_skin].any()
        assert not shear.any()
