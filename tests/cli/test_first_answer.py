"""First answer of a run, and the page that a stopped run leaves."""

import json
import re
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest

from palpate.cli.session import Session
from palpate.errors import StoppedError
from palpate.executors import InProcess
from palpate.progress import Progress
from palpate.stages import core_stages, pipeline
from palpate.stages.saved_run import open_run
from palpate_report.stage import ReportStage

from .conftest import PLUGIN, edit

pytestmark = pytest.mark.usefixtures("one_figure")
RUN = Path("runs") / "toy"


@pytest.fixture
def unswept(study):
    edit(study, "n_sets = 20", "n_sets = 0")
    return study


def written_page(lines):
    page = (RUN / "report" / "index.html").read_text()
    assert page.startswith("<!doctype html>")
    assert page.rstrip().endswith("</html>")
    assert lines == json.loads((RUN / "report" / "result.json").read_text())
    return page


def test_a_quick_run_stops_at_the_first_answer_and_goes_on_later(call, unswept):
    quick = call("run", unswept, "--quick")
    assert quick.code == 0, quick.err
    first = quick.err.partition("first answer: ")[2].partition("\n")[0]
    assert re.search(r"= .*; the whole run may change it", first)
    assert not re.search("unclear|effective|refused", first)
    assert "next: palpate " in quick.err
    assert " to " in quick.out.partition("Parameters")[2]  # the ends of an interval
    lines = json.loads((RUN / "report" / "result.json").read_text())
    assert "first answer, the run has not ended" in lines["Conclusion"]
    assert "First answer" in written_page(lines)
    again = call("report", RUN)
    assert "first answer, the run has not ended" in again.out
    assert json.loads((RUN / "report" / "result.json").read_text())["Parameters"] == lines["Parameters"]
    assert "First answer: intervals by linearisation" in (RUN / "report" / "index.html").read_text()
    n_quick = call("status", RUN, "--json").json["n_finished"]
    assert not (RUN / "intervals.parquet").exists()
    whole = call("run", RUN, "--json")
    assert whole.code == 0, whole.err
    assert whole.json["n_simulations"] > n_quick
    assert not whole.json["is_first_answer"]
    assert not any("not ended" in each for each in whole.json["warnings"])
    status = call("status", RUN, "--json").json
    assert "first answer" in [row["stage"] for row in status["cost"]]
    assert not status["is_first_answer"]
    # The page of the whole run stays.
    quick = call("run", RUN, "--quick")
    assert quick.code == 0
    assert "--quick is ignored: the run is complete" in quick.err
    whole_lines = json.loads((RUN / "report" / "result.json").read_text())
    assert "not ended" not in written_page(whole_lines)
    assert (RUN / "intervals.parquet").exists()


def test_a_quick_run_without_a_fit_is_refused(call, unswept):
    with (unswept / "study.toml").open("a") as file:
        file.write('\n[fit]\nsearch = "sweep"\n')
    refused = call("run", unswept, "--quick")
    assert (refused.code, "fit.search is 'sweep'" in refused.err) == (2, True), refused.err
    assert not RUN.exists()


def test_json_has_the_first_answer_and_says_so(call, unswept):
    quick = call("run", unswept, "--quick", "--json")
    assert quick.code == 0, quick.err
    jsonschema.validate(quick.json, call("schema", "run").json)
    assert quick.json["is_first_answer"]
    (first,) = [row for row in quick.json["intervals"] if row["parameter"] == "k"]
    assert first["lower"] < first["value"] < first["upper"]
    status = call("status", RUN, "--json").json
    jsonschema.validate(status, call("schema", "status").json)
    assert status["is_first_answer"]
    assert "first answer" in status["result"]["Conclusion"]
    assert [row["parameter"] for row in status["intervals"]] == ["rubber.k"]


@pytest.mark.parametrize("n_sets", [0, 20])
def test_everything_reads_the_first_answer_of_a_quick_run(call, study, n_sets):
    edit(study, "n_sets = 20", f"n_sets = {n_sets}")
    assert call("run", study, "--quick").code == 0
    lines = json.loads((RUN / "report" / "result.json").read_text())
    opened = open_run(RUN, Session([Path(PLUGIN)]).plugins)
    row = opened.answer.row(0, named=True)
    assert row["source"] == "first answer"
    assert row["lower"] < row["value"] < row["upper"]
    assert (opened.headline.source, opened.headline.is_fit) == ("first answer", True)
    card = call("card", RUN)
    assert (card.code, "first answer" in card.out) == (0, True), card.err
    planned = call("next", RUN)
    assert (planned.code, "has a first answer alone" in planned.err) == (2, True), planned.err
    assert "`palpate run runs/toy`" in planned.err
    assert call("report", RUN).code == 0
    assert json.loads((RUN / "report" / "result.json").read_text())["Parameters"] == lines["Parameters"]
    assert call("run", RUN).code == 0
    assert set(open_run(RUN, Session([Path(PLUGIN)]).plugins).answer["source"]) == {"fit"}
    assert not any((RUN / "first_answer").iterdir())


