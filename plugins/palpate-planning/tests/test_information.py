"""FisherInformation adds up to the covariance of the joint fit."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import stats

from palpate.domain import Curve, Parameter
from palpate.fit.alike import correction_like
from palpate.fit.spot_term import Correction
from palpate_certainty.assumptions import ASSUMED
from palpate_certainty.laplace import Laplace, laplace, scores_of
from palpate_certainty.linear_problem import LinearProblem
from palpate_certainty.noise_model import ResidualLayout
from palpate_planning.information import (
    ErrorSizes,
    ExpectedError,
    FisherInformation,
    cause_name,
    press_information,
)
from palpate_planning.plan import Expected, Goal, Plan

ERRORS = ErrorSizes(
    noise={"force": 0.01, "torque": 0.02},
    discrepancy={"force": 0.005, "torque": 0.01},
    correlations={(0.0, 0.35): 0.5, (1.0, 0.8): 0.5},
)


def _press(rng, n=24, span=1.0):
    """Slopes, rows and causes of a press with two channels of n points each."""
    slopes = rng.normal(size=(2 * n, 3)) + np.linspace(0.0, 3.0, 2 * n)[:, None]
    rows = ResidualLayout(
        spot=np.zeros(2 * n, dtype=int),
        site=np.zeros(2 * n, dtype=int),
        channel=np.repeat([0, 1], n),
        point=np.tile(np.arange(n, dtype=float), 2),
        path=np.tile(np.linspace(0.0, span, n), 2),
        scale=np.full(2 * n, 0.3),
        envelope=np.tile(np.linspace(0.0, 0.3, n), 2),
    )
    known = {
        "gain: force": rng.normal(size=2 * n) * 0.01,
        cause_name("onset", "onset", "p1"): rng.normal(size=2 * n) * 0.01,
    }
    return slopes, rows, known


def _information(press, site):
    slopes, rows, known = press
    linear = LinearProblem(
        point=np.full(3, 0.5),
        residuals=np.zeros(len(slopes)),
        jacobian=slopes,
        rows=rows,
        known={name: column[:, None] for name, column in known.items()},
        channels=("force", "torque"),
        expected={},
    )
    return press_information(linear, np.zeros(3, dtype=bool), ERRORS, site=site)


@settings(max_examples=10)
@given(seed=st.integers(0, 10_000), same=st.booleans())
def test_rows_that_are_added_are_those_of_direct_inverse(seed, same):
    rng = np.random.default_rng(seed)
    sites = ["p1", "p1" if same else "p2", "p1"]
    spans = [1.0, 1.0, 2.0]
    each = [_information(_press(rng, span=span), site) for span, site in zip(spans, sites, strict=True)]
    each[2] = each[2].again("p1", 1)
    found = (each[0] + each[1] + each[2]).covariance(range_sd=1.0)
    # Every cause as one more parameter, with a prior of variance 1: one inverse of all of them.
    widths = {}
    for press in each:
        for name, part in press.causes[0].items():
            widths[name] = max(widths.get(name, 0), part.shape[1])
    rows = []
    for press in each:
        (causes,) = press.causes
        n = len(press.root)
        padded = [
            np.pad(part, ((0, 0), (0, m - part.shape[1])))
            for name, m in widths.items()
            for part in [causes.get(name, np.zeros((n, 0)))]
        ]
        rows.append(np.concatenate([press.root @ press.scores, *padded], axis=1))
    every = np.concatenate(rows)
    expected = np.linalg.inv(every.T @ every + np.eye(every.shape[1]))[:3, :3]
    assert found == pytest.approx(expected, rel=1e-6)


def _of_joint_fit(presses, sites):
    """Covariance by the residuals of all presses together."""
    slopes = np.concatenate([press[0] for press in presses])
    rows = [press[1] for press in presses]
    names = ("channel", "point", "path", "scale", "envelope")
    joined = {name: np.concatenate([getattr(each, name) for each in rows]) for name in names}
    number = np.repeat(np.arange(len(presses)), [len(press[0]) for press in presses])
    place = np.array([sorted(set(sites)).index(site) for site in sites])[number]
    together = ResidualLayout(spot=number, site=place, **joined)
    covariance = np.zeros((len(slopes),) * 2)
    for i, channel in enumerate(("force", "torque")):
        for (points, length), probability in ERRORS.correlations.items():
            covariance += probability * ERRORS.noise[channel] ** 2 * together.noise(i, points)
            covariance += probability * ERRORS.discrepancy[channel] ** 2 * together.discrepancy(i, length)
    values, vectors = np.linalg.eigh(covariance)
    causes = {"errors": vectors * np.sqrt(np.maximum(values, 0.0))}
    for name in presses[0][2]:
        causes[name] = np.concatenate([press[2][name] for press in presses])[:, None]
    scores = scores_of(slopes, together.curve)
    fit = laplace(np.full(3, 0.5), np.zeros(len(slopes)), slopes, causes, scores, range_sd=1.0)
    return fit.covariance


@given(
    seed=st.integers(0, 10_000),
    same=st.booleans(),
    span=st.sampled_from([1.0, 2.0]),
)
def test_sum_is_covariance_of_joint_fit(seed, same, span):
    rng = np.random.default_rng(seed)
    presses = [_press(rng), _press(rng, span=span)]
    sites = ["p1", "p1" if same else "p2"]
    one, two = (_information(press, site) for press, site in zip(presses, sites, strict=True))
    found = (one + two).covariance(range_sd=1.0)
    expected = _of_joint_fit(presses, sites)
    sizes = np.sqrt(np.diag(expected))
    assert np.abs(found - expected).max() <= 0.02 * np.outer(sizes, sizes).max()
    assert np.sqrt(np.diag(found)) == pytest.approx(sizes, rel=0.02)


@given(seed=st.integers(0, 10_000))
def test_a_repeated_press_leaves_the_part_of_the_mesh_as_it_is(seed):
    """Both err alike: a coarse mesh is too stiff, so that what the finer one adds is below zero."""
    rng = np.random.default_rng(seed)
    depths = np.linspace(0.5, 10.0, 20)
    slopes = np.cumsum(rng.random((20, 3)), axis=0) ** [[1.0, 1.5, 2.0]]
    coarse = slopes @ [1.0, 0.3, 0.1]
    correction = Correction(added=-(0.03 + 0.01 * rng.random(20)) * coarse, coarse=coarse)
    curve = Curve(channel="force", abscissa=depths, ordinate=1.02 * coarse)
    term = SimpleNamespace(corrections={"force": correction}, measured={"force": curve})

    def information(added):
        # Next to no noise.
        scores = np.linalg.svd(slopes, full_matrices=False)[0].T / 3e-5
        return FisherInformation.of(scores @ slopes, {cause_name("mesh", ""): (scores @ added)[:, None]})

    once = information(correction.at(curve.ordinate))
    again = information(correction_like(term, "force", curve.abscissa, curve.ordinate).at(curve.ordinate))
    expected, found = once.covariance(1e6), (once + again).covariance(1e6)  # no prior
    sizes = np.sqrt(np.diag(expected))
    assert np.abs(found - expected).max() <= 1e-3 * np.outer(sizes, sizes).max()


def _meshed(seed, amplitude=1.0, signs=(1.0,) * 4):
    """Three presses of two curves each, of which the last repeats the second; with columns of mesh errors."""
    rng = np.random.default_rng(seed)
    presses = []
    for _ in range(2):
        columns = rng.normal(size=(4, 12))
        causes = {"gain: force": columns[2][:, None], "onset: p": columns[3][:, None]}
        for k, name in enumerate(("force", "torque")):
            rows = np.repeat([k == 0, k == 1], 6)
            sign = signs[2 * len(presses) + k]
            whole = (amplitude * sign * rows * columns[k])[:, None]
            causes[cause_name("mesh", name)] = np.sqrt(ASSUMED.mesh_shared) * whole
            causes[cause_name("mesh", f"p{len(presses)} {name}")] = np.sqrt(1.0 - ASSUMED.mesh_shared) * whole
        presses.append(FisherInformation.of(3.0 * rng.normal(size=(12, 3)), causes))
    return presses[0] + presses[1] + presses[1].again("p1", 1)


def _brute_force(information, along):
    """Largest change of one combination of parameters over all signs, by the normal equations."""
    covariance, root = information.covariance(), information.root
    fit = covariance @ information.scores.T @ np.linalg.inv(root)
    columns = {}
    for k, causes in enumerate(information.causes):
        for name in (name for name in causes if name.startswith("mesh")):
            columns.setdefault(name, np.zeros(len(root)))[12 * k : 12 * k + 12] += causes[name][:, 0]
    assert len(columns) == 6  # of each channel: shared by all presses, and of two places
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=6)))
    return np.abs(signs @ np.array(list(columns.values())) @ (along @ fit)).max()


def test_a_press_that_is_made_again_draws_its_own_causes_again():
    names = [
        cause_name("onset", "onset", "p1"),
        cause_name("onset", "onset", "p11"),
        cause_name("gain", "force"),
    ]
    once = FisherInformation.of(np.zeros((1, 3)), dict.fromkeys(names, np.ones((1, 1))))
    (again,) = once.again("p1", 2).causes
    assert list(again) == ["onset: onset of p1 2", "onset: onset of p11", "gain: force"]


@given(seed=st.integers(0, 10_000))
def test_mesh_bias_is_the_largest_over_all_signs(seed):
    information = _meshed(seed)
    along = np.random.default_rng(seed).normal(size=3)
    (found,) = information.expected_error().mesh_bias(along[None])
    assert found == pytest.approx(_brute_force(information, along), rel=1e-9)


@given(seed=st.integers(0, 10_000), signs=st.tuples(*[st.sampled_from([-1.0, 1.0])] * 4))
def test_mesh_bias_does_not_depend_on_the_signs_of_errors(seed, signs):
    """The covariance does: it takes the error of a channel as one number, so flip all curves of a channel."""
    signs = (*signs[:2], *signs[:2])
    each = np.eye(3)
    one, other = (_meshed(seed, signs=s).expected_error() for s in ((1.0,) * 4, signs))
    np.testing.assert_allclose(one.mesh_bias(each), other.mesh_bias(each), rtol=1e-9)
    np.testing.assert_allclose(one.rms(each), other.rms(each), rtol=1e-9)


@given(seed=st.integers(0, 10_000), amplitude=st.floats(0.0, 10.0))
def test_error_at_worst_is_no_less_than_the_standard_deviation(seed, amplitude):
    error, each = _meshed(seed, amplitude).expected_error(), np.eye(3)
    sds, biases = np.sqrt(np.diag(error.covariance)), error.mesh_bias(each)
    assert (biases >= 0.0).all()
    assert (error.rms(each) >= sds * (1.0 - 1e-12)).all()
    parameters = [
        Parameter(name=f"a.{i}", unit="", lower=0.0, upper=1.0, kind="shape", description="")
        for i in range(3)
    ]
    for name in ("all", "worst", "a.1"):
        goal = Goal(name=name, parameters=tuple(parameters), values=np.full(3, 0.5))
        alone = ExpectedError(covariance=error.covariance, by_meshes=np.zeros((3, 0)))
        assert goal.error(error) >= goal.error(alone) * (1.0 - 1e-12)


@given(seed=st.integers(0, 10_000), factor=st.floats(1.0, 10.0))
def test_mesh_bias_is_proportional_to_the_error_for_one_fit(seed, factor):
    error, each = _meshed(seed).expected_error(), np.eye(3)
    larger = replace(error, by_meshes=factor * error.by_meshes)
    np.testing.assert_allclose(larger.mesh_bias(each), factor * error.mesh_bias(each), rtol=1e-12)
    assert (larger.rms(each) >= error.rms(each) * (1.0 - 1e-12)).all()


def _at(site):
    """A press of a place, where the first parameter differs from place to place by 0.05 of its range."""
    slopes = 100.0 * np.stack([np.ones(12), np.arange(12.0)], axis=1)
    return FisherInformation.of(slopes, {f"spots: a.0 {site}": 0.05 * slopes[:, :1]})


@pytest.fixture
def plan():
    """Plan of presses at two places that differ."""
    so_far = [SimpleNamespace(at=[SimpleNamespace(information=_at(site))]) for site in ("p1", "p2")]
    parameters = tuple(
        Parameter(name=f"a.{i}", unit="", lower=0.0, upper=1.0, kind="shape", description="") for i in "01"
    )
    goal = Goal(name="a.0", parameters=parameters, values=np.full(2, 0.5))
    known = FisherInformation.of(np.zeros((1, 2)), {"prior": np.zeros((1, 0))})
    return Plan(so_far, goal, known, 1, ErrorSizes(noise={}, discrepancy={}, freedom=9.0))


def _press_at(site):
    at = [SimpleNamespace(information=_at(site))]
    return SimpleNamespace(press=SimpleNamespace(name=site), at=at, peaks={})


def test_degrees_of_freedom_follow_the_places_that_are_planned(plan):
    """A mean of n places that differ has n - 1; a press that is repeated at a place adds none."""
    again, further = map(_press_at, ("p2", "p3"))
    first, second = plan.ranked([again, further])
    assert first.press is further
    assert second.error.freedom == pytest.approx(plan.error.freedom, rel=0.1)
    assert first.error.freedom == pytest.approx(2.0 * plan.error.freedom, rel=0.1)
    raw = first.error.covariance[0, 0] / plan.error.covariance[0, 0]
    student = stats.t.ppf(0.975, first.error.freedom) / stats.t.ppf(0.975, plan.error.freedom)
    assert first.widths[0] == pytest.approx(student * np.sqrt(raw), rel=0.1)


@pytest.mark.parametrize(("sites", "n"), [((), 2), (("p3",), 3), (("p3", "p4"), 4)])
def test_planned_widths_are_those_of_simulated_places(plan, sites, n):
    """Half the interval of a mean of n normal values is t(n - 1) s / sqrt(n), by their own spread s."""
    own = np.random.default_rng(n).normal(size=(20_000, n))
    now, then = own[:, :2].std(axis=1, ddof=1), own.std(axis=1, ddof=1)
    realised = stats.t.ppf(0.975, n - 1.0) * then / np.sqrt(n)
    for site in sites:
        plan.add(_press_at(site))
    planned = stats.norm.ppf(0.975) * plan.error.sds[0] / 0.05 * now
    assert np.sqrt(np.mean(planned**2)) == pytest.approx(np.sqrt(np.mean(realised**2)), rel=0.05)


def test_scale_of_errors_is_better_known_by_more_presses():
    """Two presses add 4 degrees of freedom to the prior's, so one more adds 2."""
    errors = ErrorSizes(noise={}, discrepancy={}, freedom=ASSUMED.scale_freedom + 4.0)
    assert errors.freedom_by(1, 2) == ASSUMED.scale_freedom + 6.0
    assert errors.freedom_by(0, 0) == errors.freedom


