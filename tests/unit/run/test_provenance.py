"""Each stage's file is read as it was written, and only if it was made from the present study."""

import contextlib
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from palpate.domain import Normaliser, Scenario
from palpate.errors import PalpateError, StoppedError, StudyError
from palpate.fit.least_squares import LeastSquares
from palpate.plugins.registry import load_file
from palpate.plugins.score import Nmse, NmseSettings, ScoringRules
from palpate.progress import Progress
from palpate.run.fit_state import read_fit_state
from palpate.run.provenance import StageRecords
from palpate.stages import pipeline
from palpate.stages.core_stages import cases_of
from palpate.study.model import BudgetTable
from palpate_report import from_run

pytestmark = pytest.mark.usefixtures("one_figure")

MADE_BY = {
    "design.parquet": "sample",
    "design.json": "sample",
    "measured/p1.parquet": "experiment",
    "measured/p1.json": "experiment",
    "scores.parquet": "score",
    "selection.parquet": "select",
    "generalisation.parquet": "select",
    "fit.parquet": "fit",
    "fit_curves.parquet": "fit",
}
READ_BY = {"simulate": 4, "score": 4, "select": 5, "report": len(MADE_BY)}
"""How many of these files a verb reads."""


def called(verb):
    """Function of the pipeline or of the report, or what runs a stage."""
    if verb == "report":
        return from_run.report
    return getattr(pipeline, verb, None) or partial(pipeline.run_stage, verb)


@pytest.fixture
def done(make_study, run_once):
    study = make_study(n_sets=4, search=LeastSquares())
    return study, run_once(study)


def flipped(content):
    place = len(content) // 2
    return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]


