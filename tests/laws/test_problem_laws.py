"""Laws of the problem that a fit solves: Σ r² is the Fopt of the scores, and slopes are derivatives."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.domain import (
    Curve,
    HomogeneousTests,
    Normaliser,
    Parameter,
    ParameterSpace,
    PointWeighting,
    Prior,
    RegionMaterial,
    Response,
    Scenario,
    Simulation,
    Status,
)
from palpate.domain.channels import PRESS_AND_TWIST
from palpate.domain.material import IsotropicMaterial
from palpate.fit.parametrisation import StandardParametrisation
from palpate.fit.problem import Problem
from palpate.fit.spot_term import term_of
from palpate.plugins.interfaces import Solver
from palpate.plugins.provides import Provides
from palpate.plugins.score import Nmse, NmseSettings, ScoringRules
from palpate.scoring.scores import score
from palpate.scoring.selection import objectives

SCENARIOS = [
    Scenario(name="I", weights={"force": 1.0, "torque": 1.0}),
    Scenario(name="II", weights={"torque": 0.7}),
    Scenario(name="III", weights={"force": 2.0, "torque": 0.0}),
    Scenario(name="IV", weights={"force": 1.0, "torque/unload": 0.5}),
]
DEPTH, TURN = np.linspace(0.0, 10.0, 12), np.array([0.0, -1.0, -2.0, -1.0, 0.0, 1.0, 2.0, 1.0, 0.0])


class Two(IsotropicMaterial):
    name, summary = "two", "two numbers"
    parameters = (
        Parameter(name="k", unit="MPa", lower=0.5, upper=4.0, kind="modulus", description="stiffness"),
        Parameter(name="a", unit="1", lower=-1.0, upper=1.0, kind="shape", description="form"),
    )

    def energy(self, stretches, theta):
        return theta[0] * ((stretches - 1.0) ** 2).sum(axis=-1)


class Formula(Solver):
    """Smooth curves, cut short where a test asks for it."""

    name, summary = "formula", "closed form"
    reach = (1.0, 1.0)
    seed = 1
    exact = False
    status = Status.OK

    @property
    def provides(self):
        return Provides(body="layers", slopes=self.exact, accuracy=1e-6)

    def simulate(self, job, limb):
        k, a = job.thetas["tissue"]
        wave = np.random.default_rng([self.seed, len(job.spot)]).normal(size=TURN.size)
        parts = {
            "force": (DEPTH, DEPTH * (1.0 + a * DEPTH / 10.0), DEPTH**2 / 10.0),
            "torque": (TURN, wave * np.exp(a) + TURN, wave * np.exp(a)),
        }
        curves = {}
        for (name, (x, y, by_a)), reach in zip(parts.items(), self.reach, strict=True):
            n = max(2, round(reach * x.size))
            slopes = {"tissue.k": y[:n], "tissue.a": k * by_a[:n]} if job.slopes else {}
            curves[name] = Curve(channel=name, abscissa=x[:n], ordinate=k * y[:n], slopes=slopes)
        return Simulation(job=job, status=self.status, response=Response(curves=curves))


def measured(seed, spots):
    found = {}
    for spot in spots:
        rng = np.random.default_rng([seed, len(spot), 7])
        found[spot] = Response(
            curves={
                name: Curve(
                    channel=name,
                    abscissa=x,
                    ordinate=offset + rng.normal(size=x.size),
                    std=rng.uniform(0.01, 1.0, x.size),
                )
                for name, x, offset in (("force", DEPTH, 5.0), ("torque", TURN, 3.0))
            }
        )
    return found


def problem_of(scenario, responses, rules, solver, prior=None):
    k, a = Two.parameters
    searched = (k, replace(a, prior=prior))
    region = RegionMaterial(region="tissue", material=Two(), searched=searched, fixed={})
    study = SimpleNamespace(
        space=ParameterSpace(regions=(region,)),
        scoring=rules,
        solver=solver,
        filters=(),
        protocol_at=lambda spot: HomogeneousTests(paths={}),
        observed=lambda channels: PRESS_AND_TWIST,
        site_of=lambda spot: spot,
    )
    abscissae = {"force": "depth_mm", "torque": "rotation_deg"}
    terms = [term_of(study, spot, scenario, response, abscissae) for spot, response in responses.items()]

    def simulate(jobs):
        return [solver.simulate(job, None) for job in jobs]

    return Problem(study, terms, simulate, StandardParametrisation(), noise=0.02)


def solver_of(seed, **changes):
    solver = Formula()
    solver.seed = seed
    for name, value in changes.items():
        setattr(solver, name, value)
    return solver


values_of = st.tuples(st.floats(0.5, 4.0), st.floats(-1.0, 1.0)).map(np.array)
seeds = st.integers(0, 10_000)
every_spots = st.sampled_from([("p",), ("p", "q2"), ("p", "q2", "r33")])


@given(
    seeds,
    values_of,
    every_spots,
    st.sampled_from(SCENARIOS),
    st.sampled_from(Normaliser),
    st.sampled_from(PointWeighting),
    st.tuples(st.floats(0.6, 1.0), st.floats(0.6, 1.0)),
    st.booleans(),
)
def test_the_squares_sum_to_the_fopt_of_the_scores(
    seed, values, spots, scenario, normaliser, weighting, reach, is_partial
):
    rules = ScoringRules(
        score=Nmse(NmseSettings(normaliser=normaliser, point_weighting=weighting)),
        minimum_coverage=0.4,
        rank_partial=is_partial,
    )
    solver = solver_of(seed, reach=reach, status=Status.DIVERGED if is_partial else Status.OK)
    responses = measured(seed, spots)
    problem = problem_of(scenario, responses, rules, solver)
    residuals = problem.residuals(values)
    jobs = [term.job(problem.inputs(term.spot, problem.box.point(values)), 0, slopes=False, fine=False)
            for term in problem.terms]  # fmt: skip
    scores = score([solver.simulate(job, None) for job in jobs], responses, rules, [scenario])
    ranked = objectives(scores, [scenario])
    if ranked.height < len(spots):  # a curve does not reach far enough at one of them
        assert np.isnan(residuals).all()
        assert problem.failure
        return
    assert residuals @ residuals == pytest.approx(ranked["fopt"].mean(), rel=1e-12)
    assert problem.fopt(values) == pytest.approx(ranked["fopt"].mean(), rel=1e-12)


@given(seeds, values_of, every_spots, st.sampled_from(SCENARIOS), st.booleans(), st.booleans())
def test_the_jacobian_is_the_derivative_of_the_residuals(seed, values, spots, scenario, exact, has_prior):
    values = np.clip(values, (0.6, -0.9), (3.9, 0.9))
    prior = Prior(value=0.2, sd=0.1) if has_prior else None
    rules = ScoringRules(minimum_coverage=0.4)
    solver = solver_of(seed, exact=exact, reach=(0.8, 1.0))
    problem = problem_of(scenario, measured(seed, spots), rules, solver, prior)
    jacobian = problem.jacobian(values)
    for i, step in enumerate(1e-5 * np.eye(2)):
        central = (problem.residuals(values + step) - problem.residuals(values - step)) / 2e-5
        scale = np.abs(central).max() + 1e-12
        assert np.abs(jacobian[:, i] - central).max() <= (1e-6 if exact else 3e-3) * scale
    assert problem.n_points == jacobian.shape[0] == problem.residuals(values).size


@given(seeds, st.sampled_from(SCENARIOS))
def test_several_spots_together_are_the_mean_of_each(seed, scenario):
    rules, responses, values = ScoringRules(), measured(seed, ("p", "q2")), np.array([1.5, 0.3])
    joint = problem_of(scenario, responses, rules, solver_of(seed)).fopt(values)
    alone = [
        problem_of(scenario, {spot: each}, rules, solver_of(seed)).fopt(values)
        for spot, each in responses.items()
    ]
    assert joint == pytest.approx(np.mean(alone), rel=1e-12)