def test_without_an_error_of_the_mesh_there_is_no_bias():
    error, each = _meshed(0, amplitude=0.0).expected_error(), np.eye(3)
    assert not error.mesh_bias(each).any()
    np.testing.assert_allclose(error.rms(each), np.sqrt(np.diag(error.covariance)), rtol=1e-12)


@given(seed=st.integers(0, 10_000), shrunk=st.floats(0.1, 1.0))
def test_expected_density_begins_at_the_fit_and_leaves_what_is_of_one_spot(seed, shrunk):
    """Given what all presses share, a further press tells nothing of another one's onset."""
    rng, shared = np.random.default_rng(seed), [0, 2]
    root = rng.normal(size=(3, 3)) + 3.0 * np.eye(3)
    fit = Laplace(centre=rng.uniform(size=3), covariance=root @ root.T, parts={}, freedom=3.0)
    planned = fit.covariance[np.ix_(shared, shared)] + 0.1 * np.eye(2)
    before = ExpectedError(covariance=planned, by_meshes=np.zeros((2, 0)), freedom=2.0)
    found = []
    expected = Expected(
        fit=fit, within=lambda each: found.append(each) or each.within(), shared=shared, before=before
    )
    assert expected.after(before).points.shape[1] == 2
    expected.after(replace(before, covariance=shrunk * planned, freedom=4.0))
    assert [each.freedom for each in found] == [3.0, 6.0]
    now, later = (each.covariance for each in found)
    np.testing.assert_allclose(now, fit.covariance, rtol=1e-9)
    both = np.ix_(shared, shared)
    np.testing.assert_allclose(later[both], shrunk * now[both], rtol=1e-9)
    for each in (now, later):
        own = each[1, 1] - each[1, shared] @ np.linalg.solve(each[both], each[shared, 1])
        np.testing.assert_allclose(own, 1.0 / np.linalg.inv(fit.covariance)[1, 1], rtol=1e-6)
