"""`palpate limb inspect` proposes tables that read the file, draws it, and `init --mesh` writes the same."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from matplotlib.image import imread

from palpate.api.cli import Session, look_into_mesh
from palpate.cli.app import main
from palpate.domain import Spot
from palpate.errors import MeshError
from palpate.mesh.specimens import block
from palpate.mesh.topology import outer_faces
from palpate_limb.limb_files import write_limb

ROOT = Path(__file__).parents[2]
MESHES = ROOT / "palpate-indentation" / "tests" / "data" / "meshes_of_others"
DECKS = ROOT / "palpate-febio" / "tests" / "data" / "decks_of_others"
FILES = [
    DECKS / "deck40_only_surfaces.feb",
    DECKS / "deck25_surface_pair.feb",
    MESHES / "abaqus_lower_case_type.inp",
    MESHES / "abaqus_reference_point.inp",
    MESHES / "vtk_legacy_binary.vtk",
    MESHES / "pyvista_bool_marks.vtu",
]


@pytest.fixture(scope="module")
def session() -> Session:
    return Session()


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_the_proposed_tables_read_the_whole_block(session: Session, file: Path) -> None:
    found = look_into_mesh(file, session)
    tables = tomllib.loads(found.study_text)
    source = session.plugins.limb_sources[tables["limb"]["source"]]
    limb = source(source.Settings.model_validate(tables["limb"].get("settings", {}))).load(
        file, Spot(name=tables["spot"][0]["name"])
    )
    assert len(limb.mesh.node_sets["fixed"]) == 45
    assert len(limb.mesh.node_sets["contact"]) == 25
    assert found.record["surface"] == pytest.approx({"fixed": 0.5, "contact": 0.25, "free": 0.25})
    assert "position" not in tables["spot"][0]
    assert "these tables do not read it" not in " ".join(found.findings)


def test_the_supports_of_a_deck_are_shown(session: Session) -> None:
    tables = {t.title: t.rows for t in look_into_mesh(FILES[0], session).tables}
    assert tables["Supports"] == (("'a'", "x y z", "25"), ("'b'", "x y z", "15"), ("'c'", "x y z", "15"))


def test_a_set_that_no_condition_names_is_fixed_with_a_remark(session: Session, tmp_path: Path) -> None:
    text = (DECKS / "deck25_surface_pair.feb").read_text()
    start, end = text.index("<Boundary>"), text.index("</Boundary>") + len("</Boundary>")
    (tmp_path / "m.feb").write_text(text[:start] + text[end:])
    found = look_into_mesh(tmp_path / "m.feb", session)
    assert any("no condition of the deck holds nodes" in each for each in found.findings)
    assert tomllib.loads(found.study_text)["limb"]["settings"]["fixed"] == ["cuts", "bone"]


@pytest.mark.parametrize(
    ("held", "is_named"), [(("Fixed_X", "Fixed_Z"), True), (("Knochen", "Schnitt"), False)]
)
def test_supports_that_differ_by_their_axis_are_named(
    session: Session, tmp_path: Path, held: tuple[str, str], is_named: bool
) -> None:
    made = block("hex8", width_mm=40.0, height_mm=20.0, n_across=4, n_down=2).mesh
    x, _, z = made.points_mm.T
    marks = dict(zip((*held, "Haut"), (z == -20.0, np.abs(x) == 20.0, z == 0.0), strict=True))
    data = {name: of.astype(np.int32) for name, of in marks.items()}
    meshio.Mesh(made.points_mm, [("hexahedron", made.cells["hex8"])], data).write(tmp_path / "m.vtu")
    found = look_into_mesh(tmp_path / "m.vtu", session)
    sets = tomllib.loads(found.study_text)["limb"]["settings"]["node_sets"]
    assert sets == {"contact": "Haut", "fixed": list(held)}
    assert any("if each of them holds one axis" in each for each in found.findings) == is_named


def test_a_limb_in_metres_elsewhere_has_unit_and_spot(session: Session, tmp_path: Path) -> None:
    limb = block("hex8", n_across=4, n_down=2)
    points = limb.mesh.points_mm @ np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]) + [300.0, 0.0, 0.0]
    moved = type(limb)(
        spot=limb.spot,
        mesh=type(limb.mesh)(
            points_mm=points / 1000.0,
            cells=limb.mesh.cells,
            cell_regions=limb.mesh.cell_regions,
            regions=limb.mesh.regions,
            node_sets=limb.mesh.node_sets,
        ),
    )
    write_limb(tmp_path / "m.vtu", moved)
    found = look_into_mesh(tmp_path / "m.vtu", session)
    tables = tomllib.loads(found.study_text)
    assert tables["limb"]["settings"]["unit"] == "m"
    assert any("its unit is taken to be m" in finding for finding in found.findings)
    position = [float(x.removesuffix(" mm")) for x in tables["spot"][0]["position"]]
    np.testing.assert_allclose(position, [300.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(tables["spot"][0]["normal"], [-1.0, 0.0, 0.0], atol=1e-6)


def test_the_spot_of_a_whole_limb_is_where_its_mesh_is_finest(session: Session, tmp_path: Path) -> None:
    """A block, all of whose free faces are skin, crowded towards a spot that is not the origin."""
    limb = block("tet4", n_across=6, n_down=3, grading=2.0)
    around = np.setdiff1d(
        np.unique(outer_faces("tet4", limb.mesh.cells["tet4"])), limb.mesh.node_sets["fixed"]
    )
    sets = {**limb.mesh.node_sets, "contact": around}
    mesh = replace(limb.mesh, points_mm=limb.mesh.points_mm + np.array([0.0, 90.0, 0.0]), node_sets=sets)
    write_limb(tmp_path / "m.vtu", replace(limb, mesh=mesh))
    found = look_into_mesh(tmp_path / "m.vtu", session)
    (spot,) = tomllib.loads(found.study_text)["spot"]
    position = [float(x.removesuffix(" mm")) for x in spot["position"]]
    np.testing.assert_allclose(position, [0.0, 90.0, 0.0], atol=1.0)
    np.testing.assert_allclose(spot["normal"], [0.0, 0.0, 1.0], atol=1e-6)
    assert any("correct position and normal if the tool pressed elsewhere" in each for each in found.findings)
    assert "these tables do not read it" not in " ".join(found.findings)


def test_a_bone_is_rigid_and_each_layer_has_a_modulus(session: Session, tmp_path: Path) -> None:
    limb = block("hex8", n_across=4, n_down=3, layers_mm={"skin": 6.0, "fat": 6.0})
    press = tmp_path / "press.csv"
    write_limb(tmp_path / "m.vtu", replace(limb, mesh=replace(limb.mesh, regions=("skin", "fat", "Tibia"))))
    read = meshio.read(tmp_path / "m.vtu")
    labels = read.cell_data.pop("region")[0]
    groups = {name: [np.flatnonzero(labels == k)] for k, name in enumerate(("skin", "fat", "Tibia"))}
    sets = {name: np.flatnonzero(read.point_data.pop(name)) for name in ("fixed", "contact")}
    read.cell_sets, read.point_sets = groups, sets
    path = tmp_path / "m.inp"
    sets.pop("fixed")  # the bone holds the limb
    read.write(path)
    press.write_text("depth_mm,force_N\n0,0\n0.5,0.1\n1,0.2\n1.5,0.31\n2,0.43\n")
    assert main(["init", str(tmp_path / "own"), "--measured", str(press), "--mesh", str(path)]) == 0
    raw = tomllib.loads((tmp_path / "own" / "study.toml").read_text())
    assert raw["limb"]["rigid"] == ["Tibia"]
    assert raw["limb"]["settings"]["node_sets"] == {"contact": "contact", "fixed": "Tibia"}
    assert set(raw["region"]) == {"skin", "fat"}
    searched = {
        name: [k for k, v in of["parameters"].items() if isinstance(v, dict)]
        for name, of in raw["region"].items()
    }
    assert searched == {"skin": ["E"], "fat": ["c1"]}
    assert main(["check", str(tmp_path / "own")]) == 0


def test_what_is_a_guess_is_asked_in_the_study_too(
    session: Session, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The mesh of the second spot has a region that may be bone, and its origin is not on the skin."""
    limb = block("hex8", n_across=4, n_down=3, layers_mm={"fat": 6.0, "stump_bone": 6.0})
    elsewhere = replace(limb.mesh, points_mm=limb.mesh.points_mm + np.array([0.0, 90.0, 0.0]))
    own = [str(tmp_path / "own")]
    for name, mesh in (("p1", block("hex8", n_across=4, n_down=3).mesh), ("p2", elsewhere)):
        write_limb(tmp_path / f"{name}.vtu", replace(limb, mesh=mesh))
        read = meshio.read(tmp_path / f"{name}.vtu")
        labels = read.cell_data.pop("region")[0]
        read.cell_sets = {region: [np.flatnonzero(labels == k)] for k, region in enumerate(mesh.regions)}
        read.point_sets = {name: np.flatnonzero(read.point_data.pop(name)) for name in ("fixed", "contact")}
        read.write(tmp_path / f"{name}.inp")
        (tmp_path / f"{name}.csv").write_text("depth_mm,force_N\n0,0\n0.5,0.1\n1,0.2\n1.5,0.31\n2,0.43\n")
        own += ["--measured", str(tmp_path / f"{name}.csv"), "--mesh", str(tmp_path / f"{name}.inp")]
    assert main(["init", *own]) == 0
    asked = capsys.readouterr().err.replace("\n", " ")
    text = (tmp_path / "own" / "study.toml").read_text()
    found = look_into_mesh(tmp_path / "p2.inp", session).findings
    for question in ("is the spot right?", "is region 'stump_bone' bone?"):
        assert all(f"answer first: {question}" in where for where in (asked, text, " ".join(found)))
    raw = tomllib.loads(text)
    assert [spot.get("position") for spot in raw["spot"]] == [None, ["0 mm", "90 mm", "0 mm"]]
    assert "rigid" not in raw["limb"]
    assert {*raw["region"]} == {"fat", "stump_bone", "soft_tissue"}


