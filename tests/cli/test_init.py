"""Ready studies, and studies of one's own presses: `palpate init`."""

import re
import tomllib
from pathlib import Path

import meshio
import numpy as np
import pytest

from palpate.cli.experiment import look_into
from palpate.cli.init import own_study_text
from palpate.cli.limb import look_into_mesh
from palpate.cli.session import Session
from palpate.errors import PluginError, StudyError
from palpate.experiment.measured import load_measured, read_first
from palpate.limb.loading import load_limbs, press_warnings
from palpate.plugins.catalogue import Plugins
from palpate.study.checks import unedited_warnings
from palpate.study.reading import read_study

from .conftest import Call


def test_init_lists_the_ready_studies(call: Call) -> None:
    outcome = call("init")
    assert "A spring that is pulled" in outcome.out
    names = [entry["name"] for entry in call("init", "--json").json]
    assert "toy" in names


def test_init_copies_a_study_that_checks(call: Call) -> None:
    outcome = call("init", "--study", "toy", "mine")
    assert outcome.code == 0
    assert "check mine" in outcome.err
    assert Path("mine/study.toml").is_file()
    assert not Path("mine/__pycache__").exists()
    assert call("check", "mine").code == 0


def test_copies_of_a_ready_study_have_a_name_and_a_run_of_their_own(call: Call, tmp_path: Path) -> None:
    for folder in ("arm", "second arm", "runs/third"):
        assert call("init", "--study", "toy", folder).code == 0
        assert call("experiment", folder).code == 0
    runs = {path.parent.name for path in (tmp_path / "runs").glob("*/manifest.json")}
    assert runs == {"arm", "second-arm", "third-run"}


@pytest.mark.parametrize("name", sorted(Plugins.load().studies))
def test_every_ready_study_takes_the_name_of_its_folder(call: Call, name: str) -> None:
    ready = Path(Plugins.load().studies[name].directory) / "study.toml"
    assert call("init", "--study", name, "mine", plugin=None).code == 0
    lines = Path("mine/study.toml").read_text(encoding="utf-8").splitlines()
    before = ready.read_text(encoding="utf-8").splitlines()
    changed = [(old, new) for old, new in zip(before, lines, strict=True) if old != new]
    assert changed == [(f'name = "{name}"', 'name = "mine"')]


def test_a_study_without_its_files_names_what_makes_them(call: Call) -> None:
    copied = call("init", "--study", "residual-limb", "real", plugin=None)
    assert "next: palpate limb real/skin.ply --options real/limb.toml" in copied.err
    refused = call("check", "real", plugin=None)
    assert refused.code == 2
    assert "meshes/fibula_head.vtu); paths are relative to study.toml" in refused.err
    assert "`palpate limb SCAN` makes" in refused.err
    assert "`palpate synthesise real` simulates [truth] into it" in refused.err


def test_init_overwrites_nothing(call: Call) -> None:
    Path("mine").mkdir()
    Path("mine/notes.txt").write_text("mine")
    Path("file").write_text("mine")
    for folder, reason in (("mine", "is not empty"), ("file", "is a file")):
        outcome = call("init", "--study", "toy", folder)
        assert outcome.code == 2
        assert reason in outcome.err
    assert [path.name for path in Path("mine").iterdir()] == ["notes.txt"]


