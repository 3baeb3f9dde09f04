"""Stop and go: resume, status, a changed study, more sets."""

import json
import os
import re
import shutil
import signal
from pathlib import Path

import polars as pl
import pytest

from palpate.cli.progress import StageProgress
from palpate.errors import StoppedError
from palpate.progress import duration
from palpate.run.directory import RunDirectory
from palpate.run.ledger import Ledger
from palpate.run.lock import locked

pytestmark = pytest.mark.usefixtures("one_figure")

LABELS = ["Conclusion", "Parameters", "Warnings", "Next", "Page"]
GUIDE = Path(__file__).parents[2] / "docs" / "runs.md"
TABLES = ("scores.parquet", "selection.parquet", "generalisation.parquet", "design.parquet")


def tables(folder):
    reports = sorted((folder / "report" / "tables").iterdir())
    return {path.name: path.read_bytes() for path in [*(folder / name for name in TABLES), *reports]}


def swept(ledger):
    """Simulations of sweeps; those of fits have no number in a design."""
    return ledger.frame().filter(pl.col("set_id") >= 0)


@pytest.fixture
def press(monkeypatch):
    """Press Ctrl-C so many times while the seventh simulation is being counted."""

    def arrange(presses):
        step, steps = StageProgress.step, []

        def pressing(self, note=""):
            step(self, note)
            steps.append(note)
            if note == "ok" and steps.count("ok") == 7:
                for _ in range(presses):
                    signal.raise_signal(signal.SIGINT)

        monkeypatch.setattr(StageProgress, "step", pressing)
        return lambda: monkeypatch.setattr(StageProgress, "step", step)

    return arrange


@pytest.mark.parametrize(
    ("presses", "expected"),
    [(1, r"stopped with \d+ simulations"), (2, "simulations are kept, and the same command continues")],
)
def test_ctrl_c_stops_and_resume_gives_the_tables_of_a_run_never_stopped(
    call, study, tmp_path, whole_run, press, presses, expected
):
    handler = signal.getsignal(signal.SIGINT)
    release = press(presses)
    stopped = call("run", study, "--out", "stopped")
    release()
    assert stopped.code == 130
    assert re.search(expected, stopped.err), stopped.err
    assert signal.getsignal(signal.SIGINT) is handler
    status = call("status", "stopped", "--json").json
    assert status["running"] is None
    assert 4 <= status["n_finished"] < status["n_simulations"] == 20
    assert "next: palpate" in call("status", "stopped").err
    resumed = call("run", "stopped", "--trust-plugins", plugin=None)
    assert resumed.code == 0, resumed.err
    assert tables(tmp_path / "stopped") == tables(whole_run)
    ended = call("status", "stopped", "--json").json
    assert ended["n_finished"] == ended["n_simulations"] >= status["n_simulations"]
    assert ended["intervals"][0]["value"] == pytest.approx(2.0, rel=1e-3)


@pytest.mark.parametrize(
    ("seconds", "reported"),
    [(89.4, "89 s"), (100.0, "2 min"), (3500.0, "58 min"), (3590.0, "1 h 0 min"), (7190.0, "2 h 0 min")],
)
def test_a_time_is_shown_in_two_units_at_most(seconds, reported):
    assert duration(seconds) == reported


def test_a_signal_outside_the_sweep_stops_at_once(call, study):
    from palpate.cli.session import Session

    progress = StageProgress(Session())
    with pytest.raises(StoppedError), progress:  # noqa: PT012
        progress.begin("refine", 3)
        signal.raise_signal(signal.SIGTERM)


@pytest.mark.slow
def test_status_counts_what_is_simulated(call, ran):
    shutil.rmtree("runs/toy/report")  # a run that has not ended
    assert re.search(r"runs/toy: (\d+) simulations \(\1 ok\)", call("status", "runs/toy").out)


@pytest.mark.slow
def test_status_of_a_run_at_work_names_the_runner(call, study, ran):
    with locked(ran):
        seen = call("status", "runs/toy", "--json").json
        assert seen["running"]["pid"] == os.getpid()
        refused = call("run", study)
    assert refused.code == 2
    assert f"in use by process {os.getpid()} on " in refused.err
    assert call("status", "elsewhere").code == 2


def test_failures_are_grouped_by_reason_without_its_numbers():
    from palpate.stages.status import failures

    messages = ["step 3 of 10 at 1.5e-3 mm", "step 4 of 10 at 2 mm", "no licence", ""]
    frame = pl.DataFrame(
        {
            "key": list("abcd"),
            "spot": ["p1"] * 4,
            "set_id": [3, 4, 5, 6],
            "state": ["diverged", "diverged", "crashed", "ok"],
            "message": messages,
        }
    )
    rows = failures(frame).to_dicts()
    assert [(r["reason"], r["n"], r["example"]) for r in rows] == [
        ("step … of … at … mm", 2, "p1/3"),
        ("no licence", 1, "p1/5"),
    ]
    assert all(r["remedy"] for r in rows)