def test_a_run_directory_that_does_not_exist_is_named_as_such(call):
    refused = call("status", "nope")
    assert (refused.code, "nope: no such folder" in refused.err) == (2, True), refused.err


class Stopping(Progress):
    """Starts no simulation from a stage on."""

    def __init__(self, stage):
        self.stage, self.is_there = stage, False

    def begin(self, stage, total):
        self.is_there = self.is_there or stage == self.stage

    def should_continue(self):
        return not self.is_there


@pytest.mark.parametrize("at", ["intervals", "contours", "answer", "report"])
def test_a_run_that_is_interrupted_between_stages_leaves_its_page(call, unswept, monkeypatch, at):
    make = pipeline._make

    def interrupted(run, stage, made_from):
        if stage.name == at:
            raise KeyboardInterrupt
        make(run, stage, made_from)

    session = Session([Path(PLUGIN)])
    study = replace(session.study(unswept), executor=InProcess())
    monkeypatch.setattr(pipeline, "_make", interrupted)
    with pytest.raises(KeyboardInterrupt):
        pipeline.run_study(study, RUN, session.plugins)
    lines = json.loads((RUN / "report" / "result.json").read_text())
    assert "the run has not ended" in written_page(lines).lower()
    assert "kPa" in lines["Parameters"]
    monkeypatch.setattr(pipeline, "_make", make)
    status = call("status", RUN)
    assert "not running" in status.out
    assert "finished" not in status.out
    assert call("status", RUN, "--json").json["result"] == {}
    again = call("run", RUN)
    assert again.code == 0
    assert "is complete" not in again.err
    assert "; finished" in call("status", RUN).out
    assert "not ended" not in written_page(json.loads((RUN / "report" / "result.json").read_text()))


def test_a_run_that_is_stopped_before_its_first_evaluation_is_stopped_all_the_same(unswept, tmp_path):
    session = Session([Path(PLUGIN)])
    study = replace(session.study(unswept), executor=InProcess())
    with pytest.raises(StoppedError):
        pipeline.run_study(study, tmp_path / "run", session.plugins, Stopping("fit"))
    assert not (tmp_path / "run" / "report" / "index.html").exists()


def test_a_run_that_is_stopped_in_the_last_simulations_of_a_stage_ends(unswept, monkeypatch, tmp_path):
    run = tmp_path / "run"
    session, progress, fit_files = Session([Path(PLUGIN)]), Stopping(""), core_stages.fit_files

    def and_stop(cases, inputs):
        progress.is_there = True
        return fit_files(cases, inputs)

    monkeypatch.setattr(core_stages, "fit_files", and_stop)
    study = replace(session.study(unswept), executor=InProcess())
    with pytest.raises(StoppedError, match="stopped after `palpate fit`"):
        pipeline.run_study(study, run, session.plugins, progress)
    assert (run / "fit.parquet").exists()
    assert not (run / "intervals.parquet").exists()
    assert "the run has not ended" in json.loads((run / "report" / "result.json").read_text())["Conclusion"]


@pytest.mark.parametrize("is_quick", [False, True])
def test_a_first_answer_that_cannot_be_shown_stops_no_run_that_goes_on(call, unswept, monkeypatch, is_quick):
    def failing(stage, inputs, first=None):
        raise OSError("no space left")

    monkeypatch.setattr(core_stages, "WORTH_SAYING_S", -1.0)
    monkeypatch.setattr(ReportStage, "show_so_far", failing)
    ended = call("run", unswept, *["--quick"] * is_quick)
    assert (ended.code, "raised OSError: no space left" in ended.err) == (2 * is_quick, True), ended.err
    assert (RUN / "intervals.parquet").exists() is not is_quick


def test_a_quick_run_whose_searches_fail_ends_as_a_whole_run(call, unswept, monkeypatch):
    monkeypatch.setattr(core_stages, "show_first_answer", lambda inputs, case: None)
    ended = call("run", unswept, "--quick")
    assert ended.code == 0, ended.err
    assert "Page" in ended.out
    assert "next: palpate run" not in ended.err
