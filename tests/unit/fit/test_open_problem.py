"""A study opened as residuals, for an optimiser of one's own."""

import numpy as np
import pytest
from scipy.optimize import least_squares

import palpate
from palpate.errors import ParameterError, StudyError
from palpate.run.ledger import Ledger

TRUTH = {"p1": (0.4, 20.0), "p2": (0.5, 25.0)}


@pytest.fixture
def opened(make_study, plugins):
    """Open the problem of the analytic tissue."""

    def made(study=None, **options):
        return palpate.open_problem(study or make_study(), plugins=plugins, **options)

    return made


def test_scipy_finds_the_tissue_and_every_evaluation_is_kept(opened, tmp_path):
    with opened(spots=["p1"], folder=tmp_path / "run") as problem:
        assert problem.names == ("soft_tissue.stiffness", "soft_tissue.grip")
        found = least_squares(
            problem.residuals, problem.start, problem.jacobian, bounds=problem.bounds, x_scale=(0.1, 10.0)
        )
        assert problem.fopt(found.x) < 1e-9
    np.testing.assert_allclose(found.x, TRUTH["p1"], rtol=1e-3)
    with Ledger(tmp_path / "run") as ledger:
        before = ledger.frame().rows()
    with opened(spots=["p1"], folder=tmp_path / "run") as problem:
        again = least_squares(
            problem.residuals, problem.start, problem.jacobian, bounds=problem.bounds, x_scale=(0.1, 10.0)
        )
    assert np.array_equal(again.x, found.x)
    with Ledger(tmp_path / "run") as ledger:
        assert ledger.frame().rows() == before


def test_a_scenario_and_several_spots(opened):
    with opened(scenario="III") as problem:
        by_force = least_squares(
            lambda stiffness: problem.residuals([stiffness[0], 20.0]), 0.3, bounds=(0.1, 1.0)
        )
    assert 0.4 < by_force.x[0] < 0.5  # between the two spots


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((0.4, 51.0), r"soft_tissue\.grip = 51 MPa is not within its range, 5 to 50; .*problem\.bounds"),
        ((float("nan"), 20.0), r"soft_tissue\.stiffness = nan"),
        ((0.4,), r"shape \(1,\); give one for each of soft_tissue\.stiffness, soft_tissue\.grip"),
    ],
)
def test_values_out_of_place_are_refused(opened, values, expected):
    with opened() as problem, pytest.raises(ParameterError, match=expected):
        problem.residuals(values)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"scenario": "IX"}, "no scenario 'IX'; name one of I, II, III"),
        ({"spots": ["p9"]}, "no spot 'p9'; name one of p1, p2"),
    ],
)
def test_an_unknown_name_is_refused(opened, options, expected):
    with pytest.raises(StudyError, match=expected), opened(**options):
        pass


def test_values_that_cannot_be_simulated_are_nan_with_the_reason(opened, make_study):
    with opened(make_study(solver="Hopeless")) as problem:
        assert np.isnan(problem.residuals(problem.start)).all()
        assert "p1: diverged: step too small" in problem.failure
        assert np.isnan(problem.jacobian(problem.start)).all()
        assert problem.fopt(problem.start) == np.inf