@pytest.mark.slow
def test_more_sets_keep_those_that_are_done(call, study, ran):
    more = call("run", "runs/toy", "--sets", "30", "--json", "--trust-plugins", plugin=None)
    assert more.code == 0, more.err
    assert more.json["n_sets"] == 30
    with Ledger(ran) as ledger:
        rows = swept(ledger)
    assert rows.height == 30
    assert rows["n_attempts"].max() == 1
    assert call("run", study, "--sets", "50", "--out", "other").code == 0
    even_more = pl.read_parquet("other/design.parquet")
    assert even_more.height == 50
    assert pl.read_parquet(ran / "design.parquet").equals(even_more.head(30))
    again = call("run", "runs/toy", "--json", "--trust-plugins", plugin=None)
    assert again.json["n_sets"] == 30
    assert "runs/toy is complete: simulations are reused, fit and report made again" in again.err
    refused = call("run", "runs/toy", "--sets", "10", "--study", study)
    assert refused.code == 0  # a run is never made smaller


@pytest.mark.slow
def test_a_first_look_is_the_beginning_of_the_whole_run(call, study, tmp_path, whole_run):
    look = call("run", study, "--sets", "8", "--json")
    assert look.code == 0, look.err
    assert look.json["n_sets"] == 8
    assert call("run", "runs/toy", "--json", "--trust-plugins", plugin=None).json["n_sets"] == 8
    whole = call("run", study)
    assert whole.code == 0, whole.err
    assert "has changed" not in whole.err
    with Ledger(tmp_path / "runs" / "toy") as ledger:
        assert swept(ledger)["n_attempts"].to_list() == [1] * 20
    assert tables(tmp_path / "runs" / "toy") == tables(whole_run)
    assert (
        call("run", "runs/toy", "--sets", "8", "--json", "--trust-plugins", plugin=None).json["n_sets"] == 20
    )


@pytest.mark.slow
def test_a_changed_study_shows_the_changes_and_forks_or_continues(call, study, tmp_path, ran):
    path = study / "study.toml"
    path.write_text(path.read_text().replace('"3 MPa"', '"4 MPa"'))
    refused = call("run", study)
    assert refused.code == 2
    assert "materials.rubber.searched.k.upper: 3.0 → 4.0" in refused.err
    assert "0 of 20 finished simulations are still valid" in refused.err
    assert "--fork FOLDER" in refused.err
    before = tables(ran)
    assert call("run", "runs/toy", "--fork", "forked", "--trust-plugins", plugin=None).code == 0
    assert tables(ran) == before
    with Ledger(tmp_path / "forked") as ledger:
        assert swept(ledger).height == 40
        assert sum(ledger.counts().values()) == 20
    assert call("run", study, "--go-on").code == 0
    assert tables(ran) == tables(tmp_path / "forked")
    assert "already there; name a folder without a run" in call("run", study, "--fork", "forked").err


@pytest.mark.slow
@pytest.mark.usefixtures("ran")
def test_a_changed_input_file_that_costs_simulations_needs_confirmation(call, study):
    for name in ("s1.txt", "s2.txt"):
        lines = (study / name).read_text().splitlines()
        (study / name).write_text("\n".join(lines[:-1]) + "\n")
    refused = call("run", study)
    assert refused.code == 2
    assert re.search(r"inputs\.s1\.txt: .* → (.|\n)*inputs\.s2\.txt: ", refused.err)
    assert "0 of 20 finished simulations are still valid" in refused.err
    assert call("run", study, "--go-on").code == 0


def test_the_guide_reads_a_run_without_palpate(whole_run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(whole_run, "runs/arm")
    blocks = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), flags=re.DOTALL)
    (code,) = (block for block in blocks if "ledger" in block)
    found = {}
    exec(code, found)
    found["ledger"].close()
    assert found["rows"].height == 40
    assert {name for _, name in found["curves"]} == {"abscissa", "ordinate"}
    assert {values.size for values in found["curves"].values()} == {11}


@pytest.mark.slow
@pytest.mark.usefixtures("ran")
def test_a_change_that_costs_nothing_is_reported_and_the_run_continues(call, study):
    path = study / "study.toml"
    path.write_text(path.read_text() + '\n[scoring]\nnormaliser = "rms"\n')
    ran = call("run", study)
    assert ran.code == 0
    assert 'normaliser: "mean_abs" → "rms"' in ran.err
    assert "20 of 20 finished simulations are still valid" in ran.err