def test_init_writes_a_study_of_own_presses(call: Call) -> None:
    call("init", "try", plugin=None)
    own = ("--measured", "try/measured/p1.csv", "--mesh", "try/meshes/p1.vtu")
    outcome = call("init", "arm", *own, plugin=None)
    assert "check arm" in outcome.err
    study, ready = read_study("arm"), read_study("try")
    assert (study.name, study.data, study.spot_names) == ("arm", "measured", ("p1",))
    assert study.protocol.columns["depth_mm"].tolist() == ready.protocol.columns["depth_mm"].tolist()
    assert study.protocol.columns["rotation_deg"].tolist() == ready.protocol.columns["rotation_deg"].tolist()
    (modulus,) = study.space.parameters
    assert (modulus.name, set(study.space.ties)) == (
        "soft_tissue.c1",
        {f"soft_tissue.{name}" for name in ("c2", "c3", "kappa")},
    )
    assert modulus.lower < ready.truth["soft_tissue.c1"] < modulus.upper
    text = Path("arm/study.toml").read_text(encoding="utf-8")
    assert re.findall(r"^(\w+) = .*# CHANGE THIS", text, flags=re.MULTILINE) == [
        *("indenter", "material", "c2", "c3", "kappa", "friction"),
    ]
    assert not study.truth
    *_, friction = study.parametrisation.parameters(study.space, study.spot_names)
    assert (friction.name, friction.prior.value, friction.prior.sd) == ("friction", 0.7, 0.3)
    (measured,) = load_measured(study, Plugins.load().channels).values()
    (expected,) = load_measured(ready, Plugins.load().channels).values()
    assert measured["force"].ordinate.tolist() == expected["force"].ordinate.tolist()
    for arguments, reason in (
        (("arm", *own), "is not empty"),
        (("leg", *own, "--measured", "try/measured/p1.csv"), "give one of each"),
        (("leg", *own[:2]), "p1.csv: a press needs the mesh of its spot; add --mesh MESH"),
        (("leg", *own[:-1], "try/p1.vtu"), "no such file"),
        (("leg", *own, "--wrench", "try/ft.csv"), "ft.csv"),
        (("leg", "--wrench", "try/ft.csv"), "give one of each"),
    ):
        refused = call("init", *arguments, plugin=None)
        assert (refused.code, reason in refused.err) == (2, True)
    assert not Path("leg").exists()


def test_lines_of_a_study_that_are_not_edited_are_a_warning(call: Call) -> None:
    call("init", "try", plugin=None)
    call("init", "arm", "--measured", "try/measured/p1.csv", "--mesh", "try/meshes/p1.vtu", plugin=None)
    file = Path("arm/study.toml")
    text = file.read_text(encoding="utf-8").replace("[limb]", "# answer first: is 7 skin?\n[limb]")
    file.write_text(text, encoding="utf-8")
    (found,) = unedited_warnings(read_study("arm"))
    lines = text.splitlines()
    for key in ("indenter",):
        number = 1 + next(i for i, line in enumerate(lines) if line.startswith(f"{key} = "))
        assert f"line {number} protocol.{key}" in found
    assert found.startswith(f"{read_study('arm').file.name}: not edited yet: ")
    assert f"line {1 + lines.index('# answer first: is 7 skin?')} answer first: is 7 skin?" in found
    assert "soft_tissue.parameters.c2" in found
    assert "protocol.depth" not in found
    assert f"warning: {found}" in call("check", "arm", plugin=None).err.replace("\n", " ")
    file.write_text(re.sub("#.*", "", text), encoding="utf-8")
    assert list(unedited_warnings(read_study("arm"))) == []


def machine_log(*, turns: bool, deep_mm: float = 6.0) -> str:
    """Log of a testing machine: a press on a half-space of 15 kPa, and a twist to 20° both ways."""
    noise, time = np.random.default_rng(3), np.arange(0.0, 8.0, 0.01)
    travel = np.interp(
        time, [0.0, 0.5, 2.5, 7.0, 7.5, 8.0], [0.0, 0.0, 1.0 + deep_mm, 1.0 + deep_mm, 0.0, 0.0]
    )
    angle = np.interp(time, [0.0, 2.5, 3.5, 5.5, 6.5, 8.0], [0.0, 0.0, -20.0, 20.0, 0.0, 0.0])
    depth = np.maximum(travel - 1.0, 0.0)
    columns = {
        "time [s]": time,
        "position [mm]": travel + noise.normal(0.0, 0.003, time.size),
        "angle [deg]": angle + noise.normal(0.0, 0.01, time.size),
        "Fz [N]": 0.248 * depth**1.5 + noise.normal(0.0, 0.005, time.size),
        "Tz [Nmm]": 0.0441 * depth**1.5 * angle + noise.normal(0.0, 0.1, time.size),
    }
    if not turns:
        del columns["angle [deg]"]
    rows = (",".join(f"{value:.4f}" for value in row) for row in zip(*columns.values(), strict=True))
    return "\n".join([",".join(columns), *rows]) + "\n"


