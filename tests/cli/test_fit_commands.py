"""The fit on the command line: without a sweep, stage by stage, and where it fails."""

import json
import re
import signal
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from palpate.cli.progress import StageProgress
from palpate.run.directory import RunDirectory
from palpate.run.ledger import Ledger

from .test_json_output import valid

pytestmark = pytest.mark.usefixtures("one_figure")


@pytest.fixture
def without_sweep(study):
    """Toy study that fits from the ranges alone."""
    path = study / "study.toml"
    text = path.read_text().replace("n_sets = 20", "n_sets = 0")
    path.write_text(text.replace("a = 0.5", 'a = { lower = "0", upper = "0.8" }'))
    return study


@pytest.mark.slow
def test_every_command_works_without_a_sweep(call, without_sweep, tmp_path):
    assert call("check", without_sweep, "--json").json["n_sets"] == 0
    ran = call("run", without_sweep, "--json")
    assert ran.code == 0, ran.err
    assert (ran.json["n_sets"], ran.json["selection"]) == (0, [])
    assert ran.json["n_simulations"] == call("status", "runs/toy", "--json").json["n_simulations"] > 0
    joint = [row for row in ran.json["fit"] if row["fit"] == "all spots"]
    assert [row["rubber.k [kPa]"] for row in joint] == pytest.approx([2000.0, 2000.0], rel=1e-3)
    before = {path.name: path.read_bytes() for path in (tmp_path / "runs" / "toy").glob("*.parquet")}
    again = call("run", "runs/toy", "--json", "--trust-plugins", plugin=None)
    assert (again.code, again.json["fit"]) == (0, ran.json["fit"])
    assert before == {path.name: path.read_bytes() for path in (tmp_path / "runs" / "toy").glob("*.parquet")}
    assert call("status", "runs/toy").code == 0
    for stage in ("experiment", "sample", "simulate", "score", "select", "fit", "report"):
        outcome = call(stage, without_sweep, "--out", "apart")
        assert outcome.code == 0, (stage, outcome.err)
    alone = call("fit", without_sweep, "--out", "apart", "--json").json["fit"]
    # A run shows the reported values, which the intervals find; a fit alone has the least Fopt.
    for row, of_run in zip(alone, ran.json["fit"], strict=True):
        assert [row[key] for key in ("fit", "scenario", "spot")] == [
            of_run[key] for key in ("fit", "scenario", "spot")
        ]
        assert row["rubber.k"] == pytest.approx(0.001 * of_run["rubber.k [kPa]"], rel=1e-6)
    more = call("run", without_sweep, "--sets", "8", "--out", "more", "--json")
    assert (more.code, more.json["n_sets"]) == (0, 8)
    assert more.json["n_simulations"] > 8


@pytest.mark.slow
def test_posteriors_of_a_fit_are_drawn_and_kept(call, without_sweep, tmp_path):
    pytest.importorskip("emcee")
    early = call("certainty", without_sweep)
    assert early.code == 2
    assert f" run {without_sweep}`" in early.err
    assert "run `palpate --plugin " in early.err
    assert call("run", without_sweep).code == 0
    drawn = call("certainty", without_sweep, "--json")
    valid("certainty", drawn.json)
    assert drawn.code == 0, drawn.err
    run = RunDirectory(tmp_path / "runs" / "toy")
    assert run.table("posterior").to_dicts() == drawn.json["posterior"]
    assert run.table("volumes")["ratio"].to_list()[0] == 1.0
    assert call("certainty", without_sweep, "--json").json["posterior"] == drawn.json["posterior"]
    run.write_stage("intervals", {}, {})
    assert not run.records.is_current("certainty")


@pytest.mark.parametrize(
    ("n_sets", "more", "expected"),
    [
        (0, '[fit]\nsearch = "sweep"', "sampling.n_sets: no set to choose from with fit.search = 'sweep'"),
        (1, "", "sampling.n_sets: one set is no sweep; give 2 or more, or 0"),
        (-1, "", "must be greater than or equal to 0"),
    ],
)
def test_what_needs_a_sweep_is_refused_without_one(call, study, n_sets, more, expected):
    path = study / "study.toml"
    path.write_text(path.read_text().replace("n_sets = 20", f"n_sets = {n_sets}") + more)
    refused = call("run", study)
    assert refused.code == 2
    assert re.search(rf"study\.toml:\d+: .*{re.escape(expected)}", refused.err), refused.err


