"""Mistakes that people make in a study and its curves: each is refused or warned of, with what to do."""

import re
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import PalpateError
from palpate.experiment.measured import load_measured, measured_warnings
from palpate.limb.loading import limb_warnings, load_limbs
from palpate.plugins.catalogue import Plugins
from palpate.study.checks import setting_warnings
from palpate.study.reading import read_study

Edit = Callable[[Path], None]


@cache
def plugins() -> Plugins:
    return Plugins.load()


def words(folder: Path, *, with_limbs: bool = False) -> str:
    """What a study is refused for, else its warnings; empty where both are silent."""
    try:
        study = read_study(folder, plugins())
        measured = load_measured(study, plugins().channels)
        limbs = load_limbs(study) if with_limbs else {}
    except PalpateError as error:
        return str(error)
    return "\n".join((*setting_warnings(study), *measured_warnings(measured), *limb_warnings(study, limbs)))


def toml(old: str, new: str) -> Edit:
    def edit(folder: Path) -> None:
        replace_in(folder / "study.toml", old, new)

    return edit


def text(name: str, *pairs: tuple[str, str]) -> Edit:
    def edit(folder: Path) -> None:
        for old, new in pairs:
            replace_in(folder / "measured" / name, old, new)

    return edit


def replace_in(file: Path, old: str, new: str) -> None:
    content = file.read_text()
    assert old in content, old
    file.write_text(content.replace(old, new))


