"""The stages on frames: what they refuse, and how what failed is shown."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

import palpate
from palpate.domain import Curve, Design
from palpate.errors import StudyError
from palpate.plugins.sections import ReportWarning
from palpate.run.result import FitResult
from palpate.stages import pipeline
from palpate.stages.core_stages import selected
from palpate_report.answer.result import Conclusion, Report


@pytest.fixture
def study(make_study):
    return make_study("Faulty", n_sets=8, n_workers=2, time_limit_s=0.5)


@pytest.mark.slow
def test_frames_of_a_sweep_with_failures(study, plugins):
    measured, design = palpate.measure(study, plugins), palpate.sample(study)
    assert measured.columns == ["spot", "channel", "point", "abscissa", "ordinate"]
    simulated = palpate.simulate(study, design, measured)
    status = dict(simulated.group_by("set_id").agg(pl.col("status").first()).iter_rows())
    assert [status[k] for k in range(5)] == ["ok", "crashed", "timed_out", "crashed", "diverged"]
    failed = simulated.filter(pl.col("set_id") == 3)
    assert failed.height == 2  # one row for each spot, without a curve
    assert failed["channel"].null_count() == 2
    assert "ZeroDivisionError" in failed["message"][0]
    scores = palpate.score(study, simulated, measured)
    chosen = palpate.select(study, scores, design)
    assert set(chosen["set_id"]) <= {0, 5, 6, 7}
    assert palpate.generalise(study, scores, design).height == 2


def test_sets_keep_their_number_when_others_are_dropped(make_study, plugins, tmp_path):
    study = make_study()
    measured, design = palpate.measure(study, plugins), palpate.sample(study)
    some = design.filter(pl.col("set_id") % 3 == 1).reverse()
    simulated = palpate.simulate(study, some, measured, folder=tmp_path / "kept")
    assert simulated["set_id"].unique(maintain_order=True).to_list() == [10, 7, 4, 1]
    scores = palpate.score(study, simulated, measured)
    whole = palpate.score(study, palpate.simulate(study, design, measured), measured)
    same = whole.filter(pl.col("set_id") % 3 == 1)
    assert scores.sort("spot", "set_id", "channel").equals(same.sort("spot", "set_id", "channel"))
    for row in palpate.select(study, whole, some).iter_rows(named=True):
        own = design.row(by_predicate=pl.col("set_id") == row["set_id"], named=True)
        assert row["set_id"] % 3 == 1
        assert {name: row[name] for name in own} == own


def test_the_frames_are_those_of_a_run(make_study, plugins, tmp_path):
    study = make_study()
    measured, design = palpate.measure(study, plugins), palpate.sample(study)
    scores = palpate.score(study, palpate.simulate(study, design, measured), measured)
    pipeline.measure(study, tmp_path / "run", plugins)
    drawn = pipeline.run_stage("sample", study, tmp_path / "run", plugins).directory.design()
    pipeline.run_stage("simulate", study, tmp_path / "run", plugins)
    kept = pipeline.run_stage("score", study, tmp_path / "run", plugins).table("scores")
    np.testing.assert_array_equal(drawn.values, design.drop("set_id").to_numpy())
    assert scores.equals(kept)
    chosen = selected(pipeline.run_stage("select", study, tmp_path / "run", plugins))
    assert palpate.select(study, scores, design).equals(chosen.selection)
    assert palpate.generalise(study, scores, design).equals(chosen.generalisation)
    warning = ReportWarning(what="A thin sweep", why="Few <sets>.")
    conclusion = Conclusion(parameters=(), bests=(), lead="c1 = 2", identifiability=(), warnings=(warning,))
    result = palpate.RunResult(
        folder=tmp_path,
        measured={},
        design=drawn,
        simulations=(),
        scores=kept,
        selected=chosen,
        fit=FitResult(),
        report=Report(tables={}, files=(), conclusion=conclusion),
    )
    assert repr(result) == f"RunResult({tmp_path}: 0 simulations, {chosen.selection.height} chosen sets)"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda d: d.drop("set_id"), "design: the frame lacks column 'set_id' .* palpate.sample"),
        (lambda d: d.rename({"soft_tissue.grip": "grip"}), "lacks column 'soft_tissue.grip'"),
        (
            lambda d: d.with_columns(pl.lit(float("nan")).alias("soft_tissue.grip")),
            "row 0, .* is not a finite number",
        ),
        (lambda d: d.with_columns(pl.lit("soft").alias("soft_tissue.grip")), "row 0, .* is not a finite num"),
        (lambda d: d.with_columns(set_id=pl.lit(3)), "duplicate set_id 3; set_id must be unique"),
        (lambda d: d.head(0), "design: the frame has no row"),
    ],
)
def test_a_frame_that_is_no_design_is_refused(make_study, plugins, change, expected):
    study = make_study()
    measured, design = palpate.measure(study, plugins), palpate.sample(study)
    with pytest.raises(StudyError, match=f"(?s){expected}"):
        palpate.simulate(study, change(design), measured)


def test_values_show_themselves(make_study, plugins):
    study = make_study()
    assert repr(study) == (
        "Study('sponge': 12 sets of soft_tissue.stiffness, soft_tissue.grip at 2 spots, solver analytic)"
    )
    more = replace(study, n_total=40, spots=study.spots[:1])
    assert repr(more).startswith(
        "Study('sponge': 40 sets of soft_tissue.stiffness, soft_tissue.grip at 1 spot,"
    )
    assert repr(study.solver) == "Analytic(offset=0.0 log='')"
    curve = Curve(channel="<torque>", abscissa=[0.0, -1.0, 1.0], ordinate=[0.0, -2.0, 2.0])
    assert repr(curve) == "Curve('<torque>': 3 points, 2 branches, -1 … 1; -2 … 2)"
    press = Curve(channel="force", abscissa=[0.0, 1.0], ordinate=[0.0, 2.0])
    assert repr(press) == "Curve('force': 2 points, 1 branch, 0 … 1; 0 … 2)"
    design = Design(parameters=study.space.parameters, values=np.ones((3, 2)), seed=1, n_drawn=4)
    assert repr(design) == "Design(3 sets of soft_tissue.stiffness, soft_tissue.grip, seed 1)"