@pytest.mark.parametrize("turns", [True, False])
def test_init_writes_the_motion_of_a_log_without_its_noise(call: Call, turns: bool) -> None:
    call("init", "try", plugin=None)
    Path("log.csv").write_text(machine_log(turns=turns), encoding="utf-8")
    assert call("init", "own", "--measured", "log.csv", "--mesh", "try/meshes/p1.vtu", plugin=None).code == 0
    text, found = (
        Path("own/study.toml").read_text(encoding="utf-8"),
        look_into(Path("log.csv"), None, Session(), None),
    )
    assert 'depth = "6 mm"' in text
    assert ('twist = ["-20 deg", "20 deg", "0 deg"]' in text) == turns
    # A friction that no curve shows stays fixed, and one that is searched says so.
    assert ("[fit.searched]\n" in text) == turns
    friction = (
        "of a sweep alone: the fit searches it" if turns else "CHANGE THIS: copied from forearm-demo; with"
    )
    assert re.search(rf"^friction = 1.0   # {friction}", text, flags=re.MULTILINE)
    unused = "Tz [Nmm] is not used: no column of rotation; add one in deg, or no twist is compared"
    assert (unused in found.findings) == (not turns)
    assert {row[-1] for row in found.tables[1].rows if row[1] == "Tz [Nmm]"} == {"" if turns else "not used"}


def test_init_writes_the_depth_of_each_spot(call: Call) -> None:
    """A twist at another depth has another torque; depths that differ by the noise of a log are one."""
    call("init", "try", plugin=None)
    files: list[str] = []
    for name, deep_mm in (("a", 6.0), ("b", 6.4), ("c", 6.01)):
        Path(f"{name}.csv").write_text(machine_log(turns=True, deep_mm=deep_mm), encoding="utf-8")
        files += ["--measured", f"{name}.csv", "--mesh", "try/meshes/p1.vtu"]
    assert call("init", "own", *files, plugin=None).code == 0
    study = read_study("own")
    deepest = [study.protocol_at(spot).path[:, 0].max() for spot in study.spot_names]
    assert deepest == pytest.approx([6.0, 6.4, 6.0])
    assert call("check", "own", plugin=None).code == 0


def test_init_makes_a_spot_of_each_specimen(call: Call) -> None:
    strain = np.linspace(0.0, 1.5, 31)
    for k, softer in enumerate((1.0, 0.9, 1.1)):
        rows = (f"{x:.4f},{0.2 * softer * (1.0 + x - (1.0 + x) ** -2):.5f}" for x in strain)
        Path(f"s{k}.csv").write_text("\n".join(["strain,stress (MPa)", *rows]) + "\n", encoding="utf-8")
    files = [word for k in range(3) for word in ("--measured", f"s{k}.csv")]
    assert call("init", "rubber", *files, plugin=None).code == 0
    study = read_study("rubber")
    assert study.spot_names == ("s0", "s1", "s2")
    assert call("check", "rubber", plugin=None).code == 0
    Path("other.csv").write_text(Path("s0.csv").read_text().replace("strain", "stretch"), encoding="utf-8")
    Path("shear.csv").write_text(
        Path("s0.csv").read_text().replace("strain", "amount of shear"), encoding="utf-8"
    )
    reasons = {"other.csv": "other columns than s0.csv", "shear.csv": "a test of mode simple_shear"}
    for file, reason in reasons.items():
        refused = call("init", "bad", *files, "--measured", file, plugin=None)
        assert (refused.code, f"{file}: {reason}" in refused.err) == (2, True)


def test_a_file_of_force_and_travel_names_the_settings_of_a_specimen(call: Call) -> None:
    rows = "\n".join(f"{x:.2f},{0.4 * x / (1.0 + 0.02 * x):.4f}" for x in np.linspace(0.0, 60.0, 61))
    Path("pull.csv").write_text(f"displacement (mm),force (N)\n{rows}\n", encoding="utf-8")
    refused = call("init", "rubber", "--measured", "pull.csv", plugin=None)
    assert refused.code == 2
    for text in (
        "pull.csv: a press needs the mesh of its spot; add --mesh MESH",
        'abscissa = { name = "displacement (mm)", scale = 1/L, offset = 1 }',
        'ordinate = { name = "force (N)", scale = 1/A }',
    ):
        assert text in refused.err


