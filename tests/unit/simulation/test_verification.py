"""Selected sets are verified by their solver, once."""

from typing import ClassVar

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from palpate.errors import StoppedError, StudyError
from palpate.plugins.interfaces import Solver
from palpate.progress import SILENT, Progress
from palpate.run.directory import RunDirectory
from palpate.stages import pipeline
from palpate.stages.core_stages import selected
from palpate_report.answer.result import make_conclusion
from palpate_report.data.tables import make_tables
from palpate_report.page.html import render

MESSAGE = "so it is"


@pytest.fixture
def doubting(tissue):
    """A solver that verifies its results, and a record of what it was asked."""

    class Strictness(tissue.Analytic.Settings):
        strict: bool = True

    class Doubting(tissue.Analytic, Solver[Strictness]):
        asked: ClassVar[list] = []
        is_away = False

        def verify(self, job, limb, simulation):
            if self.is_away:
                raise StudyError("the oracle is away; wait")
            self.asked.append(job.set_id)
            assert simulation.response is not None
            return {
                "passed": job.thetas["soft_tissue"][0] < 0.45,
                "message": "so it is",
                "change": np.float64(0.1),
            }

    return Doubting


def run_to_selection(study, folder, plugins, progress=SILENT):
    pipeline.measure(study, folder, plugins)
    for name in ("sample", "simulate", "score", "select"):
        pipeline.run_stage(name, study, folder, plugins)
    return selected(pipeline.run_stage("verify", study, folder, plugins, progress))


def test_every_chosen_set_is_proved_once(doubting, make_study, plugins, tmp_path):
    study, folder = make_study(doubting()), tmp_path / "run"
    found = run_to_selection(study, folder, plugins)
    chosen = pl.concat([found.selection, found.generalisation], how="diagonal")
    expected = set(chosen.select("spot", "set_id").iter_rows())
    assert set(found.verification.select("spot", "set_id").iter_rows()) == expected
    # A set is the same job at both spots here, for they have no meshes.
    assert sorted(doubting.asked) == sorted({set_id for _, set_id in expected})
    stiffness = dict(chosen.select("set_id", "soft_tissue.stiffness").iter_rows())
    for row in found.verification.iter_rows(named=True):
        assert row["passed"] == (stiffness[row["set_id"]] < 0.45)
    assert set(found.verification["passed"]) == {True, False}
    assert set(found.verification["change"]) == {0.1}
    again = selected(pipeline.run_stage("verify", study, folder, plugins))
    assert_frame_equal(again.verification, found.verification)
    assert_frame_equal(RunDirectory(folder).table("verification"), found.verification)
    assert len(doubting.asked) == len(set(doubting.asked))


def test_other_settings_are_proved_again(doubting, make_study, plugins, tmp_path):
    run_to_selection(make_study(doubting()), tmp_path / "run", plugins)
    n = len(doubting.asked)
    lax = make_study(doubting(doubting.Settings(strict=False)))
    run_to_selection(lax, tmp_path / "run", plugins)
    assert len(doubting.asked) == 2 * n


def test_a_proof_that_cannot_be_had_is_a_failed_one_and_is_tried_again(
    doubting, make_study, plugins, tmp_path
):
    study, folder = make_study(doubting()), tmp_path / "run"
    doubting.is_away = True
    verification = run_to_selection(study, folder, plugins).verification
    assert set(verification["message"]) == {"the oracle is away; wait"}
    assert not verification["passed"].any()
    doubting.is_away = False
    again = pipeline.run_stage("verify", study, folder, plugins).table("verification")
    assert set(again["message"]) == {MESSAGE}


def test_a_stop_keeps_what_is_proved(doubting, make_study, plugins, tmp_path):
    class Impatient(Progress):
        def should_continue(self):
            return not doubting.asked

    with pytest.raises(StoppedError, match="palpate run"):
        run_to_selection(make_study(doubting()), tmp_path / "run", plugins, Impatient())
    assert len(RunDirectory(tmp_path / "run").table("verification")) == 1


def test_a_stop_keeps_what_an_earlier_run_has_proved(doubting, make_study, plugins, tmp_path):
    class Gone(Progress):
        def __init__(self, n):
            self.left = iter([True] * n)

        def should_continue(self):
            return next(self.left, False)

    study, run = make_study(doubting()), RunDirectory(tmp_path / "run")
    verified = run_to_selection(study, run.folder, plugins).verification
    with pytest.raises(StoppedError):
        pipeline.run_stage("verify", study, run.folder, plugins, Gone(1))
    assert set(run.table("verification")["key"]) == set(verified["key"])
    n_asked = len(doubting.asked)
    again = pipeline.run_stage("verify", study, run.folder, plugins).table("verification")
    assert_frame_equal(again, verified)
    assert len(doubting.asked) == n_asked


def test_a_solver_without_a_proof_leaves_none(doubting, make_study, plugins, tmp_path):
    run_to_selection(make_study(doubting()), tmp_path / "run", plugins)
    assert run_to_selection(make_study(), tmp_path / "run", plugins).verification.is_empty()
    assert not (tmp_path / "run" / "verification.parquet").exists()


def test_the_report_shows_every_proof_and_distrusts_what_failed(doubting, content):
    found = content(solver=doubting())
    tables = make_tables(found)
    table = tables["verification"]
    assert "key" not in table.columns
    n_failed = table.height - table["passed"].sum()
    text = render(found, tables, make_conclusion(found, tables), ())
    assert f"{n_failed} of {table.height} selected sets failed verification" in text