@pytest.mark.slow
def test_a_run_moves_with_its_study_and_goes_on_without_it(call, study, tmp_path):
    call("run", study, "--out", study / "run")
    moved = tmp_path / "moved"
    shutil.move(study, moved)
    assert call("run", moved / "run", "--trust-plugins", plugin=None).code == 0
    shutil.move(moved / "run", tmp_path / "alone")
    alone = call("run", "alone", "--trust-plugins", plugin=None)
    assert alone.code == 0, alone.err
    assert "the copy in the run is used" in alone.err
    shutil.rmtree("alone/inputs")
    lost = call("run", "alone", "--trust-plugins", plugin=None)
    assert lost.code == 2
    assert "--study FILE" in lost.err or "a plugin file of this run is not there" in lost.err
    assert call("run", "nowhere").code == 2


@pytest.mark.usefixtures("one_figure")
@pytest.mark.parametrize("command", [("report",), ("status",), ("card",), ("run",)])
def test_each_command_works_on_a_run_that_was_moved_after_its_study_was_lost(
    call, whole_run, tmp_path, command
):
    moved = shutil.copytree(whole_run, tmp_path / "far" / "away" / "run")
    original = RunDirectory(moved).manifest()["study_file"]
    found = call(*command, moved, "--json") if command != ("card",) else call("card", moved)
    assert found.code == 0, found.err
    assert RunDirectory(moved).manifest()["study_file"] == original, "where it may be again"
    assert {"study.toml", "s1.txt", "s2.txt"} <= {file.name for file in (moved / "inputs").iterdir()}


@pytest.mark.usefixtures("ran")
def test_a_study_that_is_edited_after_its_run_counts_where_it_is_run_again_alone(call, study, ran):
    path = study / "study.toml"
    path.write_text(path.read_text() + '\n[scoring]\nnormaliser = "rms"\n')
    assert call("report", ran, "--json").code == 0
    assert "rms" not in (ran / "inputs" / "study.toml").read_text()
    assert "rms" not in (ran / "study.toml").read_text()


def test_status_of_a_finished_run_has_the_lines_that_it_ended_with(call, whole_run):
    found = call("status", whole_run)
    assert found.code == 0
    labels = [line.split()[0] for line in found.out.splitlines() if line.split()]
    assert [word for word in labels if word in LABELS] == LABELS
    assert "; finished" in found.out
    (page,) = (line.split()[-1] for line in found.out.splitlines() if line.startswith("Page"))
    assert page == (whole_run / "report" / "index.html").resolve().as_uri()
    head = (whole_run / "report" / "index.html").read_text()
    spent = r"(about \d+ (s|min)|less than a second) of processor time"
    assert re.search(rf"simulated until \d{{4}}-\d\d-\d\d: \d+ simulations, {spent}", head)


@pytest.mark.usefixtures("one_figure")
def test_the_lines_of_an_earlier_end_are_not_those_of_a_run_that_goes_on(
    call, whole_run, tmp_path, monkeypatch
):
    again = shutil.copytree(whole_run, tmp_path / "again")

    def stop(*_, **__):
        raise KeyboardInterrupt

    assert RunDirectory(again).result()
    monkeypatch.setattr("palpate_report.from_run.write_figures", stop)
    assert call("run", again).code == 130
    assert "the run has not ended" in RunDirectory(again).result()["Conclusion"]


@pytest.mark.parametrize("text", ["", "[]", "null"])
def test_a_damaged_file_of_last_lines_is_none(tmp_path, text):
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "result.json").write_text(text)
    assert RunDirectory(tmp_path).result() == {}


def test_the_manifest_holds_no_place_of_this_machine(whole_run):
    manifest = json.loads((whole_run / "manifest.json").read_text())
    assert manifest["study_file"] == "../../study/study.toml"