@pytest.mark.slow
def test_a_first_look_needs_no_sets_in_the_study_and_the_larger_run_keeps_it(call, study):
    path = study / "study.toml"
    path.write_text(path.read_text().replace("n_sets = 20", "n_sets = 0") + '[fit]\nsearch = "sweep"')
    assert call("check", study).code == 2
    look = call("run", study, "--sets", 12, "--json")
    assert (look.code, look.json["n_sets"], look.json["n_simulations"]) == (0, 12, 12)
    folder = Path("runs") / "toy"
    kept = attempts(folder)
    more = call("run", study, "--sets", 20, "--json")
    assert (more.code, more.json["n_sets"]) == (0, 20)
    with Ledger(folder) as ledger:
        assert len(ledger.seconds()) == 20  # both spots have the same tests
    assert set(kept) < set(attempts(folder))
    assert call("run", folder, "--json").json["n_sets"] == 20
    assert call("report", folder).code == 0


@pytest.fixture
def press(monkeypatch):
    """Press Ctrl-C so many times at the first step of the fit."""
    at, places = StageProgress.at, []

    def arrange(presses):
        def pressing(self, text):
            at(self, text)
            places.append(text)
            for _ in range(presses if len(places) == 1 else 0):
                signal.raise_signal(signal.SIGINT)

        monkeypatch.setattr(StageProgress, "at", pressing)

    return arrange


@pytest.mark.slow
@pytest.mark.parametrize(
    ("presses", "expected"),
    [(1, "stopped with 6 simulations finished and kept"), (2, "stopped in stage 'fit'; finished")],
)
def test_ctrl_c_in_the_fit_is_shown_by_status_and_resumes_to_the_same_bytes(
    call, without_sweep, tmp_path, press, presses, expected
):
    assert call("run", without_sweep, "--out", "whole").code == 0
    assert call("status", "whole", "--json").json["fit"] is None
    press(presses)
    stopped = call("run", without_sweep, "--out", "stopped")
    assert stopped.code == 130
    assert re.search(expected, stopped.err), stopped.err
    state = call("status", "stopped", "--json").json["fit"]
    assert (state["fit"], state["scenario"]) == ("all spots", "pull only")
    assert state["n_simulations"] == 6
    shown = call("status", "stopped")
    assert re.search(r"fit: all spots, scenario pull only: step \d, Fopt .*; not running", shown.out)
    assert "next: palpate" in shown.err
    resumed = call("run", "stopped", "--trust-plugins", plugin=None)
    assert resumed.code == 0, resumed.err
    assert tables(tmp_path / "stopped") == tables(tmp_path / "whole")
    assert call("status", "stopped", "--json").json["fit"] is None
    with Ledger(tmp_path / "stopped") as ledger:
        assert ledger.frame()["n_attempts"].max() == 1


@pytest.mark.slow
def test_a_second_run_and_a_second_fit_simulate_nothing(call, study, ran):
    before = (tables(ran), attempts(ran))
    for command in ("run", "fit"):
        assert call(command, study).code == 0
        assert (tables(ran), attempts(ran)) == before


def tables(folder):
    return {path.name: path.read_bytes() for path in folder.glob("*.parquet")}


def attempts(folder):
    with Ledger(folder) as ledger:
        return ledger.frame().rows()


PLUGIN = """
import numpy as np
from palpate import hookimpl
from palpate.plugins.parametrisation import Parametrisation, SpotInputs
from palpate.plugins.search import Search, Trial

class Wrong(Search):
    name, summary = "wrong", "of a test"
    def search(self, space):
        {asks}

class Bare(Parametrisation):
    name, summary = "bare", "of a test"
    def parameters(self, space, spots):
        {searches}
    def inputs(self, space, spot, protocol, values):
        {gives}

@hookimpl
def palpate_searches():
    return [Wrong]

@hookimpl
def palpate_parametrisations():
    return [Bare]
"""
RIGHT = {
    "asks": "yield [Trial(point=space.start)]",
    "searches": "return space.parameters",
    "gives": "return SpotInputs(thetas=space.thetas(np.array(list(values.values()))), protocol=protocol)",
}
MID = "yield [Trial(point=space.start)]; yield [Trial(point=0.9 * space.start)]; raise KeyError('gone')"


