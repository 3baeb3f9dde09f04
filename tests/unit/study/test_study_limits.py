"""What no study needs is refused with the limit: size, depth, length, number; without it, these never end."""

import json
from pathlib import Path

import pytest

from palpate.errors import MeshError, StudyError
from palpate.plugins.catalogue import Plugins
from palpate.study.reading import read_study
from palpate.study.spots import mesh_note
from palpate.units import convert

TOY = Path(__file__).parents[2] / "data" / "toy"
TEXT = (TOY / "study.toml").read_text()


def refused(folder: Path, plugins: Plugins, text: str) -> str:
    for name in ("s1.txt", "s2.txt"):
        (folder / name).write_bytes((TOY / name).read_bytes())
    (folder / "study.toml").write_text(text)
    with pytest.raises(StudyError) as caught:
        read_study(folder, plugins)
    assert len(str(caught.value)) < 20_000
    return str(caught.value)


SPOT = '\n[[spot]]\nname = "x{}"\nmeasured = {{ pull = "s1.txt" }}\n'
BOMBS = {
    "arrays in arrays": ("= 20", "= " + "[" * 1000 + "]" * 1000, "nested too deep"),
    "tables in tables": ("= 20", "= " + "{a=" * 400 + "1" + "}" * 400, "nested"),
    "an integer of 5,000 digits": ("= 20", "= " + "9" * 5000, "study.toml: "),
    "an integer of 50 digits": ("= 20", "= " + "9" * 50, "sampling.n_sets: a whole number beyond"),
    "many sets": ("= 20", "= 10000000", "less than or equal to 100000"),
    "many simulations": (
        "[experiment]",
        "".join(map(SPOT.format, range(90))) + "[experiment]",
        "1840000 simulations, and a study has at most 1000000",
    ),
    "a long name": (
        'name = "toy"',
        f'name = "{"a" * 240}"',
        "study.name: 'aaaaaaaaaaaa...aaaaaaaaaaaaa': give at",
    ),
    "a character zero": ('"s2.txt"', '"s2\\u0000.txt"', "control character U+0000"),
    "an escape sequence": ('name = "toy"', 'name = "\\u001b[31m"', "control character U+001B"),
}


@pytest.mark.slow
@pytest.mark.parametrize(("old", "new", "message"), BOMBS.values(), ids=BOMBS)
def test_a_limit_is_reported_at_once(
    tmp_path: Path, plugins: Plugins, old: str, new: str, message: str
) -> None:
    assert old in TEXT
    text = TEXT.replace(old, new, 1)
    if message.startswith("1840000"):
        text = text.replace("= 20", "= 20000")
    assert message in refused(tmp_path, plugins, text)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("9 kPa**9**9**9**9", "unknown unit"),
        ("9 kPa*2**999999999", "unknown unit"),
        ("9 (kPa**9)**9", "unknown unit"),
        ("9 " + "kPa*" * 5000 + "kPa", "more than 100 characters"),
        ("9 " + "(" * 90, "unknown unit"),
        ("1 " + "*Gm^9" * 9 + "/mm^9" * 9, "unknown unit"),
        ("1 Gm^9*Gm^9*Gm^9*Gm^9*Gm^9/mm^9/mm^9/mm^9/mm^9/mm^9*MPa", "is not finite"),
    ],
)
def test_a_unit_is_names_and_small_powers(given: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        convert(given, "MPa")


@pytest.mark.parametrize("given", ["1000 kg/(m*s^2)", "1000 kg*m**-1*s**-2", "1000 N m^-2", "1 kN·m/m^3"])
def test_compound_units_are_read(given: str) -> None:
    assert convert(given, "MPa") == pytest.approx(1e-3, rel=1e-12)


@pytest.mark.parametrize(
    "text",
    ['{"a": NaN}', '{"a": 1e999}', '{"a": "\\ud800"}', '{"a": ' + "[" * 100_000, '{"a": "\\u001b[31m"}'],
)
def test_a_note_that_cannot_be_written_again_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "p1.json").write_text(text)
    with pytest.raises(MeshError, match=r"p1\.json: not a note"):
        mesh_note(tmp_path / "p1.vtu")


def test_a_note_of_ordinary_depth_is_read(tmp_path: Path) -> None:
    note = {"quality": {"edges": [[1.5, 2.0]], "kind": "tet10"}}
    (tmp_path / "p1.json").write_text(json.dumps(note))
    assert mesh_note(tmp_path / "p1.vtu") == note


def test_a_byte_order_mark_is_skipped(tmp_path: Path, plugins: Plugins) -> None:
    for name in ("s1.txt", "s2.txt"):
        (tmp_path / name).write_bytes((TOY / name).read_bytes())
    text = "\ufeff" + TEXT.replace("\n", "\r\n")
    (tmp_path / "study.toml").write_text(text, encoding="utf-8", newline="")
    assert read_study(tmp_path, plugins).name == "toy"
    (tmp_path / "study.toml").write_text(text.replace("= 20", "= 1"), encoding="utf-8", newline="")
    with pytest.raises(StudyError, match=r"study\.toml:\d+: sampling\.n_sets: one set is no sweep"):
        read_study(tmp_path, plugins)


def test_settings_of_another_loader_are_one_line_that_names_it(tmp_path: Path) -> None:
    columns = """
[experiment.settings.channels]
time = "t"
position = { columns = ["x", "y", "z"] }
orientation = { columns = ["qx", "qy", "qz", "qw"] }
force = { columns = ["fx", "fy", "fz"] }
moment = { columns = ["mx", "my", "mz"] }
"""
    plugins = Plugins.load([TOY / "toy_plugin.py"])
    text = TEXT.replace('"lines"', '"csv"').replace("[region.rubber]", f"{columns}[region.rubber]", 1)
    found = refused(tmp_path, plugins, text)
    assert found.endswith("these are settings of 'robot_log', not of 'csv'; name 'robot_log', or change them")
    assert "\n" not in found
