"""A command for each stage: what it prints, what it needs, and what to run next."""

from pathlib import Path
from typing import Any

import pytest

from palpate.run.ledger import Ledger

from .conftest import Call, edit


@pytest.mark.slow
@pytest.mark.usefixtures("one_figure")
def test_the_stages_one_by_one_choose_what_run_chooses(call: Call, study: Path) -> None:
    whole = call("run", study, "--json").json
    assert whole["folder"] == "runs/toy"
    assert abs(whole["generalisation"][0]["rubber.k"] - 2.0) < 0.15
    results: dict[str, Any] = {}
    stages = ("experiment", "sample", "simulate", "score", "select", "fit", "intervals", "identifiability")
    for stage in (*stages, "report"):
        outcome = call(stage, study, "--out", "apart", "--json")
        assert outcome.code == 0, outcome.err
        results[stage] = outcome.json
    assert results["experiment"][0] == {
        "spot": "s1", "channel": "pull", "n_points": 11, "n_presses": 1, "over": "1 to 2",
        "least": 0.0, "largest": 3.0, "unit": "MPa", "largest_std": None,
    }  # fmt: skip
    assert len(results["sample"]["design"]) == 20
    assert results["simulate"] == {"ok": 40}
    assert len(results["score"]["scores"]) >= 40
    assert results["score"]["warnings"] == results["select"]["warnings"] == []
    assert results["report"]["warnings"] == whole["warnings"]
    assert results["report"]["conclusion"] == whole["conclusion"]
    assert results["select"]["selection"] == whole["selection"]
    assert results["select"]["generalisation"] == whole["generalisation"]
    assert any(file.endswith(".svg") for file in results["report"]["files"])


@pytest.mark.slow
@pytest.mark.usefixtures("one_figure")
def test_a_scenario_without_a_set_ends_with_1_after_the_results(
    call: Call, study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from palpate.stages import core_stages
    from palpate_report.data import report_data

    missing = {("s1", "pull only"): "unreadable: a turn too many"}
    for module in (core_stages, report_data):
        monkeypatch.setattr(module, "without_result", lambda *_: missing)
    expected = "no set could be selected at s1, scenario pull only; reason: unreadable: a turn too many"
    for command in ("run", "select", "report"):
        outcome = call(command, study)
        assert outcome.code == 1
        assert expected in outcome.err
        assert outcome.out
    outcome = call("run", study, "--json")
    assert outcome.code == 1
    assert outcome.json["warnings"][0].startswith("No result for 1 of 2 spots and scenarios")


@pytest.mark.parametrize("stage", ["simulate", "score", "select", "report"])
def test_a_stage_without_its_input_names_what_to_run_first(call: Call, study: Path, stage: str) -> None:
    outcome = call(stage, study)
    assert outcome.code == 2
    assert "palpate" in outcome.err


def test_a_single_job_shows_its_traceback(call: Call, study: Path) -> None:
    edit(study, "closed_form", "raises")
    for stage in ("experiment", "sample", "simulate"):
        assert call(stage, study, "--out", "o").code == 0
    shown = call("simulate", study, "--out", "o", "--only", "s1/1", "--traceback")
    assert shown.code == 1
    assert "crashed" in shown.out
    assert 'raise ZeroDivisionError("a layer of no thickness")' in shown.err
    fine = call("simulate", study, "--out", "o", "--only", "s1/2", "--json")
    assert (fine.code, fine.json) == (0, {"ok": 1})
    with Ledger(Path("o")) as ledger:
        kept = ledger.frame().filter(state="crashed")
    assert "in simulate" in kept["diagnostics"][0]  # the traceback of the sweep's own worker
    for wrong in (["--only", "s9/1"], ["--only", "s1/99"], ["--only", "s1"], ["--traceback"]):
        refused = call("simulate", study, "--out", "o", *wrong)
        assert (refused.code, refused.err.count("\n")) == (2, 1), wrong


def test_a_stage_in_a_new_run_names_what_the_next_one_lacks(call: Call, study: Path) -> None:
    assert call("sample", study).err.endswith(f" experiment {study}\n")
    assert call("experiment", study).err.endswith(f" simulate {study}\n")
    assert call("sample", study, "--out", "o").err.endswith(f" experiment {study} --out o\n")


def test_a_study_may_have_the_name_of_a_command(call: Call, study: Path) -> None:
    study.rename("study")
    assert "Measured curves" in call("experiment", "study").out
    assert "No limb" in call("limb", "study").out


@pytest.mark.slow
def test_stages_for_people_end_with_the_command_to_run_next(call: Call, study: Path) -> None:
    following = {"experiment": "sample", "sample": "simulate", "simulate": "score", "score": "select"}
    for stage, then in following.items():
        assert call(stage, study).err.endswith(f" {then} {study}\n")
    assert "Selection" in call("select", study).out


def test_limb_shows_meshes_or_reports_that_there_are_none(call: Call, study: Path) -> None:
    shown = call("limb", study)
    assert ("No limb" in shown.out, "limb …" in shown.err) == (True, True)
    assert call("limb", study, "--json").json == []


def test_limb_of_another_file_names_the_files_that_it_takes(call: Call, tmp_path: Path) -> None:
    for name, said in (
        ("limb.dat", "nor a file that a plugin makes a mesh of (.glb, .obj, .off, .ply, .stl)"),
        ("limb.vtu", "a mesh and no study; to look into it: palpate limb inspect limb.vtu"),
    ):
        (tmp_path / name).write_text("<VTKFile/>")
        outcome = call("limb", name)
        assert outcome.code == 2
        assert said in outcome.err


def test_limb_of_a_surface_is_meshed_or_refused_by_the_reader(call: Call, tmp_path: Path) -> None:
    (tmp_path / "x.stl").write_text("solid x\nendsolid x\n")
    outcome = call("limb", "x.stl", "--into", "m", plugin=None)
    assert (outcome.code, "No such option" in outcome.err) == (2, False)
    assert "palpate: x.stl: " in outcome.err