@pytest.fixture
def with_plugin(without_sweep):
    """Toy study with a search and a parametrisation of its own."""

    def write(**wrong):
        (without_sweep / "own.py").write_text(PLUGIN.format(**{**RIGHT, **wrong}))
        path = without_sweep / "study.toml"
        text = path.read_text().replace("[study]", '[study]\nplugins = ["own.py"]')
        path.write_text(f'{text}\n[fit]\nsearch = "wrong"\nparametrisation = "bare"\n')
        return without_sweep

    return write


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wrong", "key", "message"),
    [
        ({"asks": "yield from self.gone"}, "search", "raised AttributeError"),
        ({"asks": "return 5"}, "search", "raised TypeError"),
        ({"asks": "return 'bored'\n        yield"}, "search", "no trial"),
        ({"asks": "yield [Trial(point=space.start + 1.0)]"}, "search", "which is no point of the unit box"),
        ({"asks": "yield 'middle'"}, "search", "raised AttributeError"),
        ({"searches": "return self.gone"}, "parametrisation", "raised AttributeError"),
        ({"searches": "return space.parameters * 2"}, "parametrisation", "rubber.a, rubber.k twice"),
        ({"gives": "return self.gone"}, "parametrisation", "its inputs at spot 's1': 'bare'"),
        ({"gives": "return None"}, "parametrisation", "it gave None, not SpotInputs"),
    ],
)
def test_a_plugin_that_fails_at_the_start_is_refused_before_the_first_run(
    call, with_plugin, tmp_path, wrong, key, message
):
    study = with_plugin(**wrong)
    lines = (study / "study.toml").read_text().splitlines()
    line = 1 + next(i for i, text in enumerate(lines) if text.startswith(f"{key} = "))
    refused = call("run", study)
    assert refused.code == 2
    assert f"study.toml:{line}: fit.{key}: " in refused.err
    assert message in refused.err
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
def test_a_search_that_raises_later_leaves_its_best(call, with_plugin):
    ran = call("run", with_plugin(asks=MID), "--json")
    assert ran.code == 0, ran.err
    row = ran.json["fit"][0]
    assert row["rubber.k [kPa]"] > 0.0
    assert "'wrong' (" in row["message"]
    assert "raised KeyError: 'gone'" in row["message"]


@pytest.mark.slow
def test_a_card_is_printed_or_written_and_what_cannot_be_is_refused(call, without_sweep, tmp_path):
    assert call("run", without_sweep).code == 0
    run = ("runs/toy", "--trust-plugins")
    printed = call("card", *run, "--for", "json")
    assert printed.code == 0, printed.err
    assert json.loads(printed.out)["rubber"]["parameters"]["k"]["value"] == pytest.approx(2.0, rel=1e-3)
    assert call("card", *run, "--into", "rubber.json").code == 0
    assert (tmp_path / "rubber.json").read_text() == printed.out
    both = call("card", *run, "--into", "both.json", "--json")
    assert both.json == json.loads(printed.out)
    assert not both.json["rubber"]["verdict"].startswith("verdict")
    jsonschema.validate(both.json, call("schema", "card").json)
    assert (tmp_path / "both.json").read_text() == printed.out
    for options, expected in (
        (("--into", "rubber.json"), "exists and is not overwritten"),
        (("--for", "comsol"), "no such program; choose one of febio, abaqus, ansys, json"),
        (("--for", "abaqus"), "declares no standard energy"),
        (("--region", "bone"), "--region bone: not in the study"),
    ):
        refused = call("card", *run, *options)
        assert (refused.code, expected in " ".join(refused.err.split())) == (2, True), refused.err
    toolless = call("predict", *run)
    assert (toolless.code, "Missing option '--tool'" in toolless.err) == (2, True), toolless.err
    nowhere = call("predict", *run, "--tool", "plate.toml")
    assert (nowhere.code, "no such tool file" in nowhere.err) == (2, True), nowhere.err
    skin = call("surface", without_sweep)
    assert skin.code == 2
    assert "does not give the states of the skin" in " ".join(skin.err.split())


@pytest.mark.slow
def test_a_refused_run_has_no_card_unless_it_is_asked_for(call, without_sweep):
    for name in ("s1", "s2"):
        path = without_sweep / f"{name}.txt"
        rows = np.loadtxt(path)
        rows[:, 1] = rows[::-1, 1]  # falls where the spring's curve rises
        np.savetxt(path, rows)
    ran = call("run", without_sweep, "--json")
    assert ran.code == 0
    assert json.loads(ran.out)["model"]["verdict"] == "does not describe"
    run = ("runs/toy", "--trust-plugins")
    refused = call("card", *run)
    assert refused.code == 2
    assert refused.out == ""
    message = " ".join(refused.err.split())
    assert "No parameters can be read from this run" in message
    assert "--anyway" in message
    written = call("card", *run, "--anyway", "--for", "json")
    assert written.code == 0, written.err
    assert json.loads(written.out)["rubber"]["verdict"].startswith("WARNING: No parameters can be read")
