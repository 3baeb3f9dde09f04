"""The command line over the toy study: what it prints, where, and how it ends."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from palpate import __version__

from .conftest import PLUGIN, TOY, Call, edit

# ------------------------------------------------------------------- surface


def test_version(call: Call) -> None:
    assert call("--version", plugin=None).out == f"palpate {__version__}\n"


def test_the_version_is_that_of_the_package() -> None:
    root = Path(__file__).parents[2]
    assert f'version = "{__version__}"' in (root / "pyproject.toml").read_text()


def test_a_misspelt_command_is_a_mistake_of_the_user(call: Call) -> None:
    outcome = call("rnu")
    assert outcome.code == 2
    assert "rnu" in outcome.err


@pytest.mark.parametrize(
    "arguments",
    [["status"], ["check"], ["run"], ["report"], ["new-plugin", "material"], ["--plugin"]],
    ids=lambda each: each[0],
)
def test_a_file_name_that_is_too_long_is_a_mistake_of_the_user(call: Call, arguments: list[str]) -> None:
    outcome = call(*arguments, "a" * 5000, *(["check", "."] if arguments == ["--plugin"] else []))
    assert outcome.code == 2
    assert "Traceback" not in outcome.err
    assert len(outcome.err) < 1000, outcome.err[:2000]


# --------------------------------------------------------------------- check


def test_check_shows_what_a_run_would_do_and_writes_nothing(call: Call, study: Path, tmp_path: Path) -> None:
    before = sorted(tmp_path.rglob("*"))
    outcome = call("check", study)
    assert outcome.code == 0
    assert "rubber.k" in outcome.out
    assert "20 sets drawn, 20 kept by the filters; 40 simulations" in outcome.out
    assert "SIMULATED" in outcome.out
    assert f"next: palpate --plugin {PLUGIN} run {study}" in outcome.err
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.slow
@pytest.mark.usefixtures("one_figure")
def test_check_tells_how_long_the_sweep_takes_and_offers_a_first_look(
    call: Call, study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from palpate.simulation import cost

    assert "20 simulations to do, each less than a second; then about" in call("check", study).out
    monkeypatch.setattr(cost, "timed", lambda *_: 90.0)
    shown = call("check", study).out
    assert "20 simulations to do, about 30 min; then about" in shown
    assert f"a first look of about 18 min: palpate run {study} --sets 12; the whole run keeps" in shown
    assert call("check", study, "--json").json["seconds"] == 20 * 90.0
    assert call("run", study, "--sets", 12).code == 0
    found = call("check", study, "--json").json
    assert found["n_left"] == 8
    assert found["seconds"] < 90.0
    assert "8 simulations to do, each less than a second; then about" in call("run", study).err
    assert "simulations to do" not in call("check", study).out


def test_check_as_json(call: Call) -> None:
    found = call("check", TOY, "--json").json
    assert found["spots"] == {"s1": ["pull"], "s2": ["pull"]}
    assert found["searched"] == [{"name": "rubber.k", "lower": 1.0, "upper": 3.0, "unit": "MPa"}]
    assert (found["data"], found["n_sets"]) == ("simulated", 20)
    assert found["fit"] == {"search": "least_squares", "searched": []}


def test_check_lists_what_only_the_fit_searches(call: Call, study: Path) -> None:
    edit(study, "[truth]", "[fit]\nsearched.gains.pull = { lower = 0.5, upper = 2 }\n\n[truth]")
    edit(study, '"3 MPa"', '"3 MPa", prior = { value = "2 MPa", sd = "500 kPa" }')
    shown = call("check", study).out
    assert re.search(r"rubber.k +1000 +3000 +kPa +2000 ± 500 ", shown)  # as the range is written
    assert re.search(r"gain.pull +0.5 +2 +1 +– +factor on 'pull'; a value for each spot", shown)
    assert "fit by least_squares, from the best sets" in shown
    assert call("check", study, "--json").json["fit"]["searched"] == [
        {"name": "gain.pull", "lower": 0.5, "upper": 2.0, "unit": "1"}
    ]


def test_what_only_a_fit_uses_gives_a_warning_without_one(call: Call, study: Path) -> None:
    edit(study, "[truth]", "[fit]\nsearched.gains.pull = { lower = 0.5, upper = 2 }\n\n[truth]")
    edit(study, '"3 MPa"', '"3 MPa", prior = { value = "2 MPa", sd = "500 kPa" }')
    assert call("check", study, "--json").json["warnings"] == []
    edit(study, "[fit]", '[fit]\nsearch = "sweep"')
    warnings = call("check", study, "--json").json["warnings"]
    assert [each.partition(":")[0] for each in warnings] == ["rubber.k", "gain.pull"]


def test_tables_of_curves_have_units_and_peaks(call: Call, study: Path) -> None:
    assert "pull 3 MPa" in call("check", study).out
    assert re.search(r"s1 +pull +11 +1 +1 to 2 +0 to 3 MPa +–", call("experiment", study).out)


@pytest.mark.slow
@pytest.mark.usefixtures("one_figure")
def test_suspicious_curves_give_a_warning_in_check_and_run(call: Call, study: Path) -> None:
    edit(study, '"1000 kPa"', '"1 kPa"')
    expected = "rubber.k: the range spans a factor of 3000, and a linear scale leaves its lower decades"
    outcome = call("check", study, "--json")
    assert outcome.code == 0
    assert outcome.json["warnings"][0].startswith(expected)
    assert f"warning: {expected}" in outcome.err
    assert f"warning: {expected}" in call("run", study, "--json").err
    assert call("check", TOY, "--json").json["warnings"] == []


def test_check_prints_the_schema(call: Call) -> None:
    found = call("check", "--schema").json
    assert found["$schema"].startswith("https://json-schema.org")
    assert "study" in found["required"]


def test_check_without_a_study(call: Call) -> None:
    outcome = call("check")
    assert outcome.code == 2
    assert "palpate check STUDY" in outcome.err


# ------------------------------------------------------------ mistakes, codes


@pytest.mark.parametrize("command", ["check", "run", "experiment", "sample", "simulate"])
def test_a_mistake_in_the_study_ends_with_2_and_writes_nothing(call: Call, study: Path, command: str) -> None:
    edit(study, '"3 MPa"', '"3 apples"')
    outcome = call(command, study)
    assert outcome.code == 2
    assert outcome.out == ""
    assert f"{study / 'study.toml'}:21: region.rubber.parameters.k.upper: '3 apples'" in outcome.err
    assert 'use e.g. "10 MPa"' in outcome.err
    assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("content", "message"), [("1 0\n1.5 nan\n2 1\n", "nan"), ("1 0\n1.5 x\n", "row 2"), ("", "0 rows")]
)
def test_a_bad_curve_ends_with_2_and_writes_nothing(
    call: Call, study: Path, content: str, message: str
) -> None:
    (study / "s2.txt").write_text(content)
    outcome = call("run", study)
    assert outcome.code == 2
    assert message in outcome.err
    assert "s2" in outcome.err
    assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('loader = "lines"', 'loader = "clumsy"', "s1.txt: 'clumsy'"),
        ("seed = 3", 'seed = 3\nsampler = "clumsy"', "drawing the design: 'clumsy'"),
        (
            "seed = 3",
            'seed = 3\nsampler = "leaves"',
            "'leaves' cannot be made from these settings: SystemExit",
        ),
        ("[solver]", "[sampling.filters.clumsy]\n[solver]", "filtering the design: 'clumsy'"),
    ],
)
def test_a_component_that_raises_is_named_and_ends_with_2(
    call: Call, study: Path, old: str, new: str, message: str
) -> None:
    edit(study, old, new)
    outcome = call("run", study)
    assert outcome.code == 2
    assert message in outcome.err
    assert "Error: " in outcome.err or "SystemExit: 0" in outcome.err
    assert not Path("runs").exists()


def test_no_set_that_works_ends_with_1_and_the_reason(call: Call, study: Path) -> None:
    edit(study, "closed_form", "never_works")
    outcome = call("run", study)
    assert outcome.code == 1
    assert "no equilibrium" in outcome.err or "diverged" in outcome.err
    assert "Traceback" not in outcome.err


def test_a_bug_is_a_traceback_and_70(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    from palpate.stages import pipeline

    def buggy(*_: object, **__: object) -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(pipeline, "run_study", buggy)
    outcome = call("run", TOY)
    assert outcome.code == 70
    assert "Traceback" in outcome.err
    assert "ZeroDivisionError: a bug" in outcome.err


def test_a_bug_in_a_command_of_a_plugin_has_its_line(call: Call, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "from palpate.api import hookimpl\n"
        "from palpate.api.cli import Command\n"
        "def faulty() -> None:\n"
        "    raise ZeroDivisionError('a bug')\n"
        "@hookimpl\n"
        "def palpate_commands():\n"
        "    return [Command(function=faulty)]\n"
    )
    outcome = call("faulty", plugin=str(file))
    assert outcome.code == 70
    assert f"a bug of palpate or of a plugin (line 4 of {file})" in outcome.err


def test_ctrl_c_ends_with_130_and_names_the_command_to_continue(
    call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    from palpate.stages import pipeline

    def stopped(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(pipeline, "run_study", stopped)
    outcome = call("run", TOY)
    assert outcome.code == 130
    assert "the same command continues from there" in outcome.err


@pytest.mark.slow
def test_a_process_ends_with_the_code(study: Path, tmp_path: Path) -> None:
    edit(study, '"closed_form"', '"clsed_form"')
    done = subprocess.run(
        [sys.executable, "-m", "palpate", "check", str(study), "--plugin", PLUGIN],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env={**os.environ, "NO_COLOR": "1"},
    )
    assert done.returncode == 2
    assert "did you mean 'closed_form'" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


# ----------------------------------------------------------------------- run


@pytest.mark.slow
def test_run_prints_results_to_stdout_and_progress_to_stderr(call: Call, study: Path) -> None:
    outcome = call("run", study, "--out", "here")
    assert outcome.code == 0
    assert "SIMULATED" in outcome.out
    assert re.search(r"fit: \d+ of \d+: \d+ ok", outcome.err)
    assert " ok" not in outcome.out
    assert Path("here/report").is_dir()
    assert Path("here/design.parquet").is_file()


LABELS = ["Conclusion", "Parameters", "Assumed", "True", "Warnings", "Next", "Time", "Page"]


@pytest.mark.slow
@pytest.mark.usefixtures("one_figure")
def test_a_run_ends_with_its_lines_after_the_tables_that_are_asked_for(call: Call, study: Path) -> None:
    edit(study, '"3 MPa"', '"2.0 MPa"')  # the truth is at the end of the range
    found = call("run", study, "--json").json
    plain, whole = call("run", study), call("report", study, "--tables")
    for lines in (plain.out.splitlines(), whole.out.splitlines()[-len(LABELS) :]):
        assert [line.split()[0] for line in lines] == LABELS
        said = dict(line.split(maxsplit=1) for line in lines)
        (k,) = found["intervals"]
        shown = re.match(r"k = (\d+) kPa \((\d+) to (\d+), ", said["Parameters"])
        wanted = pytest.approx([k["value"], k["lower"], k["upper"]], abs=5.0)  # two digits of the width
        assert list(map(float, shown.groups())) == wanted
        assert k["level"] == 0.95
        assert k["lower"] <= 2000.0 <= k["upper"] + 1e-6
        whats = [warning.partition(". ")[0] for warning in found["warnings"]]
        assert whats
        assert re.sub(r" \[[a-z-]+\]", "", said["Warnings"]).endswith(f": {'; '.join(whats)}")
        assert said["Warnings"].startswith(str(len(whats)))
        assert re.search(r"\d+ simulations, of which \d+ by the fit\.", said["Time"])
        assert said["Page"] == Path("runs/toy/report/index.html").resolve().as_uri()
    assert "distance to truth" in whole.out
    assert len(plain.out.splitlines()) == len(LABELS)


@pytest.mark.slow
@pytest.mark.usefixtures("one_figure")
def test_a_set_that_does_not_fit_has_no_parameters(call: Call, study: Path) -> None:
    for name in ("s1.txt", "s2.txt"):
        (study / name).write_text("1 0\n1.2 -1\n1.5 -2\n2 -3\n")
    said = dict(line.split(maxsplit=1) for line in call("run", study).out.splitlines())
    assert "No parameters can be read from this run: the best set does not fit pull at " in said["Conclusion"]
    assert said["Parameters"] == "none, for the reason above"
    assert call("report", study, "--json").json["intervals"] == []


# ---------------------------------------------------------------- init, demo


# ------------------------------------------------------------------- plugins


def test_settings_of_nested_tables_are_listed(call: Call) -> None:
    (entry,) = call("plugins", "loaders", "robot_log", "--json", plugin=None).json["loaders"]
    rows = {row["name"]: row for row in entry["settings"]}
    assert rows["onset"] == {
        "name": "onset",
        "type": "table",
        "default": None,
        "required": False,
        "description": "First contact.",
    }
    assert (rows["onset.exponent"]["type"], rows["onset.exponent"]["default"]) == ("number", 1.5)
    assert rows["gravity.weight"]["type"] == "quantity, such as '10 N' | null"
    assert {"channels.wrench_frame", "channels.plausible.lever", "channels.max_gap"} <= set(rows)
    (entry,) = call("plugins", "loaders", "csv", "--json", plugin=None).json["loaders"]
    rows = {row["name"]: row for row in entry["settings"]}
    assert rows["channels"]["default"]["torque"]["ordinate"] == {"name": "torque_Nmm"}
    assert rows["channels.<name>.ordinate.scale"]["default"] is None
    assert not any("$" in row["type"] for row in rows.values())


def test_next_commands_on_paths_with_blanks_can_be_pasted(call: Call) -> None:
    """Each parses back to its paths: of a study, of one stage in a run, of a file to inspect."""
    rows = "".join(f"{0.1 * k:.1f},{0.01 * k**1.5:.4f}\n" for k in range(31))
    Path("my press.csv").write_text(f"Depth (mm),Load (N)\n{rows}", encoding="utf-8")
    study = ("my arm", "--out", "runs/my arm")
    for arguments, expected in (
        (("init", "--study", "toy", "my arm"), ["check", "my arm"]),
        (("check", "my arm"), ["run", "my arm"]),
        (("sample", *study), [*study]),
        (("experiment", *study), [*study]),
        (("simulate", *study), ["score", *study]),
        (("experiment", "inspect", "my press.csv"), ["--measured", "my press.csv", "--mesh", "MESH"]),
    ):
        outcome = call(*arguments)
        assert outcome.code == 0, outcome.err
        (words,) = re.findall(r"next: palpate (.*)", outcome.err)
        assert shlex.split(words)[-len(expected) :] == expected


def test_commands_in_refusals_on_paths_with_blanks_can_be_pasted(call: Call) -> None:
    call("init", "--study", "toy", "my arm")
    call("init", "--study", "toy", "other arm")
    study = ("my arm", "--out", "runs/my arm")
    refusals = [call("score", *study).err, call("simulate", *study).err]
    call("sample", *study)
    text = Path("my arm/study.toml").read_text(encoding="utf-8")
    refusals += [call("sample", "other arm", "--out", "runs/my arm").err, call("check", "runs/my arm").err]
    Path("my arm/study.toml").write_text(text.replace("seed = 3", "seed = 4"), encoding="utf-8")
    refusals.append(call("simulate", *study).err)
    found = [re.findall(r"`palpate ([^`]*)`|: palpate (.*)", refusal) for refusal in refusals]
    for refusal, commands in zip(refusals, found, strict=True):
        assert commands, refusal
        for words in map(shlex.split, map("".join, commands)):
            assert not {"arm", "my", "other"} & {*words}, refusal


def test_no_page_shows_other_curves_than_those_of_the_run(call: Call) -> None:
    call("init", "--study", "toy", "arm")
    assert call("experiment", "arm", "--out", "run").code == 0
    page = Path("run/measured/curves.html")
    page.write_text("curves", encoding="utf-8")
    assert call("experiment", "arm", "--out", "run").code == 0
    assert page.is_file()
    curve = Path("arm/s1.txt")
    curve.write_text(curve.read_text(encoding="utf-8").replace("1.1 0.21", "1.1 0.22"), encoding="utf-8")
    assert call("experiment", "arm", "--out", "run").code == 0
    assert not page.exists()