@pytest.mark.parametrize("factor", [0.1, 7.0])
def test_the_range_of_own_presses_follows_their_force(call: Call, factor: float) -> None:
    """A tissue outside all ranges of the ready study is inside the ranges of the own one."""
    call("init", "try", plugin=None)
    head, *rows = Path("try/measured/p1.csv").read_text(encoding="utf-8").splitlines()
    rows[-1] = rows[-1].replace("10,0,", "10,-0.001,")  # back by less than is written
    ends = []
    for scale in (1.0, factor):
        lines = [",".join(_scaled(head, row, scale)) for row in rows]
        Path("own.csv").write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
        files = ("--measured", "own.csv", "--mesh", "try/meshes/p1.vtu")
        assert call("init", f"own{scale}", *files, plugin=None).code == 0
        assert '"-0 deg"' not in Path(f"own{scale}/study.toml").read_text(encoding="utf-8")
        (modulus,) = read_study(f"own{scale}").space.parameters
        ends.append((modulus.lower, modulus.upper))
    assert ends[1] == pytest.approx([factor * end for end in ends[0]], rel=0.01)


def test_a_study_of_a_force_alone_has_its_depth_and_scenarios(call: Call) -> None:
    """Nothing of the ready study's depth, twist or torque is left where the curves have none of them."""
    call("init", "try", plugin=None)
    rows = "".join(f"{d:.1f},{0.4 * d**1.5:.4f}\n" for d in np.linspace(0.0, 6.0, 31))
    Path("own.csv").write_text(f"Depth (mm),Load (N)\n{rows}", encoding="utf-8")
    files = ("--measured", "own.csv", "--mesh", "try/meshes/p1.vtu")
    assert call("init", "own", *files, plugin=None).code == 0
    study = read_study("own")
    assert study.protocol.columns["depth_mm"].max() == pytest.approx(6.0)
    assert not np.any(study.protocol.columns["rotation_deg"])
    assert [{*scenario.weighed} for scenario in study.scenarios] == [{"force"}]
    (measured,) = load_measured(study, Plugins.load().channels).values()
    assert {*measured} == {"force"}


def test_the_ranges_of_an_own_test_follow_its_stress(call: Call) -> None:
    """Shear of a tissue that is a thousand times softer than the rubber of the ready study."""
    rows = "".join(f"{g:.2f},{0.4 * g:.5f}\n" for g in np.linspace(0.0, 0.4, 21))
    Path("own.csv").write_text(f"Shear strain,Shear stress (kPa)\n{rows}", encoding="utf-8")
    assert call("init", "own", "--measured", "own.csv", plugin=None).code == 0
    study = read_study("own")
    c1 = next(p for p in study.space.parameters if p.name.endswith("c1"))
    assert c1.lower < 0.2e-3 < c1.upper
    load_measured(study, Plugins.load().channels)


def test_the_ranges_of_a_creep_test_follow_its_strain(call: Call) -> None:
    """Its stress is largest from a small strain on, where the material of a ready study has little."""
    loading = [(1.0 + 0.001 * k, 0.0005 * k) for k in range(20)]
    creep = [(1.2 - 0.18 * 0.9**k, 0.01) for k in range(60)]
    rows = "".join(f"{stretch:.5f},{stress}\n" for stretch, stress in [*loading, *creep])
    Path("own.csv").write_text(f"stretch,stress_MPa\n{rows}", encoding="utf-8")
    assert call("init", "own", "--measured", "own.csv", plugin=None).code == 0
    c1 = next(p for p in read_study("own").space.parameters if p.name.endswith("c1"))
    assert c1.lower < 0.01 < c1.upper


def _scaled(head: str, row: str, factor: float) -> list[str]:
    values = zip(head.split(","), row.split(","), strict=True)
    return [f"{factor * float(v)}" if v and name.startswith(("force", "torque")) else v for name, v in values]


def test_init_says_which_question_of_a_file_is_open(call: Call) -> None:
    rows = "\n".join(f"{0.01 * k},{2.0 * k}" for k in range(30))
    Path("own.csv").write_text(f"Strain,Stress\n{rows}\n", encoding="utf-8")
    outcome = call("init", "own", "--measured", "own.csv", plugin=None)
    assert outcome.code == 0
    assert "answer first: Stress shows no unit of stress: give scale, the factor to MPa" in outcome.err