@pytest.mark.slow
def test_a_narrowed_range_keeps_the_curves_of_the_sets_inside(call, study, ran):
    run, path = ran, study / "study.toml"
    wide, usual = tables(run), path.read_text()
    before = pl.read_parquet(run / "design.parquet")
    path.write_text(usual.replace('"3 MPa"', '"2 MPa"'))
    narrowed = call("run", study, "--go-on")
    assert narrowed.code == 0, narrowed.err
    inside = before.filter(pl.col("rubber.k") <= 2.0)
    assert f"{inside.height} of 20 finished simulations are still valid" in narrowed.err
    design = pl.read_parquet(run / "design.parquet")
    assert design.head(inside.height)["rubber.k"].equals(inside["rubber.k"])
    assert (design.height, json.loads((run / "design.json").read_text())["n_kept"]) == (20, inside.height)
    with Ledger(run) as ledger:
        assert swept(ledger).height == 40 - inside.height
        assert swept(ledger)["n_attempts"].max() == 1
    narrow = tables(run)
    assert call("run", run, "--trust-plugins", plugin=None).code == 0
    assert tables(run) == narrow
    assert call("run", run, "--sets", "30", "--json").json["n_sets"] == 30
    assert pl.read_parquet(run / "design.parquet").head(20).equals(design)
    path.write_text(usual)
    assert call("run", study, "--go-on").code == 0
    assert tables(run) == wide
    (run / "design.json").write_text("{")
    assert call("run", study).code == 0
    assert tables(run) == wide


@pytest.mark.slow
def test_a_received_run_executes_no_untrusted_file(call, study, tmp_path, ran):
    planted = tmp_path / "planted.py"
    planted.write_text(f"open({str(tmp_path / 'executed')!r}, 'w').close()\n")
    path = ran / "manifest.json"
    manifest = json.loads(path.read_text())
    path.write_text(json.dumps(manifest | {"plugin_files": [*manifest["plugin_files"], str(planted)]}))
    for given in ([], ["--json"], ["--go-on"]):
        refused = call("run", ran, *given)
        assert refused.code == 2
        assert str(planted) in refused.err
        assert "--trust-plugins" in refused.err
        assert f"palpate --plugin {planted} run" in refused.err
    toml = study / "study.toml"
    toml.write_text(toml.read_text().replace("[study]", '[study]\nplugins = ["../planted.py"]', 1))
    path.write_text(json.dumps(manifest))
    assert "planted.py" in call("run", ran).err
    assert not (tmp_path / "executed").exists()
    assert call("run", ran, "--trust-plugins").code == 0
    assert (tmp_path / "executed").exists()


@pytest.mark.slow
def test_a_run_moved_away_from_its_plugin_is_resumed_with_that_plugin(call, study, tmp_path, ran):
    (tmp_path / "far" / "away").mkdir(parents=True)
    shutil.move(ran, tmp_path / "far" / "away" / "run")
    assert call("run", "far/away/run", "--study", study).code == 0
    manifest = json.loads((tmp_path / "far" / "away" / "run" / "manifest.json").read_text())
    assert manifest["study_file"] == "../../../study/study.toml"


def test_status_finds_the_run_that_is_meant(call, study, tmp_path, monkeypatch):
    nothing = call("status")
    assert nothing.code == 2
    assert "runs/ holds no run" in nothing.err
    call("sample", study)
    call("sample", study, "--out", "runs/newer")
    os.utime(tmp_path / "runs" / "newer" / "manifest.json", (4e9, 4e9))
    (tmp_path / "runs" / "notes").mkdir()
    assert call("status", "--json").json["folder"] == "runs/newer"
    monkeypatch.chdir(study)
    assert "no run" in call("status", ".").err
    call("sample", ".")
    assert call("status", ".", "--json").json["folder"] == "runs/toy"


@pytest.mark.slow
def test_two_studies_of_one_name_do_not_share_the_default_folder(call, study, tmp_path):
    call("sample", study)
    other = shutil.copytree(study, tmp_path / "other")
    for command in ("run", "sample"):
        refused = call(command, other)
        assert refused.code == 2
        assert "holds the run of" in refused.err
        assert "; change the name 'toy' under [study], or continue" in refused.err
    call("sample", study, "--out", "kept")
    assert "; name another folder with --out, or continue" in call("sample", other, "--out", "kept").err
    assert call("run", "runs/toy", "--study", other).code == 0


@pytest.mark.slow
def test_a_damaged_manifest_is_an_error_and_deleting_it_is_a_remedy(call, study, tmp_path):
    call("sample", study)
    manifest = tmp_path / "runs" / "toy" / "manifest.json"
    whole = manifest.read_text()
    flipped = [whole.replace(f'"{key}"', '"other"', 1) for key in ("scenarios", "spots", "mean_abs")]
    for content in ("", "{", "[1]", "\xff", "[" * 100_000, "{}", *flipped):
        manifest.write_text(content, encoding="latin-1")
        for command in (("run", study), ("status", "runs/toy"), ("run", "runs/toy"), ("report", study)):
            refused = call(*command)
            assert refused.code == 2, command
            assert "manifest.json: damaged" in refused.err
            assert "delete it" in refused.err
    manifest.unlink()
    assert call("run", study).code == 0
