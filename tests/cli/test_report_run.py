"""``palpate report RUN``: from what the run directory holds, wherever the study and its files are."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.cli.session import Session
from palpate.errors import StoppedError
from palpate.executors import InProcess
from palpate.progress import Progress
from palpate.run.ledger import Ledger
from palpate.run.lock import locked
from palpate.stages import pipeline

from .conftest import PLUGIN

pytestmark = pytest.mark.usefixtures("one_figure")


MESHED = """
import numpy as np
from palpate import Curve, Provides, Response, Simulation, Solver, Status, hookimpl
class Meshed(Solver):
    name, summary = "meshed", "Wants a mesh, and does nothing with it"
    provides = Provides(channels=("pull",))
    def simulate(self, job, limb):
        (theta,), x = job.thetas.values(), np.linspace(1.0, 2.0, 11)
        curve = Curve(channel="pull", abscissa=x, ordinate=theta[0] * (x - 1.0))
        return Simulation(job=job, status=Status.OK, response=Response(curves={"pull": curve}))
@hookimpl
def palpate_solvers(): return [Meshed]
"""
PROTOCOL = """
[protocol]
indenter = { shape = "sphere", radius = "1 mm" }
depth = "2 mm"
friction = 0.0

[limb]
source = "block"
"""


@pytest.fixture
def with_limb(study, monkeypatch):
    """Toy study whose solver wants a mesh at each of its two spots."""
    monkeypatch.setattr("palpate.limb.loading.check_limb", lambda *_, **__: None)
    monkeypatch.setattr("palpate.limb.loading.check_depth", lambda *_: None)
    path = study / "study.toml"
    text = path.read_text().replace('"closed_form"', '"meshed"').replace("n_sets = 20", "n_sets = 4")
    for name in ("s1", "s2"):
        text = text.replace(f'name = "{name}"\n', f'name = "{name}"\nmesh = "{name}.mesh"\n')
        (study / f"{name}.mesh").write_text("a block")
    path.write_text(text + PROTOCOL)
    (study.parent / "meshed.py").write_text(MESHED)
    return study


def tables(run):
    return {path.name: path.read_bytes() for path in (run / "report" / "tables").iterdir()}


@pytest.mark.slow
def test_a_received_run_is_reported_without_its_study(call, with_limb, tmp_path):
    ran = call("run", with_limb, "--out", "run", "--plugin", "meshed.py")
    assert ran.code == 0, ran.err
    before = tables(tmp_path / "run")
    (with_limb / "s1.mesh").unlink()
    (with_limb / "s2.txt").unlink()
    refused = call("report", with_limb, "--out", "run", "--plugin", "meshed.py")
    assert refused.code == 2
    made = call("report", "run", "--plugin", "meshed.py")
    assert made.code == 0, made.err
    assert "no limb is shown at spot 's1': its mesh is missing" in made.err
    assert "spot 's2'" not in made.err
    assert tables(tmp_path / "run") == before
    shutil.rmtree(with_limb)
    shutil.move(tmp_path / "run", tmp_path / "received")
    shutil.rmtree(tmp_path / "received" / "report")
    made = call("report", "received", "--json", "--plugin", "meshed.py")
    assert made.code == 0, made.err
    assert made.json["files"]
    assert tables(tmp_path / "received") == before


@pytest.mark.slow
def test_a_received_run_is_reported_with_plugins_that_are_trusted(call, ran):
    refused = call("report", "runs/toy", plugin=None)
    assert refused.code == 2
    assert "--trust-plugins" in refused.err
    assert " report runs/toy" in refused.err
    assert call("report", "runs/toy", "--trust-plugins", plugin=None).code == 0
    (ran / "study.toml").unlink()
    assert "study.toml" in call("report", "runs/toy").err


@pytest.mark.slow
def test_the_report_of_a_run_is_of_its_tables(call, study, ran):
    """An edited study does not change what a finished run is reported as."""
    before = tables(ran)
    path = study / "study.toml"
    path.write_text(path.read_text().replace("seed = 3", "seed = 4"))
    assert call("report", ran).code == 0
    assert tables(ran) == before
    call("sample", study)
    stale = call("report", ran)
    assert stale.code == 2
    assert "made before a change of" in stale.err
    assert json.loads((ran / "manifest.json").read_text())["seed"] == 4


class StopsAfter(Progress):
    """Asks to stop once a number of steps of the stages that simulate are done."""

    def __init__(self, n_steps):
        self.n_left, self.has_begun = n_steps, False

    def begin(self, stage, total):
        self.has_begun |= stage in ("simulate", "fit")

    def step(self, note=""):
        self.n_left -= 1

    def should_continue(self):
        return not self.has_begun or self.n_left > 0


@pytest.mark.slow
def test_the_page_of_a_run_that_has_not_ended_shows_what_is_there(call, study, tmp_path):
    session = Session([Path(PLUGIN)])
    stopping = replace(session.study(study), executor=InProcess())
    with pytest.raises(StoppedError):
        pipeline.run_study(stopping, tmp_path / "runs" / "toy", session.plugins, StopsAfter(9))
    stopped = call("report", "runs/toy", "--json")
    assert stopped.code == 0, stopped.err
    assert stopped.json["warnings"][0].startswith("The run has not ended. So far: ")
    n_done, _, n_all = stopped.json["warnings"][0].removeprefix("The run has not ended. So far: ").split()[:3]
    assert (0 < int(n_done) < 20, n_all) == (True, "20")
    assert stopped.json["intervals"][0]["level"] is None
    with locked(tmp_path / "runs" / "toy"):
        during = call("report", "--json")  # the newest in runs/
        assert during.json == stopped.json
        assert "in use by process" in call("report", study).err
    assert call("run", "runs/toy").code == 0
    whole = call("report", "runs/toy", "--json").json
    assert not any("not ended" in warning for warning in whole["warnings"])
    assert whole["intervals"][0]["level"] == 0.95
    assert whole["intervals"][0]["verdict"] in (
        "well",
        "roughly",
        "poorly",
        "not identified",
        "unclear",
        "refused",
    )


@pytest.mark.slow
@pytest.mark.parametrize("n", [8, 12])
def test_a_stopped_fit_without_a_sweep_shows_how_far_it_is(call, study, tmp_path, n):
    path = study / "study.toml"
    text = path.read_text().replace("n_sets = 20", "n_sets = 0")
    path.write_text(text.replace("a = 0.5", 'a = { lower = "0", upper = "0.8" }'))
    session = Session([Path(PLUGIN)])
    stopping = replace(session.study(study), executor=InProcess())
    with pytest.raises(StoppedError):
        pipeline.run_study(stopping, tmp_path / "runs" / "toy", session.plugins, StopsAfter(n))
    with Ledger(tmp_path / "runs" / "toy") as ledger:
        n_known = len(ledger.seconds())
    stopped = call("report", "runs/toy", "--json")
    assert stopped.code == 0, stopped.err
    warning = stopped.json["warnings"][0]
    assert warning.startswith(f"The run has not ended. So far: {n_known} simulations; fit: ")
    assert stopped.json["next"] == "finish the run: `palpate run runs/toy`"
    assert f"{n_known} simulations so far." in stopped.json["conclusion"]
    assert not any("converged" in each for each in stopped.json["warnings"])
    assert [row["value"] > 0.0 for row in stopped.json["intervals"]] == [True, True]
    with locked(tmp_path / "runs" / "toy"):
        assert call("report", "--json").json == stopped.json
    with Ledger(tmp_path / "runs" / "toy") as ledger:
        assert len(ledger.seconds()) == n_known
    assert call("run", "runs/toy").code == 0
    assert not any("not ended" in each for each in call("report", "runs/toy", "--json").json["warnings"])


def test_a_run_before_its_first_result_has_no_page(call, study, tmp_path):
    session = Session([Path(PLUGIN)])
    stopping = replace(session.study(study), executor=InProcess())
    with pytest.raises(StoppedError):
        pipeline.run_study(stopping, tmp_path / "run", session.plugins, StopsAfter(0))
    refused = call("report", "run")
    assert (refused.code, "no simulation has ended yet" in refused.err) == (2, True)


@pytest.mark.parametrize("n", [0, 3])
def test_a_fit_before_its_first_evaluation_has_no_page(call, study, tmp_path, n):
    path = study / "study.toml"
    path.write_text(path.read_text().replace("n_sets = 20", "n_sets = 0"))
    session = Session([Path(PLUGIN)])
    stopping = replace(session.study(study), executor=InProcess())
    with pytest.raises(StoppedError):
        pipeline.run_study(stopping, tmp_path / "run", session.plugins, StopsAfter(n))
    refused = call("report", "run")
    assert (refused.code, " ended" in refused.err) == (2, True), refused.err


@pytest.mark.slow
def test_run_and_study_mean_the_same_in_each_command(call, study, ran):
    ran.rename(ran.parent / "elsewhere")
    folders = [call(*command, "--json").json["folder"] for command in (["status", study], ["status"])]
    assert folders == ["runs/elsewhere"] * 2
    for named in ([study], ["runs/elsewhere"], [], ["--out", "runs/elsewhere"]):
        files = call("report", *named, "--json").json["files"]
        assert {Path(file).parts[:2] for file in files} == {("runs", "elsewhere")}, named
    for command in ("experiment", "score", "fit"):
        assert call(command, "runs/elsewhere", "--json").code == 0, command
    assert not Path("runs/toy").exists()
    for command in ("check", "synthesise"):
        refused = call(command, "runs/elsewhere")
        assert (refused.code, "a run directory, not a study" in refused.err) == (2, True), command


@pytest.mark.slow
def test_the_page_is_opened_where_that_is_asked_for(call, study, monkeypatch):
    opened = []
    monkeypatch.setattr("typer.launch", opened.append)
    call("run", study)
    assert opened == []
    assert call("report", "--open").code == 0
    assert opened == [Path("runs/toy/report/index.html").resolve().as_uri()]


@pytest.mark.slow
def test_a_run_without_the_plugin_of_the_report_ends_with_what_was_found(call, study):
    outcome = call("--no-plugin", "report", "run", study, "--json")
    assert outcome.code == 0, outcome.err
    assert 1000.0 < outcome.json["generalisation"][0]["rubber.k [kPa]"] < 3000.0
    assert "conclusion" not in outcome.json
    assert not (Path("runs") / "toy" / "report").exists()
    again = call("--no-plugin", "report", "run", study)
    assert again.code == 0
    assert "Time" in again.out
