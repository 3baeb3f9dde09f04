"""Options of ``palpate limb``: read from a file and from the command line, refused with their place."""

from pathlib import Path

import pytest

from palpate.api.runs import read_options
from palpate.cli.app import main
from palpate.errors import StudyError
from palpate_limb.cli import _is_to_simulate
from palpate_limb.options import BoneFile, ScanOptions


def test_without_a_file_the_options_are_those_of_the_guide() -> None:
    options = read_options(None, ScanOptions, {})
    assert options.length_mm == pytest.approx(80.0)
    assert (options.mesh.size.fine_mm, options.mesh.size.coarse_mm) == pytest.approx((1.35, 18.0))
    assert (options.mesh.size.inner_mm, options.mesh.size.radius_mm) == pytest.approx((5.5, 8.5), abs=0.003)
    shallow = options.model_copy(update={"depth": 2.7}).mesh.size
    assert (shallow.inner_mm, shallow.radius_mm) == pytest.approx((3.3, 5.1), abs=0.003), "Hertz: 0.6 radii"
    assert options.mesh.core == "soft_tissue"
    assert list(options.mark) == ["p1", "p2", "p3", "p4"]
    assert (options.mark_radii, options.smoothing, options.into) == ([1.2, 10.0], 20, Path("meshes"))


def test_the_guide_has_every_key_and_its_default(tmp_path: Path) -> None:
    text = (Path(__file__).parents[3] / "docs" / "limb.md").read_text(encoding="utf-8")
    block = text.split("## The file of options")[1].split("```toml\n")[1].split("```")[0]
    (tmp_path / "limb.toml").write_text(block)
    of_guide, default = read_options(tmp_path / "limb.toml", ScanOptions, {}), ScanOptions()
    assert of_guide.model_fields_set == set(ScanOptions.model_fields) - {"mark", "landmarks"}
    assert "mark = " in block
    assert "landmarks = " in block
    assert (of_guide.length, of_guide.size) == pytest.approx((default.length_mm, default.mesh.size.fine_mm))
    for key in ("mark_radii", "repair", "smoothing", "stump", "radius", "fine", "core"):
        assert getattr(of_guide, key) == getattr(default, key), key


def test_options_of_the_command_line_come_first_and_have_their_own_folder(tmp_path: Path) -> None:
    (tmp_path / "limb.toml").write_text(
        'bones = ["a.stl", "tibia, fibula=b.stl"]\nsize = "3 mm"\ninto = "out"\nmotion = "m.txt"\n'
        'spot.p1 = "5%,0deg"'
    )
    of_file = read_options(tmp_path / "limb.toml", ScanOptions, {})
    assert of_file.bones == [BoneFile(tmp_path / "a.stl"), BoneFile(tmp_path / "b.stl", ("tibia", "fibula"))]
    assert (of_file.into, of_file.motion) == (tmp_path / "out", tmp_path / "m.txt")
    given = {"size": "2 mm", "into": "here", "bones": ["c.stl"], "spot": {"p2": "7%,0deg"}}
    both = read_options(tmp_path / "limb.toml", ScanOptions, given)
    assert (both.size, both.into, both.bones) == (2.0, Path("here"), [BoneFile(Path("c.stl"))])
    assert (both.motion, list(both.spot)) == (tmp_path / "m.txt", ["p2"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stump = true\nsiz = '2 mm'", "limb.toml:2: siz: unknown key; did you mean 'size'? (known: bones,"),
        ("mark-radii = 1", "limb.toml:1: mark-radii: unknown key; did you mean 'mark_radii'"),
        ("bones = 'x.stl'", "limb.toml:1: bones: 'x.stl': not a list; write [ … ]"),
        ("bones = ['a,a=b.stl']", "limb.toml:1: bones[0]: a,a=b.stl: give each bone a name of its own"),
        ("size = 4", 'limb.toml:1: size: 4 has no unit; write "4 mm"'),
        ("\nsize = '0 mm'", "limb.toml:2: size: '0 mm': must be greater than 0"),
        ("stump = 1", "limb.toml:1: stump: 1: not true or false"),
        ("smoothing = 201", "limb.toml:1: smoothing: 201: must be less than or equal to 200"),
        ("core = 'a b'", "limb.toml:1: core: 'a b' is not a name; use letters, digits, - and _"),
        ("unit = 'MPa'", "limb.toml:1: unit: '1 MPa' is not of the kind of mm"),
        ("unit = '0 mm'", "limb.toml:1: unit: 0 mm: give more than 0 mm"),
        ("axis = [0, 0, 0]", "limb.toml:1: axis: [0, 0, 0]: give three numbers, not all 0"),
        ("axis = [nan, 0, 1]", "limb.toml:1: axis: [nan, 0, 1]: give three numbers, not all 0"),
        ("spot.p1 = '1,2,3'\nzero = [1, 0]", "limb.toml:2: zero: [1, 0]: give three numbers, not all 0"),
        ("mark_radii = ['1 mm']", "limb.toml:1: mark_radii: give the least and, after it,"),
        ("mark_radii = ['4 mm', '2 mm']", "limb.toml:1: mark_radii: give the least and, after it,"),
        ("[mark]\np1 = 'mauve'", "limb.toml:2: mark.p1: 'mauve' is not one of 'red', 'orange', "),
        ("mark = ['a', 'a']", "limb.toml:1: mark: ['a', 'a']: not a table"),
        ("[spot]\np1 = '45%'", "limb.toml:2: spot.p1: 45%: around the limb is where? Add an angle"),
        ("[spot]\np1 = '45%,120'", "limb.toml:2: spot.p1: '120' has no unit; write \"120 deg\""),
        ("[spot]\np1 = 'elbow'", "limb.toml:2: spot.p1: elbow: give x,y,z in the scan's coordinates"),
        ("zero = [1, 0, 0]", "limb.toml:1: spot: missing, and zero is for it; add [spot] NAME = PLACE"),
        ("mark = ['a']\nspot.a = '1,2,3'", "limb.toml:1: mark: give the spots by place (spot) or by ink"),
        ("motion = 'a'\nlandmarks = 'b'", "limb.toml:2: landmarks: both a motion and landmarks"),
        ("[layer]\nfat = 5", 'limb.toml:2: layer.fat: 5 has no unit; write "5 mm"'),
        ("[layer_at.p1]\nfat = '0 mm'", "limb.toml:2: layer_at.p1.fat: '0 mm': must be greater than 0"),
        ("unit = [", "limb.toml: invalid TOML:"),
    ],
)
def test_a_wrong_key_is_refused_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "limb.toml").write_text(text)
    with pytest.raises(StudyError) as refused:
        read_options(tmp_path / "limb.toml", ScanOptions, {})
    assert message in str(refused.value).replace(f"{tmp_path}/", "")


