"""Spots whose tissues differ manifold: the mean and the spread are of each spot's own value."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from scipy.stats import norm, t as student

from palpate.api import Parameter, StudyError
from palpate.api.fit import ALL_SPOTS, Box
from palpate.domain import Prior
from palpate_certainty import posterior_sampling
from palpate_certainty.assessment import Assessment
from palpate_certainty.between_spots import by_spot, differences
from palpate_certainty.held_out import held_out
from palpate_certainty.laplace import laplace, scores_of
from palpate_certainty.posterior_sampling import PosteriorSampling
from palpate_certainty.tables import certainty_tables, density_of
from palpate_materials import Ogden
from palpate_planning.information import ExpectedError
from palpate_planning.plan import Expected
from palpate_planning.propose import PlanningStage

OWN = (0.035, 0.07, 0.19)


@pytest.fixture
def assessed_with(pressed, stage_of):
    """Assess presses on spots with values of their own, at places by their letters."""

    def made(values, prior=None, places="", **budget):
        spots = tuple(f"p{i + 1}" for i in range(len(values)))
        study = pressed.study_of(Ogden(), ("c1",), spots=spots)
        study = replace(study, budget=study.budget.model_copy(update=budget))
        if places:
            at = zip(study.spots, places, strict=True)
            study = replace(study, spots=tuple(replace(spot, mesh=Path(place)) for spot, place in at))
        if prior is not None:
            (region,) = study.space.regions
            searched = tuple(replace(parameter, prior=prior) for parameter in region.searched)
            study = replace(study, space=replace(study.space, regions=(replace(region, searched=searched),)))
        of_each = zip(spots, values, range(1, len(values) + 1), strict=True)
        measured = {s: pressed.measured_at(study, np.array([c1]), 0.004, seed) for s, c1, seed in of_each}
        stage = Assessment(study=study, measured=measured)
        return study, stage, stage.assessed(stage_of(study, measured).run())

    return made


@pytest.mark.slow
def test_budget_combinations_and_plans_have_the_intervals_of_the_mean(assessed_with):
    study, stage, assessed = assessed_with((0.066, 0.071, 0.078))
    joint, tables = assessed[0], certainty_tables(assessed, study)
    assert joint.errors.between is not None
    (mean,) = tables["intervals"].filter(fit=ALL_SPOTS).to_dicts()
    length, normal = mean["upper"] - mean["lower"], 2.0 * norm.ppf(0.975)
    budget = tables["budget"].filter(fit=ALL_SPOTS)
    assert normal * np.sqrt((budget["sd"] ** 2).sum()) == pytest.approx(length, rel=0.1)
    assert budget["share"].sum() == pytest.approx(1.0)
    assert budget["cause"][0] == "spots"
    (combination,) = tables["parameter_combinations"].filter(fit=ALL_SPOTS).to_dicts()
    assert combination["relative_width"] == pytest.approx(length / mean["value"], rel=0.1)
    assert combination["identifiability"] == mean["identifiability"]
    planning = PlanningStage(
        study=study, measured=stage.measured, assessed=joint, columns=stage.columns(joint.case)[0], meshes={}
    )
    design = planning.design()
    planned = ExpectedError(covariance=np.eye(1), by_meshes=np.zeros((1, 0)), freedom=1.0)
    now = Expected(
        fit=design.laplace,
        within=partial(density_of, problem=design.problem, along=design.along),
        shared=design.shared,
        before=planned,
    ).after(planned)
    width = study.space.parameters[0].upper - study.space.parameters[0].lower
    assert np.diff(now.interval(joint.point), axis=0)[0, 0] * width == pytest.approx(length, rel=1e-6)


def fit_of(scenario, between):
    case = SimpleNamespace(scenario=SimpleNamespace(name=scenario), label=ALL_SPOTS)
    end, missed = SimpleNamespace(problem=None), np.zeros(1)
    return SimpleNamespace(case=case, errors=SimpleNamespace(between=between), end=end, missed=missed)


@pytest.fixture
def sampling(monkeypatch):
    """Sample posteriors, each of which is its fit."""
    nothing = SimpleNamespace(parameters=())
    for name in ("SimulatedCurves", "EmulatedCurves"):
        monkeypatch.setattr(posterior_sampling, name, lambda *_: nothing)
    methods = {
        "_first_runs": lambda *_: None,
        "_sampled": lambda _, each, __: each,
        "_converged": lambda _, each: each,
        "_profiles": lambda *_: ([], []),
    }
    for name, method in methods.items():
        monkeypatch.setattr(PosteriorSampling, name, method)
    study = SimpleNamespace(generalise_by="I", scenarios=())
    return PosteriorSampling(study=study, design=None, swept=())


def test_spots_that_differ_have_no_posterior_of_one_value_for_all(sampling):
    with pytest.raises(StudyError, match="the spots differ in every scenario"):
        sampling.run([], [fit_of("I", object()), fit_of("II", object())])


def test_posteriors_are_of_the_joint_fits_whose_spots_are_alike(sampling):
    fits = [fit_of("I", object()), fit_of("II", None)]
    assert sampling.run([], fits).posteriors == fits[1:]


@pytest.mark.slow
def test_the_mean_and_the_spread_are_those_of_the_own_values(assessed_with):
    study, _, assessed = assessed_with(OWN)
    (parameter,) = study.space.parameters
    joint, tables = assessed[0], certainty_tables(assessed, study)
    own = tables["intervals"].filter(pl.col("fit") != ALL_SPOTS)
    assert own["value"].to_list() == pytest.approx(list(OWN), rel=0.05)
    (mean,) = tables["intervals"].filter(fit=ALL_SPOTS).to_dicts()
    logs = np.log(own["value"].to_numpy())
    assert mean["value"] == pytest.approx(np.exp(logs.mean()), rel=0.01)
    assert mean["lower"] < min(OWN) * 2.0
    (row,) = tables["between_spots"].to_dicts()
    assert row["value"] == mean["value"]
    # The errors of the own values are taken off.
    assert row["sd"] / row["value"] == pytest.approx(logs.std(ddof=1), rel=0.03)
    assert row["lower"] < row["sd"] < row["upper"]
    assert joint.verdict.value == "describes"
    # The largest difference is one of the own fits, within their noise.
    assert max(misfit.share for misfit in joint.misfits.values()) < 0.05
    drawn = tables["spot_draws"][parameter.name]
    assert drawn.is_between(parameter.lower, parameter.upper).all()
    assert drawn.min() < min(OWN) < max(OWN) < drawn.max()
    assert held_out(joint)["inside"].all()


def test_two_spots_differ_from_each_other_by_twice_the_variance(assessed_with):
    _, _, assessed = assessed_with((0.06, 0.08))
    table = held_out(assessed[0])
    assert table["inside"].all()
    # Their standard deviation is by this one difference: Student's t of one degree exceeds 1 half the times.
    assert table["probability"].to_list() == pytest.approx([0.5] * 4, abs=0.1)


def test_presses_at_one_place_are_one_spot(assessed_with):
    study, _, (one_each, *_) = assessed_with((0.06, 0.08))
    _, _, assessed = assessed_with((0.06, 0.06, 0.08, 0.08), places="aabb")
    joint, own = assessed[0], assessed[0].linear.own.point
    found, expected = joint.errors.between, one_each.errors.between
    assert found.freedom == expected.freedom == 1.0
    np.testing.assert_array_equal(own[::2], own[1::2])
    np.testing.assert_allclose(found.sd, expected.sd, rtol=0.1)
    np.testing.assert_allclose(joint.values, one_each.values, rtol=0.02)
    (row,) = certainty_tables(assessed, study)["between_spots"].to_dicts()
    assert row["n_spots"] == 2
    # The other press at the place tells more of its tissue than another spot does.
    table, others = held_out(joint), held_out(one_each)
    assert table["inside"].all()
    assert table["band"].max() < 0.3 * others["band"].min()


def test_presses_at_one_place_with_values_of_their_own_are_no_spots_that_differ(assessed_with):
    _, _, (joint, *_) = assessed_with((0.06, 0.08), places="aa")
    assert joint.errors.between is None
    assert joint.errors.alike is None


def test_spots_that_differ_have_intervals_with_a_prior_on_what_they_share(assessed_with):
    prior = Prior(value=0.07, sd=0.002)
    study, _, assessed = assessed_with((0.066, 0.071, 0.078), prior)
    assert assessed[0].errors.between is not None
    intervals = certainty_tables(assessed, study)["intervals"]
    (mean,) = intervals.filter(fit=ALL_SPOTS).to_dicts()
    assert mean["lower"] < prior.value < mean["upper"]
    assert 0.5 * (mean["upper"] - mean["lower"]) < 2.0 * prior.sd


def test_drift_by_the_measured_peak_is_the_same_along_the_curves_of_each_spot(assessed_with):
    _, _, (joint, *_) = assessed_with((0.06, 0.08), zero=0.01)
    around, own = joint.linear.known, joint.linear.own.known
    np.testing.assert_array_equal(own["zero"], around["zero"])
    assert not np.allclose(own["gain"], around["gain"], rtol=0.05)


def test_spots_that_are_alike_are_not_simulated_at_values_of_their_own(assessed_with, monkeypatch):
    monkeypatch.setattr(Assessment, "_own", lambda *_: pytest.fail("simulated"))
    _, _, (joint, *_) = assessed_with((0.07, 0.07))
    assert joint.errors.between is None


def found_by(residuals, jacobian, causes, rows, points, box, joint):
    """Differences between spots, whose curves are linear around points."""
    slopes = by_spot(jacobian, rows)
    scores = scores_of(slopes, rows.curve)
    own = laplace(np.zeros(slopes.shape[1]), residuals, slopes, causes, scores)
    known = rows.channel < 0
    size = causes["priors"][known] if known.any() else np.empty((0, 0))
    prior = residuals[known], jacobian[known], size @ size.T, joint
    return differences(own, jacobian, rows, points, box, prior)


def box_of(log):
    """Range of a modulus from 1 to the exponential of ``log``, or one of a number that is no logarithm."""
    ends = (1.0, float(np.exp(log))) if log else (0.0, 1.0)
    kind = "modulus" if log else "shape"
    return Box([Parameter(name="c1", unit="MPa", lower=ends[0], upper=ends[1], kind=kind, description="")])


@pytest.mark.parametrize("sd", [0.1, 0.7])
def test_spots_that_differ_manifold_with_errors_in_proportion(sd):
    """Curves in proportion to a modulus of 1 to 100, with an error of all, of each, and of each point."""
    n_spots, n, log, width = 6, 10, np.log(100.0), 99.0
    spot, box = np.repeat(np.arange(n_spots), n), box_of(log)
    rows = SimpleNamespace(site=spot, spot=spot, channel=np.zeros(spot.size, dtype=int), curve=spot)
    shape, rng = np.tile(np.linspace(0.1, 1.0, n), n_spots), np.random.default_rng(3)
    held, spread = [], []
    for _ in range(60):
        true = 10.0 * np.exp(sd * rng.normal(size=n_spots))
        seen = true * (1.0 + 0.1 * rng.normal() + 0.05 * rng.normal(size=n_spots))
        curves = shape * (seen[spot] + 0.02 * true[spot] * rng.normal(size=spot.size))
        # As Fopt weighs them: each over its own largest ordinate.
        jacobian = (width * shape / true[spot])[:, None]
        fitted = shape * seen[spot] / true[spot]
        causes = {
            "gain": 0.1 * fitted[:, None],
            "place": 0.05 * fitted[:, None] * (spot[:, None] == np.arange(n_spots)),
            "noise": np.diag(0.02 * shape),
        }
        points = ((seen - 1.0) / width)[:, None]
        residuals = fitted - curves / true[spot]
        found = found_by(residuals, jacobian, causes, rows, points, box, np.zeros(1))
        mean, sd_of_mean = box.coordinates(1.0 + width * found.point), found.mean.covariance[0, 0] ** 0.5
        most = student.ppf(0.975, n_spots - 1) * sd_of_mean / found.rates[0]
        held.append(abs(mean[0] - np.log(10.0) / log) < most)
        low, high = found.ends[0] * log
        spread.append(low <= sd <= high)
        assert np.sum(list(found.mean.parts.values()), axis=0) == pytest.approx(found.mean.covariance)
        np.testing.assert_allclose(1.0 + width * (points + found.own)[:, 0], seen, rtol=0.08)
    assert np.mean(held) >= 0.9
    assert np.mean(spread) >= 0.9


@pytest.mark.parametrize("log", [0.0, np.log(100.0)])
@pytest.mark.parametrize("has_prior", [True, False])
def test_a_prior_holds_the_mean_and_spots_without_a_parameter_tell_nothing_of_its_spread(log, has_prior):
    n, own = 10, np.array([0.3, 0.4, 0.5])
    spot = np.array([*np.repeat(np.arange(5), n), *([-1] * has_prior)])
    rows = SimpleNamespace(site=spot, spot=spot, channel=np.where(spot < 0, -1, 0), curve=spot)
    slopes = np.where((spot >= 0) & (spot < 3), np.tile(np.linspace(0.1, 1.0, n), 6)[: spot.size], 0.0)
    slopes[spot < 0] = 1.0
    joint = np.array([0.4])
    residuals = slopes * (joint - np.append(own, [0.0, 0.0, 0.2])[spot])
    causes = {
        "noise": np.diag(np.where(spot < 0, 0.0, 0.01)),
        "priors": np.diag(np.where(spot < 0, 1e-4, 0.0)),
    }
    of_all, box = np.tile(joint, (5, 1)), box_of(log)
    made = found_by(residuals, slopes[:, None], causes, rows, of_all, box, joint)
    middle = np.expm1(np.log1p(np.expm1(log) * own).mean()) / np.expm1(log) if log else 0.4
    assert made.point[0] == pytest.approx(0.2 if has_prior else middle, abs=1e-3)
    if has_prior:
        assert made.mean.sd[0] == pytest.approx(1e-4, rel=0.01)
        assert made.mean.shares["priors"][0] == pytest.approx(1.0, abs=0.01)
    assert made.seen.sum() == 3
    assert made.freedom == 2.0
    of_three = spot < 3
    alone = SimpleNamespace(
        site=spot[of_three], spot=spot[of_three], channel=rows.channel[of_three], curve=spot[of_three]
    )
    if not has_prior:
        few = {"noise": causes["noise"][np.ix_(of_three, of_three)]}
        same = found_by(residuals[of_three], slopes[of_three, None], few, alone, of_all[:3], box, joint)
        np.testing.assert_allclose(made.ends, same.ends, rtol=1e-6)
