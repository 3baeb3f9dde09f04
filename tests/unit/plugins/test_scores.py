"""Scores: the NMSE, the example of one file, and what goes wrong with others."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.domain import Curve, Normaliser, PointWeighting, Response
from palpate.errors import PluginError, ScoringError
from palpate.plugins.registry import load_file
from palpate.plugins.score import Nmse, NmseSettings, Score, ScoringRules, weighted
from palpate.sampling.study_design import draw_study
from palpate.scoring.scores import check_scorable
from palpate.testing import ScoreContract, StudyRunner

FILE = Path(__file__).parents[3] / "examples" / "log_loading_score.py"
LOG = load_file(FILE).LogLoading
LINE = np.linspace(0.0, 4.0, 5)
PRESS = Curve(channel="force", abscissa=LINE, ordinate=LINE**2)
EVERY = np.ones(5, dtype=np.bool_)


class TestNmse(ScoreContract):
    @pytest.fixture(params=["mean_abs", "std"])
    def score(self, request):
        weighting = PointWeighting.STD if request.param == "std" else PointWeighting.EQUAL
        return Nmse(NmseSettings(point_weighting=weighting))


class TestMeanSquares(ScoreContract):
    has_unit = True

    @pytest.fixture
    def score(self):
        return Nmse(NmseSettings(normaliser=Normaliser.UNIT))


class TestLogLoading(ScoreContract):
    @pytest.fixture
    def score(self):
        return LOG()


class Sum(Score):
    """Each residual is of all ordinates so far."""

    name, summary = "sum", "differences summed up"

    def residuals(self, measured, simulated, used):
        return np.cumsum(np.where(used, simulated - measured.ordinate, 0.0), axis=-1)


class Biased(Score):
    name, summary = "biased", "one more than the differences"

    def residuals(self, measured, simulated, used):
        return simulated - measured.ordinate + 1.0


class Short(Biased):
    name = "short"

    def residuals(self, measured, simulated, used):
        return simulated[..., 1:] - measured.ordinate[1:]


class Broken(Biased):
    name = "broken"

    def residuals(self, measured, simulated, used):
        return np.full(simulated.shape, np.inf)


class Failing(Biased):
    name = "failing"

    def residuals(self, measured, simulated, used):
        raise ZeroDivisionError("by nothing")


@pytest.mark.parametrize(
    ("score", "message"),
    [
        (Biased(), "residuals against itself; they must be zero"),
        (Short(), r"score 'short' gave residuals of shape \(4,\) for ordinates of shape \(5,\)"),
        (Broken(), "score 'broken' gave a residual that is not finite"),
        (Failing(), "scoring 'force': 'failing' .* raised ZeroDivisionError: by nothing"),
    ],
)
def test_a_score_that_cannot_be_is_refused_before_anything_is_simulated(score, message):
    with pytest.raises(PluginError, match=message):
        check_scorable({"p1": Response(curves={"force": PRESS})}, ScoringRules(score=score))


def test_a_curve_without_a_point_that_counts_is_refused():
    turned = replace(PRESS, ordinate=np.array([4.0, 0.0, 0.0, 0.0, 0.0]))
    back = replace(turned, abscissa=np.array([0.0, -1.0, 2.0, 3.0, 4.0]), ordinate=turned.ordinate[::-1])
    with pytest.raises(ScoringError, match="spot 'p1', channel 'force': score 'log_loading' has no residual"):
        check_scorable({"p1": Response(curves={"force": back})}, ScoringRules(score=LOG()))


def test_points_that_are_not_used_have_no_residual():
    simulated, used = np.array([np.nan, 2.0, 5.0, np.nan, 16.0]), np.array([0, 1, 1, 0, 1], dtype=np.bool_)
    residuals = weighted(Nmse(), PRESS, simulated, used, 1.0)
    # Over Σ|exp|/n = 6, and √3 of the points.
    np.testing.assert_allclose(
        residuals, np.array([0.0, 1.0, 1.0, 0.0, 0.0]) / 6.0 / np.sqrt(3.0), rtol=1e-14
    )


def test_a_measured_curve_of_zeros_has_slopes():
    class Plain(Score):
        name, summary = "plain", "differences"

        def residuals(self, measured, simulated, used):
            return simulated - measured.ordinate

    zeros = replace(PRESS, ordinate=0.0 * LINE)
    np.testing.assert_allclose(Plain().scale(zeros, EVERY), 1.0)


def test_the_example_scores_by_relative_errors():
    softer = 0.9 * PRESS.ordinate
    used = LOG().weights(PRESS) > 0.0
    assert used.tolist() == [False, True, True, True, True]
    np.testing.assert_allclose((weighted(LOG(), PRESS, softer, used, 1.0) ** 2).sum(), np.log(0.9) ** 2)


def test_only_residuals_of_single_points_have_intervals():
    used = LOG().weights(PRESS) > 0.0
    assert Nmse().is_pointwise(PRESS, EVERY)
    assert LOG().is_pointwise(PRESS, used)
    assert not Sum().is_pointwise(PRESS, EVERY)


@pytest.mark.slow
def test_a_study_is_swept_and_fitted_by_the_score_of_a_plugin(tmp_path):
    """The truth of curves without noise is where each score is least."""
    scoring = {"score": "log_loading", "floor": 0.001}
    found = StudyRunner(tmp_path)(load_file(FILE), scoring=scoring, fit={"search": "least_squares"})
    assert found.study.scoring.score.settings.floor == 0.001
    # Force and torque are in proportion to the modulus.
    moduli, scores = draw_study(found.study).values[:, 0], found.scores
    expected = np.log(moduli[scores["set_id"].to_numpy()] / 0.55) ** 2
    np.testing.assert_allclose(scores["nmse"], expected, rtol=1e-6)
    assert scores["r2"].is_null().all()
    assert found.selection["set_id"].to_list() == [int(np.argmin(np.abs(np.log(moduli / 0.55))))]
    assert found.fitted["tissue.e"][0] == pytest.approx(0.55, rel=1e-5)
    assert found.fitted["fopt"][0] < 1e-9
