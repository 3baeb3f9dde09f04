"""Scenarios that weigh a phase of a channel, from the scores to the fit and the report."""

import json
from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from palpate.domain import Curve, Response, Scenario
from palpate.errors import CurveError, ScoringError
from palpate.experiment.measured import load_measured
from palpate.fit.least_squares import LeastSquares
from palpate.fit.spot_term import SpotTerm
from palpate.plugins.parametrisation import SpotInputs
from palpate.plugins.score import ScoringRules
from palpate.run.directory import RunDirectory
from palpate.sampling.drawing import draw_design
from palpate.scoring.scores import check_scorable, score
from palpate.scoring.selection import objectives
from palpate.simulation import jobs as simulation
from palpate.stages import pipeline
from palpate_report.data.tables import weighted_channels

WHOLE = Scenario(name="I", weights={"force": 1.0, "torque": 1.0})
MIXED = Scenario(name="mixed", weights={"force": 1.0, "torque/unload": 0.5})
BACK = Scenario(name="back", weights={"torque/unload": 1.0})
OUT = Scenario(name="out", weights={"torque/load": 1.0})


@pytest.mark.parametrize(
    ("abscissa", "unload"),
    [
        ([0.0, -20.0, 0.0, 20.0, 0.0], [0, 0, 1, 0, 1]),
        ([0.0, -20.0, -1.0, 20.0, 1.0, -2.0], [0, 0, 1, 0, 1, 0]),
        ([0.0, 0.0, 5.0, 5.0, 5.0, 2.0, 2.0, 0.0, 0.0], [0, 0, 0, 0, 0, 1, 1, 1, 1]),
        ([-22.5, -10.0, 0.0, 10.0], [1, 1, 1, 0]),
    ],
)
def test_phases_go_by_the_magnitude_of_the_abscissa(abscissa, unload):
    curve = Curve(channel="torque", abscissa=abscissa, ordinate=np.ones(len(abscissa)))
    np.testing.assert_array_equal(curve.counted("torque/unload"), np.array(unload, dtype=bool))
    np.testing.assert_array_equal(curve.counted("torque/load"), ~np.array(unload, dtype=bool))
    assert curve.counted("torque").all()


def test_an_unknown_phase_is_refused_with_those_that_there_are():
    with pytest.raises(ScoringError, match=r"unknown phase 'up' of a channel .*: load, unload\)"):
        Scenario(name="x", weights={"torque/up": 1.0})


def test_a_channel_named_like_a_phase_is_refused(plugins):
    with pytest.raises(CurveError, match="channel 'torque/unload': a slash is for phases"):
        replace(plugins.channels["torque"], name="torque/unload")


def test_a_phase_without_points_is_refused():
    press = Response(curves={"torque": Curve(channel="torque", abscissa=[0.0, 1.0], ordinate=[0.0, 1.0])})
    check_scorable({"p1": press}, ScoringRules(), [WHOLE, OUT])
    with pytest.raises(ScoringError, match="spot 'p1', channel 'torque/unload': no measured point"):
        check_scorable({"p1": press}, ScoringRules(), [BACK])


def test_phases_of_a_compression_are_refused(make_study, plugins):
    study = make_study(scenarios=(BACK,), generalise_by="back")
    (file,) = study.spots[0].files
    file.write_text("".join(f"torque,{x},{y}\n" for x, y in ((1.0, 0.0), (0.7, -1.0), (1.0, 0.0))))
    torque = replace(plugins.channels["torque"], abscissa="stretch")
    with pytest.raises(CurveError, match="weighs 'torque/unload', but the stretch of 'torque' is below 1"):
        load_measured(study, {**plugins.channels} | {"torque": torque})


def test_what_a_scenario_fits():
    both = Scenario(name="b", weights={"torque/load": 1.0, "torque/unload": 2.0})
    assert [MIXED.fits(n) for n in ("force", "torque", "torque/unload", "torque/load")] == [1, 0, 1, 0]
    assert WHOLE.fits("torque/load")
    assert both.fits("torque")
    assert weighted_channels(MIXED) == "force + 0.5 × torque/unload"


@pytest.mark.parametrize("scenario", [MIXED, BACK])
def test_the_squares_of_a_term_sum_to_fopt(make_study, plugins, scenario):
    study = make_study(scenarios=(scenario,), n_sets=4, generalise_by=scenario.name)
    measured = load_measured(study, plugins.channels)
    design = draw_design(study.space, study.sampler, 4, seed=1)
    jobs = simulation.jobs(study, design, measured)
    done = [study.solver.simulate(job, None) for job in jobs]
    fopts = objectives(score(done, measured, study.scoring, study.scenarios), study.scenarios)
    for each in done:
        term = SpotTerm(
            spot=each.job.spot,
            measured=measured[each.job.spot],
            weights=scenario.weighed,
            protocol=each.job.protocol,
            materials=each.job.materials,
            rules=study.scoring,
            abscissae={},
        )
        residuals = term.residuals(each, SpotInputs(thetas=each.job.thetas, protocol=each.job.protocol))
        assert residuals.size == term.n_points == term.of_nothing().size
        fopt = fopts.filter(spot=each.job.spot, set_id=each.job.set_id)["fopt"][0]
        assert residuals @ residuals == pytest.approx(fopt, rel=1e-12)


@pytest.mark.slow
def test_a_run_with_phases_is_fitted_and_reported(make_study, plugins, tmp_path, one_figure):
    scenarios = (WHOLE, MIXED, BACK, OUT)
    study = make_study(n_sets=12, search=LeastSquares(), scenarios=scenarios)
    result = pipeline.run_study(study, tmp_path / "run", plugins)
    scores = RunDirectory(tmp_path / "run").table("scores")
    assert scores["channel"].unique(maintain_order=True).to_list() == [
        "force", "torque", "torque/unload", "torque/load",
    ]  # fmt: skip
    assert result.selected.without_result == {}
    fitted = result.fit.table.filter(scenario="mixed")
    np.testing.assert_allclose(fitted["fopt"], fitted["nmse_force"] + 0.5 * fitted["nmse_torque/unload"])
    assert fitted["soft_tissue.grip"].drop_nulls().len() == len(fitted)
    cross = result.report.tables["cross_channel"]
    assert set(cross["fitted_to"]) == {weighted_channels(scenario) for scenario in scenarios}
    left_out = result.report.tables["unfitted_channels"].filter(pl.col("scenario") == "mixed")
    assert set(left_out["unfitted"]) == {"torque", "torque/load"}
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert manifest["scenarios"]["mixed"] == {"force": 1.0, "torque/unload": 0.5}