def test_every_wrong_key_is_named_at_once(tmp_path: Path) -> None:
    (tmp_path / "limb.toml").write_text("size = 4\nstump = 1\n")
    with pytest.raises(StudyError, match=r"limb\.toml:1: size.*\n.*limb\.toml:2: stump"):
        read_options(tmp_path / "limb.toml", ScanOptions, {})


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--size", "4"], "--size: '4' has no unit; write \"4 mm\""),
        (["--spot", "p1=45%"], "--spot p1: 45%: around the limb is where?"),
        (["--spot", "1,2,3"], "--spot 1,2,3: '1,2,3' is not a name"),
        (["--spot", "p1=1,2,3", "--spot", "p1=1,2,3"], "--spot: one name twice"),
        (
            ["--spot", "p1=1,2,3", "--mark", "p1=red"],
            "--mark: give the spots by place (spot) or by ink (mark)",
        ),
        (["--mark", "p1", "--mark", "p2=red"], "--mark: give every mark a colour, or none of them"),
        (["--mark", "p1=mauve"], "--mark p1: 'mauve' is not one of 'red'"),
        (["--bones", "=b.stl"], "--bones [0]: =b.stl: give each bone a name of its own"),
        (["--options", "no.toml"], "no.toml: no such file of options; check the path"),
    ],
)
def test_a_wrong_option_of_the_command_line_is_named(
    capsys: pytest.CaptureFixture[str], given: list[str], message: str
) -> None:
    assert main(["limb", "skin.stl", *given]) == 2
    assert message in " ".join(capsys.readouterr().err.split())


def test_after_the_meshes_come_the_curves_of_a_study_that_simulates_them(tmp_path):
    study, spot = tmp_path / "study.toml", '[[spot]]\nname = "p1"\nmeasured = "p1.csv"\n'
    assert not _is_to_simulate(study)
    study.write_text(spot)
    assert not _is_to_simulate(study)  # measured, by somebody
    study.write_text(f"{spot}[truth]\nskin.E = '0.1 MPa'\n")
    assert _is_to_simulate(study)
    (tmp_path / "p1.csv").touch()
    assert not _is_to_simulate(study)
    study.write_text("[truth")
    assert not _is_to_simulate(study)  # `palpate check` says what is wrong