@pytest.mark.parametrize(
    ("fit", "searches"),
    [
        ("", True),
        ("[fit]\nsearch = 'grid'\n", True),
        ("[ fit.searched ]\nfriction = { lower = 0.1, upper = 1.5 }\n", False),
        ("[fit]\nsearched.friction = { lower = 0.1, upper = 1.5 }\n", False),
        ("[fit.parametrisation]\nname = 'relaxing'\n", False),
    ],
)
def test_init_leaves_what_a_ready_study_searches(
    call: Call, tmp_path: Path, fit: str, searches: bool
) -> None:
    call("init", "try", plugin=None)
    (tmp_path / "study.toml").write_text(f"[study]\n[protocol]\nfriction = 1.0\n\n{fit}", encoding="utf-8")
    files = ([Path("try/measured/p1.csv")], [Path("try/meshes/p1.vtu")])
    found = look_into(files[0][0], None, Session(), None)
    text = own_study_text(Session(), tmp_path, Path("arm"), *files, [None], found)
    fitted = tomllib.loads(text).get("fit", {})
    assert (fitted.get("searched", {}).get("friction", {}).get("prior") is not None) == searches


def test_init_finds_names_and_paths_for_own_presses(call: Call) -> None:
    """Meshes of one name, a folder that is no name, and one behind a link."""
    call("init", "try", plugin=None)
    Path("deep/er").mkdir(parents=True)
    Path("link").symlink_to("deep/er")
    own = ("--measured", "try/measured/p1.csv", "--mesh", "try/meshes/p1.vtu")
    assert call("init", "link/my arm", *own, *own, plugin=None).code == 0
    study = read_study("link/my arm")
    assert (study.name, study.spot_names) == ("my-arm", ("p1", "p2"))


def test_init_names_the_studies_when_the_name_is_wrong(call: Call) -> None:
    outcome = call("init", "--study", "toi", "mine")
    assert outcome.code == 2
    assert "did you mean 'toy'" in outcome.err
    assert not Path("mine").exists()


def write_of_two_tissues(file: str, *names: str) -> None:
    """Write the layered forearm of the study in the folder `try` with other names of its regions."""
    ready = meshio.read("try/meshes/p2.vtu")
    own = meshio.Mesh(
        ready.points,
        {"tetra10": ready.cells_dict["tetra10"]},
        point_sets={name: np.flatnonzero(ready.point_data[name]) for name in ("fixed", "contact")},
        cell_sets={name: [np.flatnonzero(ready.cell_data["region"][0] == k)] for k, name in enumerate(names)},
    )
    own.write(file)


@pytest.mark.parametrize(("outer", "inner"), [("dermis", "vastus"), ("Layer_1", "Layer_2")])
def test_layers_under_other_names_get_the_materials_of_skin_and_tissue(
    call: Call, outer: str, inner: str
) -> None:
    """A mesh of two regions, skin by its name or its shape; no ready study is named."""
    call("init", "try", "--study", "forearm-layered", plugin=None)
    write_of_two_tissues("own.inp", outer, inner)
    files = ("--measured", "try/measured/p2.csv", "--mesh", "own.inp")
    outcome = call("init", "own", *files, plugin=None)
    assert "everything else from forearm-layered" in outcome.out
    study = read_study("own")
    assert (study.budget.layers, study.budget.bone) == ({"": 0.1}, 1.0)
    space = study.space
    assert {each.region: each.material.name for each in space.regions} == {
        outer: "neo_hookean",
        inner: "yeoh",
    }
    assert {*space.names} == {f"{outer}.E", f"{inner}.c1"}
    assert (f"answer first: is region '{outer}' skin?" in outcome.err) == (outer == "Layer_1")


def test_a_tie_follows_the_region_that_took_the_place_of_a_ready_one(call: Call, tmp_path: Path) -> None:
    """Skin tied to `soft_tissue.c1` on a mesh of dermis over vastus, and on a mesh of skin alone."""
    call("init", "try", "--study", "forearm-layered", plugin=None)
    ready = Path("try/study.toml").read_text(encoding="utf-8")
    tied = re.sub(r"^E = .*", 'E = "9 * soft_tissue.c1"', ready, flags=re.MULTILINE)
    (tmp_path / "study.toml").write_text(tied, encoding="utf-8")
    log, session = Path("try/measured/p2.csv"), Session()
    texts = []
    for inner in ("vastus", "skin_of_palm"):
        write_of_two_tissues("own.inp", "dermis", inner)
        look, found = look_into_mesh(Path("own.inp"), session), look_into(log, None, session, None)
        texts.append(own_study_text(session, tmp_path, Path("own"), [log], [Path("own.inp")], [look], found))
    dermis = tomllib.loads(texts[0])["region"]["dermis"]["parameters"]
    assert dermis["E"] == "9 * vastus.c1"
    Path("own").mkdir()
    Path("own/study.toml").write_text(texts[1], encoding="utf-8")
    with pytest.raises(StudyError, match=r"no parameter 'soft_tissue\.c1'.*name a region of this study"):
        read_study("own")


