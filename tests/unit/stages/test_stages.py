"""How values show themselves."""

from dataclasses import replace

import numpy as np

import palpate
from palpate.domain import Curve, Design
from palpate.plugins.sections import ReportWarning
from palpate.run.result import FitResult
from palpate.stages import pipeline
from palpate.stages.core_stages import selected
from palpate_report.answer.result import Conclusion, Report


def test_a_result_shows_its_folder_and_its_size(make_study, plugins, tmp_path):
    study = make_study()
    pipeline.measure(study, tmp_path / "run", plugins)
    drawn = pipeline.run_stage("sample", study, tmp_path / "run", plugins).directory.design()
    pipeline.run_stage("simulate", study, tmp_path / "run", plugins)
    kept = pipeline.run_stage("score", study, tmp_path / "run", plugins).table("scores")
    chosen = selected(pipeline.run_stage("select", study, tmp_path / "run", plugins))
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
