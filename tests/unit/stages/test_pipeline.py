"""The stages composed, and one by one from files."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from palpate.domain import Normaliser, Response, Status
from palpate.errors import (
    CurveError,
    NothingSelectableError,
    PalpateError,
    PluginError,
    ScoringError,
    StudyError,
)
from palpate.fit.least_squares import LeastSquares
from palpate.plugins.score import Nmse, NmseSettings, ScoringRules
from palpate.progress import Progress
from palpate.run.directory import RunDirectory, file_name
from palpate.run.ledger import Ledger
from palpate.stages import pipeline
from palpate_report import from_run

TRUTH = {"soft_tissue.stiffness": 0.4, "soft_tissue.grip": 20.0}
FRAMES = ("scores", "selection", "generalisation")


def called(verb):
    """Function of the pipeline, or what runs a stage."""
    return getattr(pipeline, verb, None) or partial(pipeline.run_stage, verb)


pytestmark = pytest.mark.usefixtures("one_figure")


class Recorder(Progress):
    def __init__(self):
        self.stages = {}
        self.notes = []

    def begin(self, stage, total):
        self.stages[stage] = [total, 0]

    def step(self, note=""):
        self.stages[list(self.stages)[-1]][1] += 1

    def note(self, text):
        self.notes.append(text)


def test_a_run_finds_the_tissue_and_reports_it(make_study, plugins, tmp_path):
    recorder = Recorder()
    study = make_study(n_sets=60, search=LeastSquares(), truth=TRUTH)
    result = pipeline.run_study(study, tmp_path / "run", plugins, recorder)
    fitted = result.fit.of_spots()["p1", "I"]
    assert fitted["soft_tissue.stiffness"] == pytest.approx(0.4, rel=1e-6)
    assert fitted["soft_tissue.grip"] == pytest.approx(20.0, rel=1e-6)
    assert len(result.simulations) == 120
    spent = result.fit.table.unique(["fit", "scenario"])["n_runs"].sum()
    with Ledger(tmp_path / "run") as ledger:  # both spots have the same simulations of the sweep
        # Four more are for the error budget: a press with onset and friction moved to either side.
        # Nine are of the fits at their reported values, and some led there.
        assert spent + 4 + 9 <= len(ledger.seconds()) - 60 <= spent + 4 + 9 * 10
    assert set(result.report.tables) == {
        "intervals", "budget", "parameter_combinations", "between_spots",
        "table1_fit", "table2_fit", "table1_coefficients", "table2_nmse", "unfitted_channels",
        "cross_channel", "generalised", "fit",
        "distance_to_truth", "identifiability", "cost_of_one_set",
    }  # fmt: skip
    assert all(path.exists() for path in result.report.files)
    once = {"check": [1, 1], "report": [1, 1]}
    n_fit = len(Ledger(tmp_path / "run").seconds()) - 60
    assert recorder.stages == once | {"simulate": [60, 60], "fit": [0, n_fit]}


def test_a_spot_without_a_channel_is_run_and_reported(make_study, plugins, tmp_path):
    study = make_study()
    (file,) = study.spots[1].files
    file.write_text("".join(row for row in file.read_text().splitlines(True) if "torque" not in row))
    selected = pipeline.run_study(study, tmp_path / "run", plugins).selected
    assert selected.selection.select("spot", "scenario").rows() == [
        ("p1", "I"), ("p1", "II"), ("p1", "III"), ("p2", "I"), ("p2", "III"),
    ]  # fmt: skip
    assert selected.without_result == {}
    assert set(selected.generalisation["spot"]) == {"p1", "p2"}


def test_no_page_is_made_of_simulations_of_another_study(make_study, plugins, tissue, tmp_path):
    study = make_study()
    pipeline.run_study(study, tmp_path / "run", plugins)
    other = replace(study, solver=tissue.Analytic(tissue.AnalyticSettings(offset=0.1)))
    with pytest.raises(StudyError, match=r"24 of 24 scored simulations do not belong .* `palpate run`"):
        from_run.report(other, tmp_path / "run", plugins)
    assert from_run.report(study, tmp_path / "run", plugins).files


@pytest.mark.slow
def test_single_stages_write_what_the_run_writes(make_study, plugins, tmp_path):
    study = make_study(search=LeastSquares(), scenarios=make_study().scenarios[:1])
    result = pipeline.run_study(study, tmp_path / "whole", plugins)
    alone = tmp_path / "alone"
    pipeline.measure(study, alone, plugins)
    pipeline.run_stage("sample", study, alone, plugins)
    pipeline.run_stage("simulate", study, alone, plugins)
    for name in ("score", "select", "verify", "fit", "intervals", "identifiability"):
        run = pipeline.run_stage(name, study, alone, plugins)
    report = from_run.report(study, alone, plugins)
    assert_frame_equal(run.table("scores"), result.scores)
    assert_frame_equal(run.table("selection"), result.selected.selection)
    assert_frame_equal(run.table("generalisation"), result.selected.generalisation)
    assert_frame_equal(run.fit().table, result.fit.table)
    assert [p.relative_to(alone) for p in report.files] == [
        p.relative_to(tmp_path / "whole") for p in result.report.files
    ]
    for name in FRAMES:
        assert_frame_equal(
            pl.read_parquet(alone / f"{name}.parquet"),
            pl.read_parquet(tmp_path / "whole" / f"{name}.parquet"),
        )


def test_a_run_directory_moves_freely(make_study, plugins, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the next step is typed here
    study = make_study()
    pipeline.run_study(study, tmp_path / "here", plugins)
    (tmp_path / "here").rename(tmp_path / "there")
    report = from_run.report(study, tmp_path / "there", plugins)
    assert all((tmp_path / "there") in path.parents for path in report.files)
    for path in (tmp_path / "there").rglob("*"):
        if path.suffix in (".json", ".jsonl", ".html", ".csv", ".svg"):
            assert str(tmp_path) not in path.read_text(), path


@pytest.mark.parametrize(
    ("verb", "missing", "command"),
    [
        ("simulate", "measured", "experiment"),
        ("select", "measured", "experiment"),
        ("report", "measured", "experiment"),
    ],
)
def test_a_stage_names_the_one_that_must_run_before(make_study, plugins, tmp_path, verb, missing, command):
    with pytest.raises(
        StudyError, match=rf"{missing}: not there yet; run `palpate {command} STUDY --out .*run` first"
    ):
        called(verb)(make_study(), tmp_path / "run", plugins)
    assert not (tmp_path / "run").exists()


def test_measured_curves_are_required_before_the_sweep(make_study, plugins, tmp_path):
    pipeline.run_stage("sample", make_study(), tmp_path / "run", plugins)
    with pytest.raises(StudyError, match=r"measured: not there yet; run `palpate experiment STUDY --out"):
        pipeline.run_stage("simulate", make_study(), tmp_path / "run", plugins)


def test_scores_need_simulations_of_this_very_study(make_study, plugins, tmp_path, tissue):
    pipeline.run_study(make_study(), tmp_path / "run", plugins)
    other = make_study(solver=tissue.Analytic(tissue.AnalyticSettings(offset=1.0)))
    with pytest.raises(StudyError, match=r"no simulation of this study; run `palpate simulate`"):
        pipeline.run_stage("score", other, tmp_path / "run", plugins)


def test_a_design_of_other_parameters_is_refused(make_study, plugins, tmp_path, space):
    pipeline.measure(make_study(), tmp_path / "run", plugins)
    pipeline.run_stage("sample", make_study(), tmp_path / "run", plugins)
    region = replace(space.regions[0], searched=space.regions[0].searched[:1], fixed={"grip": 20.0})
    study = make_study(space=replace(space, regions=(region,)))
    with pytest.raises(
        StudyError, match="`palpate sample` were made before a change of ranges, materials; run"
    ):
        pipeline.run_stage("simulate", study, tmp_path / "run", plugins)


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"scoring": ScoringRules(score=Nmse(NmseSettings(normaliser=Normaliser.MEAN)))}, ScoringError),
        ({"n_sets": -1}, PalpateError),
        ({"scoring": ScoringRules(minimum_coverage=1.0), "spots": "short"}, CurveError),
    ],
)
def test_bad_input_writes_nothing(make_study, plugins, tmp_path, changes, error):
    if changes.get("spots"):
        (path,) = make_study().spots[0].measured[None]
        path.write_text("\n".join(path.read_text().splitlines()[:8]))
        changes = {"scoring": ScoringRules(minimum_coverage=1.0)}
    with pytest.raises(error):
        pipeline.run_study(make_study(**changes), tmp_path / "run", plugins)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("folder", ["a_file", "a_file/run"])
def test_a_folder_that_cannot_be_made_is_named(make_study, plugins, tmp_path, folder):
    (tmp_path / "a_file").touch()
    with pytest.raises(StudyError, match=rf"{folder}: cannot be a run directory \(.*\); name another"):
        pipeline.run_study(make_study(), tmp_path / folder, plugins)


def test_a_solver_without_a_version_is_named_and_nothing_written(make_study, plugins, tmp_path, tissue):
    class Unversioned(tissue.Analytic):
        def version(self):
            raise OSError("no licence")

    with pytest.raises(
        PluginError, match=r"asking for its version and fingerprint: 'analytic' .* OSError: no licence"
    ):
        pipeline.run_study(make_study(solver=Unversioned()), tmp_path / "run", plugins)
    assert not (tmp_path / "run").exists()


def test_when_everything_fails_the_reason_is_reported_and_the_scores_stay(make_study, plugins, tmp_path):
    study = make_study(solver="Hopeless")
    with pytest.raises(
        NothingSelectableError, match=r"none of 24 simulations .*diverged: step too small; .*narrow"
    ):
        pipeline.run_study(study, tmp_path / "run", plugins)
    assert RunDirectory(tmp_path / "run").table("scores")["status"].unique().to_list() == ["diverged"]
    with pytest.raises(NothingSelectableError):
        pipeline.run_stage("select", study, tmp_path / "run", plugins)


def test_failures_are_rows_and_the_rest_is_ranked(make_study, plugins, tmp_path, tissue):
    class Partial(tissue.Faulty):
        def behave(self, job):
            return super().behave(job) if job.set_id > 2 else tissue.Analytic.behave(self, job)

    result = pipeline.run_study(make_study(solver=Partial()), tmp_path / "run", plugins)
    table = result.report.tables["failures"]
    assert sorted(table["status"]) == ["crashed", "diverged", "unreadable"]
    assert not set(result.selected.selection["set_id"]) & {3, 4, 5}


@pytest.mark.slow
def test_partial_curves_are_ranked_on_request_and_marked_in_every_table(
    make_study, plugins, tmp_path, tissue
):
    class Short(tissue.Analytic):
        def behave(self, job):
            whole = super().behave(job)
            torque = whole.response["torque"]
            force = whole.response["force"].cut(slice(0, 15))
            response = Response(curves={"torque": torque, "force": force})
            return replace(whole, status=Status.DIVERGED, response=response, message="stopped at 7 mm")

    study = make_study(solver=Short(), scoring=ScoringRules(minimum_coverage=0.5))
    with pytest.raises(NothingSelectableError, match="stopped at 7 mm"):
        pipeline.run_study(study, tmp_path / "run", plugins)
    asked = replace(study, scoring=replace(study.scoring, rank_partial=True))
    result = pipeline.run_study(asked, tmp_path / "run", plugins)
    assert result.selected.selection["partial"].all()
    assert result.scores["status"].unique().to_list() == ["diverged"]
    whole = pipeline.run_study(make_study(), tmp_path / "whole", plugins)
    assert "partial" not in whole.selected.selection.columns


def test_the_manifest_lists_what_the_numbers_depend_on(make_study, plugins, tmp_path):
    (tmp_path / "variant.toml").write_text("# as run\n")
    (tmp_path / "study.toml").write_text("# another\n")
    study = make_study(truth=TRUTH, file=tmp_path / "variant.toml")
    pipeline.run_study(study, tmp_path / "run", plugins)
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert (tmp_path / "run" / "study.toml").read_text() == "# as run\n"
    assert manifest["data"] == "simulated"
    assert manifest["scoring"]["normaliser"] == "mean_abs"
    assert manifest["seed"] == 1
    assert manifest["truth"] == TRUTH
    assert manifest["units"] == "mm, N, MPa, N·mm, degrees"
    assert manifest["materials"][0]["convention"] == "textbook"
    assert manifest["versions"]["solver analytic"].startswith("source ")
    assert {"python", "numpy", "polars"} <= set(manifest["versions"])
    assert set(manifest["inputs"]) == {"variant.toml", "analytic_tissue.py", "p1.csv", "p2.csv"}
    assert set(manifest["channels"]) == {"force", "torque"}


@pytest.mark.slow
def test_a_fit_of_an_earlier_run_does_not_remain(make_study, plugins, tmp_path):
    pipeline.run_study(make_study(search=LeastSquares()), tmp_path / "run", plugins)
    result = pipeline.run_study(make_study(), tmp_path / "run", plugins)
    assert "fit" not in result.report.tables
    assert not RunDirectory(tmp_path / "run").fit().responses


def test_a_design_is_read_back_to_the_last_bit(make_study, plugins, tmp_path):
    design = pipeline.run_stage("sample", make_study(), tmp_path / "run", plugins).directory.design()
    back = RunDirectory(tmp_path / "run").design()
    assert np.array_equal(back.values, design.values)
    assert (back.parameters, back.seed, back.n_drawn) == (design.parameters, design.seed, design.n_drawn)


@pytest.mark.parametrize("name", ["p1", "spot 2", "../up", "..", "a/b", "ünder", "c:d"])
def test_a_name_never_leads_out_of_its_folder(name, tmp_path):
    made = file_name(name)
    assert (tmp_path / made).parent == tmp_path
    assert made not in (".", "..")
    (tmp_path / made).touch()


def test_names_stay_apart():
    names = ["a.b", "a%2Eb", "a/b", "a b", "a_b"]
    assert len({file_name(n) for n in names}) == len(names)