def test_first_contact_of_a_sphere_on_skin_has_a_law_of_its_own(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A robot's log on skin; on two tissues without skin, at two spots of which one is alike, by a punch."""
    call("init", "logs", "--study", "robot-log", plugin=None)
    call("init", "try", "--study", "forearm-layered", plugin=None)
    call("init", "alike", "--study", "forearm-demo", plugin=None)
    write_of_two_tissues("muscles.inp", "fat", "muscle")
    write_of_two_tissues("skin.inp", "skin", "fat")
    skin, log = "skin.inp", "logs/logs/simulated_p2.parquet"
    onsets = {}
    for name, meshes in {
        "skin": [skin],
        "muscles": ["muscles.inp"],
        "mixed": [skin, "alike/meshes/p1.vtu"],
    }.items():
        files = [word for mesh in meshes for word in ("--measured", log, "--mesh", mesh)]
        assert call("init", name, *files, plugin=None).code == 0
        onsets[name] = Path(name, "study.toml").read_text(encoding="utf-8")
    ready = Path("try/study.toml").read_text(encoding="utf-8")
    punch = ready.replace('shape = "sphere"', 'shape = "cylinder"')
    (tmp_path / "study.toml").write_text(punch, encoding="utf-8")
    assert punch != ready
    look, found = look_into_mesh(Path(skin), Session()), look_into(Path(log), None, Session(), None)
    onsets["punch"] = own_study_text(
        Session(), tmp_path, Path("own"), [Path(log)], [Path(skin)], [look], found
    )
    law = re.compile(r"^\[experiment\.settings\.onset\]\nexponent = 1\.3   # CHANGE THIS: ", re.MULTILINE)
    assert [name for name, text in onsets.items() if law.search(text)] == ["skin"]
    warned, sd_mm = [], []
    for text in (
        onsets["skin"],
        re.sub(r"^\[experiment\.settings\.onset\]\n.*\n", "", onsets["skin"], flags=re.M),
    ):
        Path("skin/study.toml").write_text(text, encoding="utf-8")
        own = read_study("skin")
        warned.append([*press_warnings(own, load_limbs(own, to_show=True))])
        sd_mm.append(read_first(own).record["uncertainty"]["depth_mm"])
    monkeypatch.setattr(type(own.loader_at(own.spot_names[0])), "press_warnings", lambda *_, **__: 1 / 0)
    with pytest.raises(PluginError, match="checking the press: 'robot_log'"):
        list(press_warnings(own, load_limbs(own, to_show=True)))
    assert warned[0] == []
    assert "Set exponent = 1.3 under [experiment.settings.onset], and search depth_offset" in warned[1][0]
    assert tomllib.loads(onsets["skin"])["experiment"]["settings"]["onset"] == {"exponent": 1.3}
    assert [name for name, text in onsets.items() if "exponent" in text] == ["skin"]
    searched = {name: tomllib.loads(text)["fit"]["searched"] for name, text in onsets.items()}
    assert [name for name, each in searched.items() if "depth_offset" in each] == ["skin", "muscles", "mixed"]
    offset = searched["skin"]["depth_offset"]
    assert float(offset["prior"].pop("sd").removesuffix(" mm")) == pytest.approx(sd_mm[0], rel=0.05)
    assert offset == {"lower": "-1 mm", "upper": "1 mm", "prior": {"value": "0 mm"}}
    assert all("[budget]" in text for text in onsets.values())


@pytest.mark.parametrize(
    ("folder", "name"),
    [
        ("Öz", "Oz"),
        ("Ü", "U"),
        ("Müller 3", "Muller-3"),
        ("Ян", "u42fu43d"),
        ("患者1", "u60a3u80051"),
        ("…", "own"),
    ],
)
def test_a_study_keeps_the_letters_of_its_folder(call: Call, tmp_path: Path, folder: str, name: str) -> None:
    assert call("init", folder).code == 0
    assert f'\nname = "{name}"\n' in (tmp_path / folder / "study.toml").read_text(encoding="utf-8")