def test_what_is_missing_is_a_finding(session: Session) -> None:
    found = look_into_mesh(MESHES / "plane_misses_nodes_of_a_cut.vtu", session)
    (asked,) = [
        each for each in found.findings if each.startswith("no set of nodes has the name of a support")
    ]
    assert 'fixed = { normal = [0, 0, 1], at = "… mm" }' in asked
    assert any(finding.startswith("these tables do not read it yet") for finding in found.findings)
    assert found.limb is None


def test_the_command_prints_tables_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = tmp_path / "limb.feb"
    mesh.write_bytes(FILES[0].read_bytes())
    assert main(["limb", "inspect", str(mesh)]) == 0
    printed = capsys.readouterr().out
    assert 'source = "febio_deck"' in printed
    assert "fixed, in contact, free" in printed
    pixels = np.round(255 * imread(tmp_path / "limb.png")[..., :3]).astype(int).reshape(-1, 3)
    colours = set(map(tuple, pixels.tolist()))
    assert {(0xB5, 0x44, 0x3C), (0x3B, 0x6E, 0xA5), (0xC9, 0xC9, 0xC4)} <= colours
    assert main(["limb", "inspect", str(mesh), "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["source"] == "febio_deck"
    assert record["picture"] == str(tmp_path / "limb.png")


def test_a_picture_of_the_user_is_never_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh, photograph = tmp_path / "limb.feb", tmp_path / "limb.png"
    mesh.write_bytes(FILES[0].read_bytes())
    photograph.write_bytes(b"a photograph")
    assert main(["limb", "inspect", str(mesh)]) == 0
    assert photograph.read_bytes() == b"a photograph"
    assert "a file of yours is there; rename it" in capsys.readouterr().err.replace("\n", " ")


@pytest.mark.parametrize(
    ("name", "message"), [("m.stl", "a surface and no mesh"), ("m.docx", "no mesh or deck")]
)
def test_other_files_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, message: str
) -> None:
    (tmp_path / name).write_text("solid\n")
    assert main(["limb", "inspect", str(tmp_path / name)]) == 2
    assert message in capsys.readouterr().err.replace("\n", " ")


@pytest.mark.parametrize("file", [FILES[0], FILES[2]], ids=lambda file: file.stem)
def test_init_writes_the_source_that_fits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], file: Path
) -> None:
    (tmp_path / "press.csv").write_text("depth_mm,force_N\n0,0\n0.5,0.1\n1,0.2\n1.5,0.31\n2,0.43\n")
    own = ["--measured", str(tmp_path / "press.csv"), "--mesh", str(file)]
    assert main(["init", str(tmp_path / "own"), *own]) == 0
    raw = tomllib.loads((tmp_path / "own" / "study.toml").read_text())
    assert raw["limb"]["source"] == ("febio_deck" if file.suffix == ".feb" else "meshio")
    assert set(raw["region"]) == ({"tissue"} if file.suffix == ".feb" else {"skin", "fat"})


def test_a_mesh_that_cannot_be_read_leaves_the_ready_table_with_a_note(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "press.csv").write_text("depth_mm,force_N\n0,0\n1,0.2\n2,0.43\n")
    (tmp_path / "m.feb").write_text("<nothing/>")
    own = ["--measured", str(tmp_path / "press.csv"), "--mesh", str(tmp_path / "m.feb")]
    assert main(["init", str(tmp_path / "own"), *own]) == 0
    assert "[limb] is from the ready study" in capsys.readouterr().err.replace("\n", " ")


def test_no_source_reads_the_file(session: Session, tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"give one of .*\.feb.*\.inp"):
        look_into_mesh(tmp_path / "m.stp", session)