def table(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Edit:
    def edit(folder: Path) -> None:
        file = folder / "measured" / name
        header, *rows = file.read_text().splitlines()
        changed = change(np.array([row.split(",") for row in rows], dtype=float))
        file.write_text("\n".join([header, *(",".join(map(repr, row)) for row in changed.tolist())]) + "\n")

    return edit


def column(number: int, scale: float = 1.0, offset: float = 0.0) -> Callable[[np.ndarray], np.ndarray]:
    def change(rows: np.ndarray) -> np.ndarray:
        rows[:, number] = scale * rows[:, number] + offset
        return rows

    return change


def moved(source: int, target: int) -> Callable[[np.ndarray], np.ndarray]:
    def change(rows: np.ndarray) -> np.ndarray:
        return np.insert(np.delete(rows, source, axis=0), target, rows[source], axis=0)

    return change


def both(*edits: Edit) -> Edit:
    def edit(folder: Path) -> None:
        for each in edits:
            each(folder)

    return edit


MEASURED = 'uniaxial = "measured/UT.csv", equibiaxial = "measured/ET.csv", pure_shear = "measured/PS.csv"'
STRETCH, STRESS = range(2)
DEPTH, ANGLE, FORCE, TORQUE = range(4)

TENSILE = {
    "columns swapped": (
        table("UT.csv", lambda rows: rows[:, ::-1]),
        r"UT\.csv: .*'uniaxial': .*columns are swapped; .*exchange .*channels\.uniaxial",
    ),
    "stress of the other sign": (
        table("UT.csv", column(STRESS, -1.0)),
        r"UT\.csv: .*'uniaxial': stress_MPa is -6\.318 at stretch 7\.6.* scale = -1 .*channels\.uniaxial",
    ),
    "stress in kPa": (
        table("UT.csv", column(STRESS, 1e3)),
        r"UT\.csv: .*'uniaxial': stress_MPa is .* the unit .*scale = 0\.001 .*channels\.uniaxial",
    ),
    "strain instead of stretch": (
        table("UT.csv", column(STRETCH, 1.0, -1.0)),
        r"UT\.csv: .*'uniaxial': .* strain; .*offset = 1 .*channels\.uniaxial\.abscissa",
    ),
    "strain in percent": (
        table("UT.csv", column(STRETCH, 100.0, -100.0)),
        r"UT\.csv: .*'uniaxial': .* percent.* scale = 0\.01, offset = 1 .*channels\.uniaxial\.abscissa",
    ),
    "files of two tests exchanged": (
        toml(MEASURED, MEASURED.replace("UT", "XX").replace("ET", "UT").replace("XX", "ET")),
        r"spot 'specimen': .*'uniaxial'.*'equibiaxial'.* exchanged.* measured",
    ),
    "one file for two tests": (
        toml("measured/PS.csv", "measured/UT.csv"),
        r"spot 'specimen': .*'uniaxial' and 'pure_shear' are the same.* measured",
    ),
    "range a thousandth": (
        toml('"0.1 MPa", upper = "0.3 MPa"', '"0.1 kPa", upper = "0.3 kPa"'),
        r"'uniaxial': stress_MPa is .* the ranges of the study.* check the unit .* ranges",
    ),
    "row out of order": (
        table("UT.csv", moved(4, 0)),
        r"UT\.csv: .*'uniaxial' row 0 \(stretch 1\.585\) is out of order; move",
    ),
    "point lost in one number": (
        text("UT.csv", ("0.4081", "4.081")),
        r"UT\.csv: .*'uniaxial'.* 4\.081 at stretch 1\.585",
    ),
    "load cell not zeroed": (
        table("UT.csv", column(STRESS, 1.0, 0.5)),
        r"UT\.csv: .*'uniaxial'.* at stretch 1\.02.* subtract",
    ),
    "one decimal comma": (
        text("UT.csv", ("1.5850,0.4081", '1.5850,"0,4081"')),
        r"UT\.csv: line 6, column 'stress_MPa': '0,4081' .*decimal = ",
    ),
    "empty cell": (text("UT.csv", ("0.4081", "")), r"UT\.csv: line 6, column 'stress_MPa': no number.* fill"),
    "other column name": (
        text("UT.csv", ("stress_MPa", "stress_kPa")),
        r"UT\.csv: no column 'stress_MPa'; did you mean 'stress_kPa'",
    ),
    "file that is not there": (toml("UT.csv", "TU.csv"), r"study\.toml:15: .*no such file.* relative to"),
    "unit in wrong case": (
        toml('"0.3 MPa"', '"0.3 Mpa"'),
        r"study\.toml:\d+: region\.specimen\.parameters\.c1\.upper: .*did you mean 'MPa'",
    ),
    "decimal comma": (
        toml('"0.3 MPa"', '"0,3 MPa"'),
        r"study\.toml:\d+: .*c1\.upper: '0,3 MPa' has a decimal comma; write \"0\.3 MPa\"",
    ),
    "no unit": (toml('"0.3 MPa"', "0.3"), r'study\.toml:\d+: .*c1\.upper: .*write "0\.3 MPa"'),
    "range upside down": (
        toml('"0.1 MPa", upper = "0.3 MPa"', '"0.3 MPa", upper = "0.1 MPa"'),
        r"study\.toml:\d+: .*c1: lower .* is not less than .*swap",
    ),
    "sign of a range": (
        toml('"0.1 MPa", upper = "0.3 MPa"', '"-0.3 MPa", upper = "-0.1 MPa"'),
        r"study\.toml:\d+: .*c1\.lower: .*outside its physical range",
    ),
    "material misspelt": (toml('"yeoh"', '"yoeh"'), r"study\.toml:\d+: .*no material 'yoeh'; did you mean"),
    "scenario misspelt": (
        toml('"uniaxial only", "equi', '"uniaxal only", "equi'),
        r"study\.toml:\d+: .*no scenario 'uniaxal only'; did you mean",
    ),
    "channel misspelt": (
        toml('uniaxial = "measured', 'uniaxail = "measured'),
        r"study\.toml:15: .*uniaxail.*did you mean 'uniaxial'",
    ),
}

PRESSED = {
    "radius ten times too large": (toml('"7.5 mm"', '"75 mm"'), r"'p1': a sphere of radius 75 mm .* check"),
    "friction ten times too large": (toml("friction = 1.0", "friction = 10"), r"'p1': .*friction 10.* check"),
    "depth in m": (
        table("p1.csv", column(DEPTH, 1e-3)),
        r"p1\.csv: .*'force' .* 1e\+03 times .* m: .*scale = 1000 .*channels\.force\.abscissa",
    ),
    "rotation in rad": (
        table("p1.csv", column(ANGLE, np.pi / 180.0)),
        r"p1\.csv: .*'torque' .* 57\.3 times .* rad: .*scale = 57\.2958 .*channels\.torque\.abscissa",
    ),
    "force in mN": (table("p1.csv", column(FORCE, 1e3)), r"p1\.csv: .*'force': force_N reaches .* the unit"),
    "torque in N·m": (table("p1.csv", column(TORQUE, 1e-3)), r"p1\.csv: .*check the unit"),
    "force of the other sign": (
        table("p1.csv", column(FORCE, -1.0)),
        r"p1\.csv: .*'force': .* turn its sign",
    ),
    "torque of the other sign": (
        table("p1.csv", column(TORQUE, -1.0)),
        r"p1\.csv: .*'torque': .* turn the sign",
    ),
    "force and torque swapped": (
        table("p1.csv", lambda rows: rows[:, [DEPTH, ANGLE, TORQUE, FORCE]]),
        r"p1\.csv: .*channel.* check",
    ),
    "force not tared": (table("p1.csv", column(FORCE, 1.0, 3.0)), r"p1\.csv: .*'force' is 3 .* subtract"),
    "twist the other way round": (
        toml('"-22.5 deg", "22.5 deg"', '"22.5 deg", "-22.5 deg"'),
        r"p1\.csv: .*'torque' goes to -22\.5 degrees first .* give \[protocol\] the order",
    ),
    "protocol in m": (toml('"10 mm"', '"10 m"'), r"1e\+03 times as far; correct the unit in \[protocol\]"),
    "twist in rad": (
        toml('"-22.5 deg", "22.5 deg"', '"-22.5 rad", "22.5 rad"'),
        r"57\.3 times as far; correct the unit in \[protocol\]",
    ),
    "a twist that is no list": (
        toml('["-22.5 deg", "22.5 deg", "0 deg"]', '"22.5 deg"'),
        r"protocol\.twist: '22\.5 deg': not a list; write \[ … \]",
    ),
    "friction as a range": (
        toml("friction = 1.0", "friction = { lower = 0.2, upper = 1.2 }"),
        r"protocol\.friction: a range; .*the range as friction under \[fit\.searched\]",
    ),
    "range as a list": (
        toml('{ lower = "9 kPa", upper = "21 kPa" }', '["9 kPa", "21 kPa"]'),
        r"is not a quantity; .*, or \{ lower = …, upper = … \} for a range",
    ),
    "log's loader without its columns": (
        toml('loader = "csv"', 'loader = "robot_log"'),
        r"channels: missing; `palpate experiment inspect FILE` prints",
    ),
    "name of another quantity": (
        text("p1.csv", ("force_N", "Kraft_N")),
        r"no column 'force_N'; did you mean 'Kraft_N'\?",
    ),
    "protocol deeper than the curve": (
        toml('"10 mm"', '"12 mm"'),
        r"p1\.csv: .*'force' covers .* \[protocol\] says 12 mm: write depth = \"10 mm\" there",
    ),
    "rows lost": (
        table("p1.csv", lambda rows: rows[(rows[:, DEPTH] < 4.0) | (rows[:, DEPTH] > 9.9)]),
        r"p1\.csv: .*'force' has no point between .* measure",
    ),
    "moduli in MPa": (
        toml('"9 kPa", upper = "21 kPa"', '"9 MPa", upper = "21 MPa"'),
        r"p1\.csv: .*'force': .*the ranges of the study.* check the unit .*moduli",
    ),
    "no friction": (toml("friction = 1.0", ""), r"study\.toml:\d+: protocol\.friction: missing; add"),
    "mesh that is not there": (toml("p1.vtu", "p9.vtu"), r"study\.toml:\d+: .*mesh: .*no such file"),
    "region misspelt": (
        toml("soft_tissue", "soft_tisue"),
        r"region 'soft_tissue' has no material .*; give the region .* of 'soft_tisue' one name",
    ),
    # docs/curves.md lists both.
    "compliant robot": (both(table("p1.csv", column(DEPTH, 1.1)), toml('"10 mm"', '"11 mm"')), ""),
    "curves of another spot": (toml("measured/p1.csv", "measured/p2.csv"), ""),
}

NEED_LIMBS = ("radius ten times too large", "region misspelt")


@pytest.fixture
def treloar(tmp_path: Path) -> Path:
    return shutil.copytree(plugins().studies["treloar"].directory, tmp_path / "treloar")


@pytest.fixture
def forearm(tmp_path: Path) -> Path:
    """The demo with its first spot alone, and without a finer mesh."""
    folder = tmp_path / "forearm"
    shutil.copytree(plugins().studies["forearm-demo"].directory, folder)
    content = (folder / "study.toml").read_text()
    kept = re.sub(r'\[\[spot\]\]\nname = "p[234]"\n.*\n.*\n\n', "", content)
    (folder / "study.toml").write_text(re.sub(r"\[fit\](\n.+)+\n", "", kept))
    return folder


@pytest.mark.parametrize("mistake", TENSILE)
def test_a_mistake_in_a_tensile_study_is_named(treloar: Path, mistake: str) -> None:
    edit, expected = TENSILE[mistake]
    edit(treloar)
    found = words(treloar)
    assert re.search(expected, found), found
    assert "order of turns" not in found


@pytest.mark.parametrize("mistake", PRESSED)
def test_a_mistake_in_a_press_is_named(forearm: Path, mistake: str) -> None:
    edit, expected = PRESSED[mistake]
    edit(forearm)
    found = words(forearm, with_limbs=mistake in NEED_LIMBS)
    assert re.search(expected, found) if expected else not found, found


def test_few_mistakes_pass_and_the_guide_lists_them() -> None:
    every = TENSILE | PRESSED
    silent = [name for name, (_, expected) in every.items() if not expected]
    assert (len(every), len(silent)) == (49, 2)
    guide = (Path(__file__).parents[3] / "docs" / "curves.md").read_text()
    _, _, listed = guide.partition("## Errors that no check finds")
    assert "10 % too large" in listed
    assert "Curves of the wrong spot" in listed


def test_without_a_mistake_there_is_no_word(treloar: Path, forearm: Path) -> None:
    assert not words(treloar)
    assert not words(forearm, with_limbs=True)
