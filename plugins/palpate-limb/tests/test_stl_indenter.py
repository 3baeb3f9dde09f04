"""A tool from a file is the shape in the file, with round edges, or is refused by name."""

import pickle

import numpy as np
import pytest
import trimesh

from palpate.api import Indentation, Job, MeshError, Sphere
from palpate.mesh.specimens import block
from palpate.study.model import IndenterTable
from palpate.testing import IndenterContract
from palpate_indentation import Box, BoxSettings
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_limb import stl_indenter
from palpate_limb.stl_indenter import StlIndenter, StlSettings, rounded_solid
from palpate_materials.neo_hookean import NeoHookean
from palpate_report.figures.scene import scene

SIDES = (20.0, 12.0, 8.0)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tools")
    plate = trimesh.creation.box(SIDES)
    other = trimesh.creation.box((20.0, 12.0, 9.0))
    ball = trimesh.creation.icosphere(subdivisions=5, radius=7.5)
    opened = trimesh.Trimesh(plate.vertices, plate.faces[:-1])
    inverted = trimesh.Trimesh(plate.vertices, plate.faces[:, ::-1], process=False)
    mixed = trimesh.Trimesh(
        plate.vertices, np.vstack([plate.faces[:1, ::-1], plate.faces[1:]]), process=False
    )
    made = {"plate": plate, "other": other, "ball": ball}
    made |= {"opened": opened, "inverted": inverted, "mixed": mixed}
    for name, mesh in made.items():
        mesh.export(folder / f"{name}.stl")
    (folder / "noise.stl").write_bytes(b"solid nothing\nfacet of no meaning")
    return folder


def tool(folder, name, edge="1.5 mm", **more):
    return StlIndenter(StlSettings(file=folder / f"{name}.stl", edge=edge, **more))


@pytest.mark.slow
class TestPlate(IndenterContract):
    """A spline smears the jump of curvature at the ends of an edge: normals are 3 % off there."""

    tolerance = 0.03
    kinks = 0.1

    @pytest.fixture
    def indenter(self, files):
        return tool(files, "plate", turn="30 deg")


def near(shape, within):
    lower, upper = shape.bounds_mm
    points = np.random.default_rng(0).uniform(lower - 1.0, upper + 1.0, (20_000, 3))
    return points[np.abs(shape.distance(points)) < within]


@pytest.mark.slow
def test_a_sphere_of_triangles_is_a_sphere(files):
    sphere = Sphere(radius_mm=7.5)
    points = near(sphere, 0.5)
    found = tool(files, "ball", "2.5 mm")
    np.testing.assert_allclose(found.distance(points), sphere.distance(points), atol=0.004)
    for got, known, atol in zip(found.normals(points), sphere.normals(points), (0.01, 0.05), strict=True):
        np.testing.assert_allclose(got, known, atol=atol)


def test_a_plate_is_a_box_with_round_edges(files):
    length, width, height = (f"{side} mm" for side in SIDES)
    box = Box(BoxSettings(length=length, width=width, height=height, edge="1.5 mm"))
    points = near(box, 0.3)
    np.testing.assert_allclose(tool(files, "plate").distance(points), box.distance(points), atol=0.03)
    face = points[(np.abs(points[:, :2]) < [7.0, 3.0]).all(axis=1) & (points[:, 2] < 1.0)]
    assert len(face) > 20
    np.testing.assert_allclose(tool(files, "plate").distance(face), -face[:, 2], atol=1e-3)


def test_a_tool_is_read_once_however_it_is_turned(files, monkeypatch):
    read = []
    monkeypatch.setattr(
        stl_indenter, "rounded_solid", lambda *given: read.append(given) or rounded_solid(*given)
    )
    for turn in ("0 deg", "40 deg", "80 deg"):
        tool(files, "plate", "1.7 mm", turn=turn)
    assert len(read) == 1


def test_far_points_are_far(files):
    distance = tool(files, "plate").distance(np.array([[0.0, 0.0, -50.0], [60.0, 0.0, 4.0]]))
    np.testing.assert_allclose(distance, [50.0, 50.0], rtol=0.05)