def cut(content):
    return content[: len(content) // 2]


def test_results_that_were_made_from_something_else_or_from_more_are_refused(tmp_path):
    records, made_from = StageRecords(tmp_path), {"normaliser": "a", "filters": "b"}
    records.write("score", (), made_from)
    records.check("score", made_from)
    for other, now in (("normaliser", made_from | {"normaliser": "c"}), ("filters", {"normaliser": "a"})):
        with pytest.raises(StudyError, match=f"made before a change of {other}; run"):
            records.check("score", now)


@pytest.mark.slow
@pytest.mark.parametrize("damage", [flipped, cut])
def test_a_damaged_file_names_the_stage_that_makes_it_again(done, plugins, damage):
    study, run = done
    for i, (name, command) in enumerate(MADE_BY.items()):
        path = run / name
        whole = path.read_bytes()
        path.write_bytes(damage(whole))
        for verb, n_read in READ_BY.items():
            if i < n_read:
                message = rf"{path.name}: damaged or replaced.*run `palpate {command}` again"
                with pytest.raises(StudyError, match=message):
                    called(verb)(study, run, plugins)
        path.write_bytes(whole)
    pipeline.run_study(study, run, plugins)


@pytest.mark.slow
def test_a_file_of_another_run_is_refused(done, plugins, tmp_path):
    study, run = done
    pipeline.run_study(replace(study, seed=2), tmp_path / "other", plugins)
    names = ("scores", "selection", "generalisation")
    for name in names:
        shutil.copy(run / f"{name}.parquet", tmp_path / "kept")
        shutil.copy(tmp_path / "other" / f"{name}.parquet", run)
        with pytest.raises(StudyError, match=rf"{name}\.parquet: damaged or replaced"):
            from_run.report(study, run, plugins)
        shutil.copy(tmp_path / "kept", run / f"{name}.parquet")
    for name in (*(f"{name}.parquet" for name in names), "stages.json"):
        shutil.copy(tmp_path / "other" / name, run)
    with pytest.raises(StudyError, match=r"design.*damaged or replaced"):
        from_run.report(study, run, plugins)


@pytest.mark.slow
def test_a_fit_that_is_put_in_place_is_not_reported(make_study, plugins, tmp_path, done):
    plain = make_study(n_sets=4)
    pipeline.run_study(plain, tmp_path / "plain", plugins)
    shutil.copy(done[1] / "fit.parquet", tmp_path / "plain")
    assert "fit" not in from_run.report(plain, tmp_path / "plain", plugins).tables


def other_ranges(study):
    (region,) = study.space.regions
    searched = tuple(replace(p, upper=0.9 * p.upper) for p in region.searched)
    return replace(study, space=replace(study.space, regions=(replace(region, searched=searched),)))


def scored_by(study, **rules):
    return replace(study, scoring=ScoringRules(**rules))


SCORE = Path(__file__).parents[3] / "examples" / "log_loading_score.py"

CHANGES = {
    "normaliser": (
        lambda study: replace(
            study, scoring=ScoringRules(score=Nmse(NmseSettings(normaliser=Normaliser.RMS)))
        ),
        "score",
        "select",
    ),
    "coverage or partial": (
        lambda study: scored_by(study, minimum_coverage=0.5),
        "score",
        "select",
    ),
    "n_sets, max_draws or seed": (lambda study: replace(study, seed=5), "sample", "simulate"),
    "ranges": (other_ranges, "sample", "score"),
    "scenarios": (
        lambda study: replace(study, scenarios=(Scenario(name="I", weights={"force": 1.0, "torque": 2.0}),)),
        "select",
        "report",
    ),
    "generalise_by": (lambda study: replace(study, generalise_by="II"), "select", "report"),
    "search": (
        lambda study: replace(study, search=LeastSquares(LeastSquares.Settings(max_steps=3))),
        "fit",
        "intervals",
    ),
    "budget": (lambda study: replace(study, budget=BudgetTable(gain=0.1)), "intervals", "certainty"),
}


@pytest.mark.slow
def test_a_stage_that_reads_the_fit_leaves_a_finished_run(done, plugins):
    study, run = done
    pipeline.run_stage("intervals", study, run, plugins)
    assert read_fit_state(run) is None
    with (
        contextlib.suppress(KeyboardInterrupt),
        pipeline.locked_run(study, run, plugins, needs=("fit",)) as read_again,
    ):
        cases_of(read_again)
        raise KeyboardInterrupt
    assert read_fit_state(run) is None
    assert not from_run.read_results(study, run, plugins).unfinished


@pytest.mark.slow
def test_what_a_changed_study_makes_stale_is_refused_with_its_remedy(done, plugins):
    study, run = done
    manifest = (run / "manifest.json").read_bytes()
    for name, (change, remedy, first) in CHANGES.items():
        for verb in dict.fromkeys((first, "report")):
            made = rf"results of `palpate {remedy}` were made before a change of .*{name}"
            with pytest.raises(StudyError, match=f"{made}.*; run `palpate run {run}` again"):
                called(verb)(change(study), run, plugins)
    assert (run / "manifest.json").read_bytes() == manifest
    changed = replace(study, scoring=ScoringRules(score=Nmse(NmseSettings(normaliser=Normaliser.RMS))))
    for verb in ("score", "select"):
        called(verb)(changed, run, plugins)
    with pytest.raises(
        StudyError,
        match=r"palpate fit` were made before a change of .*normaliser, results of `palpate select`",
    ):
        from_run.report(changed, run, plugins)
    for verb in ("fit", "intervals", "report"):
        called(verb)(changed, run, plugins)


@pytest.mark.slow
@pytest.mark.parametrize("n_sets", [4, 0])
def test_another_score_makes_all_that_was_scored_stale(make_study, plugins, tmp_path, n_sets):
    """Also without a sweep, whose table of scores would show it."""
    study = make_study(n_sets=n_sets, search=LeastSquares())
    pipeline.run_study(study, tmp_path / "run", plugins)
    changed = replace(study, scoring=ScoringRules(score=load_file(SCORE).LogLoading()))
    stages = ("score", "select", "fit", "intervals")
    for verb in stages:
        if verb != "score":
            with pytest.raises(StudyError, match=r"were made before a change of .*; run `palpate run"):
                from_run.report(changed, tmp_path / "run", plugins)
        called(verb)(changed, tmp_path / "run", plugins)
    from_run.report(changed, tmp_path / "run", plugins)


def test_a_measured_file_that_changes_makes_its_curves_stale(done, plugins):
    study, run = done
    (path,) = study.spots[0].measured[None]
    text = path.read_text()
    path.write_text(text + "\n")
    for verb in ("simulate", "score", "select", "report"):
        message = r"of `palpate experiment` were made before a change of files of spot 'p1'; run"
        with pytest.raises(StudyError, match=message):
            called(verb)(study, run, plugins)
    path.unlink()  # what cannot be compared is not refused
    from_run.report(study, run, plugins)


def test_a_measured_file_that_changes_during_the_prompt_is_noticed(make_study, plugins, tmp_path):
    study, run = make_study(n_sets=4), tmp_path / "run"
    (path,) = study.spots[0].measured[None]
    changed = path.read_text() + "\n"
    with pytest.raises(StudyError, match="made before a change of files of spot 'p1'"):
        pipeline.run_study(study, run, plugins, confirm=lambda _: path.write_text(changed))


def test_an_extended_design_is_one_of_the_same_draws(make_study, plugins, tmp_path):
    study, run = make_study(n_sets=4), tmp_path / "run"
    pipeline.run_study(replace(study, n_total=8), run, plugins)
    from_run.report(study, run, plugins)


class Stopping(Progress):
    """Stops after three steps."""

    n_steps = 0

    def step(self, note=""):
        self.n_steps += 1

    def should_continue(self):
        return self.n_steps < 3


def test_simulations_that_came_later_make_the_scores_stale(make_study, plugins, tmp_path):
    study, run = make_study(n_sets=4), tmp_path / "run"
    pipeline.measure(study, run, plugins)
    pipeline.run_stage("sample", study, run, plugins)
    with pytest.raises(StoppedError):
        pipeline.run_stage("simulate", study, run, plugins, Stopping())
    pipeline.run_stage("score", study, run, plugins)
    pipeline.run_stage("simulate", study, run, plugins)
    for verb in ("select", "report"):
        message = r"of `palpate score` were made before a change of results of `palpate simulate`; run"
        with pytest.raises(StudyError, match=message):
            called(verb)(study, run, plugins)


@pytest.mark.slow
def test_corrupt_records_require_every_stage_again(done, plugins):
    study, run = done
    for content in (b"", b"{", b"[]", b'{"design": 3}', b'{"design": {"files": []}}', b"\xff"):
        (run / "stages.json").write_bytes(content)
        with pytest.raises(StudyError, match=r"design\.parquet: damaged or replaced"):
            from_run.report(study, run, plugins)
    pipeline.run_study(study, run, plugins)


@pytest.mark.slow
def test_random_damage_of_any_table_is_never_read_as_other_numbers(done, plugins):
    study, run = done
    rng = np.random.default_rng(0)
    for name in ("design.parquet", "scores.parquet", "selection.parquet", "measured/p1.parquet"):
        path = run / name
        whole = path.read_bytes()
        for place in rng.integers(0, len(whole), 5):
            path.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
            with pytest.raises(PalpateError, match="damaged or replaced"):
                from_run.report(study, run, plugins)
        path.write_bytes(whole)