@pytest.mark.parametrize(
    ("name", "edge", "message"),
    [
        ("opened", "1 mm", r"opened\.stl: not a closed surface \(1 holes, first near .*close it"),
        ("inverted", "1 mm", r"inverted\.stl: inside out"),
        ("mixed", "1 mm", r"mixed\.stl: .*turned to different sides near .*unify"),
        ("plate", "4.5 mm", r"plate\.stl: an edge rounded by 4.5 mm does not fit near .*give a smaller edge"),
        (
            "plate",
            "0.05 mm",
            r"plate\.stl: .* is too fine for a tool of 20 mm; give an edge of 0\.\d+ mm or more",
        ),
        ("noise", "1 mm", r"noise\.stl: "),
    ],
)
def test_a_file_of_no_use_is_refused_by_name(files, name, edge, message):
    with pytest.raises(MeshError, match=message):
        tool(files, name, edge)


@pytest.mark.slow
def test_the_key_has_the_content_and_not_the_folder(files, tmp_path):
    here, there = tool(files, "plate"), tmp_path / "plate.stl"
    there.write_bytes((files / "plate.stl").read_bytes())
    moved = tool(tmp_path, "plate")
    assert moved.fingerprint() == here.fingerprint()
    assert moved.settings.model_dump(mode="json") == here.settings.model_dump(mode="json")
    there.write_bytes((files / "other.stl").read_bytes())
    assert tool(tmp_path, "plate").fingerprint() != here.fingerprint()


@pytest.mark.slow
def test_a_sphere_from_a_file_presses_and_turns_like_the_sphere(files):
    limb = block("hex8", n_across=6, n_down=2, width_mm=24.0, height_mm=12.0)

    def curves(indenter):
        press = Indentation(indenter=indenter, path=[(0, 0), (2, 0), (2, 15)], friction=0.5)
        job = Job(
            spot="block",
            set_id=0,
            materials={"soft_tissue": NeoHookean()},
            thetas={"soft_tissue": np.array([0.1, 0.45])},
            protocol=press,
        )
        return JaxSolver(JaxSettings(depth_steps=4, rotation_step_deg=7.5)).simulate(job, limb).response

    known, found = curves(Sphere(radius_mm=7.5)), curves(tool(files, "ball", "2.5 mm"))
    for channel in ("force", "torque"):
        peak = np.abs(known[channel].ordinate).max()
        np.testing.assert_allclose(
            found[channel].ordinate, known[channel].ordinate, atol=0.005 * peak, err_msg=channel
        )


def test_a_pickle_has_no_grid(files):
    assert len(pickle.dumps(tool(files, "plate"))) < 2_000


def test_a_file_is_looked_for_next_to_the_study(files):
    given = IndenterTable(shape="stl", file="plate.stl", edge="1 mm").settings
    found = StlSettings.model_validate(given, context={"folder": files, "must_exist": True})
    assert found.file == files / "plate.stl"
    with pytest.raises(ValueError, match=r"'none\.stl': no such file \(looked for "):
        StlSettings.model_validate(given | {"file": "none.stl"}, context={"folder": files})
    copied = StlSettings.model_validate(
        given | {"file": "none.stl"}, context={"folder": files, "must_exist": False}
    )
    with pytest.raises(MeshError, match=r"none\.stl: the tool cannot be read"):
        StlIndenter(copied).distance(np.zeros((1, 3)))


def test_a_run_is_shown_where_the_file_of_its_tool_is_not(files):
    limb, paths = block("tet4", n_across=4, n_down=3), {"path": [(0, 0), (2, 0)], "friction": 0.3}
    there = tool(files, "plate")
    # The settings of a copy of a study are read without a look at its files.
    gone = StlIndenter(there.settings.model_copy(update={"file": files / "gone.stl"}))
    there, lost = (Indentation(indenter=each, **paths) for each in (there, gone))
    bare = scene(limb, None, 1000)
    assert scene(limb, lost, 1000) == bare
    assert len(scene(limb, there, 1000)) == len(bare) + 2


@pytest.mark.slow
def test_a_file_that_is_edited_during_a_run_gives_no_result_under_the_old_key(files, tmp_path):
    (tmp_path / "plate.stl").write_bytes((files / "plate.stl").read_bytes())
    parent = tool(tmp_path, "plate")
    before = parent.fingerprint()
    sent = pickle.dumps((type(parent), parent.settings))
    (tmp_path / "plate.stl").write_bytes((files / "other.stl").read_bytes())
    assert parent.fingerprint() == before
    stl_indenter._solid_of.cache_clear()  # a worker has its own
    kind, settings = pickle.loads(sent)
    worker = kind(settings)
    assert worker.fingerprint() == before
    with pytest.raises(
        MeshError, match=r"plate\.stl: the tool's file has changed since this command read it"
    ):
        worker.distance(np.zeros((1, 3)))
    assert tool(tmp_path, "plate").fingerprint() != before
