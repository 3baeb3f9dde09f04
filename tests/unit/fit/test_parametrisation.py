"""What a study may search besides its materials' parameters, on presses in closed form."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.domain import (
    Curve,
    Indentation,
    Parameter,
    ParameterSpace,
    Prior,
    RegionMaterial,
    Response,
    Simulation,
    Status,
    Tie,
)
from palpate.domain.indenter import Sphere
from palpate.errors import StudyError
from palpate.fit.least_squares import LeastSquares
from palpate.fit.parametrisation import StandardParametrisation, StandardSettings
from palpate.fit.problem import Problem
from palpate.fit.running import Fit, run_searches
from palpate.fit.spot_term import SpotTerm
from palpate.fit.starts import scaled_start
from palpate.plugins.interfaces import Solver
from palpate.plugins.provides import Provides
from palpate.plugins.score import ScoringRules
from palpate.testing import LinearMaterial

DEPTH_MM, TWIST = 10.0, np.array([0.0, -22.5, 22.5, 0.0])
ABSCISSAE = {"force": "depth_mm", "torque": "rotation_deg"}


def force(thetas, friction, depth):
    """Skin counts at small depths, fat at large ones."""
    depth = np.maximum(depth, 0.0)
    return thetas["skin"][0] * depth**1.5 + 0.2 * thetas["fat"][0] * depth**2.5


def torque(thetas, friction, depth, rotation):
    stiff = thetas["skin"][0] + 2.0 * thetas["fat"][0]
    grip = friction * np.tanh(np.radians(rotation) * 4.0 / (0.2 + friction))
    return 3.0 * stiff * depth**2 * grip


class Press(Solver):
    """Both curves in closed form, at so many points that interpolation does not show."""

    name = "press"
    summary = "a press in closed form"
    provides = Provides(body="layers", accuracy=1e-7)

    def simulate(self, job, limb):
        curves = curves_of(job.thetas, job.protocol.friction, job.protocol.path)
        if job.slopes:
            curves = {name: replace(curve, slopes=slopes_of(job, name)) for name, curve in curves.items()}
        return Simulation(job=job, status=Status.OK, response=Response(curves=curves))


class ExactPress(Press):
    name = "exact_press"
    provides = replace(Press.provides, slopes=True)


def curves_of(thetas, friction, path):
    depth = np.linspace(0.0, path[-1, 0], 2001)
    rotation = np.concatenate([np.linspace(a, b, 1001)[1:] for a, b in pairwise(TWIST)])
    rotation = np.concatenate([[0.0], rotation])
    return {
        "force": Curve(channel="force", abscissa=depth, ordinate=force(thetas, friction, depth)),
        "torque": Curve(
            channel="torque", abscissa=rotation, ordinate=torque(thetas, friction, path[-1, 0], rotation)
        ),
    }


def slopes_of(job, channel):
    found = {}
    for name in ("skin.e", "fat.e", "friction"):
        ends = []
        for step in (-1e-5, 1e-5):
            region = name.partition(".")[0]
            thetas = {r: t + step * (r == region) for r, t in job.thetas.items()}
            ends.append(
                curves_of(thetas, job.protocol.friction + step * (name == "friction"), job.protocol.path)
            )
        found[name] = (ends[1][channel].ordinate - ends[0][channel].ordinate) / 2e-5
    return found


def space(tied=None, **changes):
    """Skin and fat, the fat's modulus tied if so requested; ``changes`` are of the skin's."""
    material = LinearMaterial()
    (e,) = material.parameters
    skin = RegionMaterial(region="skin", material=material, searched=(replace(e, **changes),), fixed={})
    fat = RegionMaterial(
        region="fat",
        material=material,
        searched=() if tied else (e,),
        fixed={},
        tied={"e": tied} if tied else {},
    )
    return ParameterSpace(regions=(skin, fat))


def press(friction=0.6):
    path = [(0.0, 0.0), *((DEPTH_MM, rotation) for rotation in TWIST)]
    return Indentation(indenter=Sphere(radius_mm=7.5), path=path, friction=friction)


def measured(found, spot, truth):
    """Curves as this spot's sensor gives them: from its onset, and through its gains."""
    inputs = found.inputs(truth["space"], spot, press(), truth)
    offset = inputs.offsets.get("depth_mm", 0.0)
    depth = np.linspace(0.0, DEPTH_MM, 31)
    rotation = np.concatenate([np.linspace(a, b, 10)[:-1] for a, b in pairwise(TWIST)])
    friction = inputs.protocol.friction
    y = {
        "force": (depth, force(inputs.thetas, friction, depth + offset)),
        "torque": (rotation, torque(inputs.thetas, friction, DEPTH_MM + offset, rotation)),
    }
    return Response(
        curves={
            name: Curve(channel=name, abscissa=x, ordinate=inputs.gains.get(name, 1.0) * at)
            for name, (x, at) in y.items()
        }
    )


@pytest.fixture
def state(make_study):
    """State the problem of spots p1 and p2 whose curves are those of these true values."""

    def stated(truth, searched=None, of=None, solver=ExactPress, spots=("p1", "p2"), noise=0.01):
        of = of or space()
        found = StandardParametrisation(StandardSettings(**(searched or {})))
        study = make_study(solver=solver(), space=of, parametrisation=found)
        terms = [
            SpotTerm(
                spot=spot,
                measured=measured(found, spot, {**truth, "space": of}),
                weights={"force": 1.0, "torque": 1.0},
                protocol=press(),
                materials={region.region: region.material for region in of.regions},
                rules=ScoringRules(),
                abscissae=ABSCISSAE,
            )
            for spot in spots
        ]
        return Problem(
            study, terms, lambda jobs: [study.solver.simulate(job, None) for job in jobs], found, noise=noise
        )

    return stated


def fitted(problem, known=None):
    fit = Fit(problem, problem.point_of(known or {}))
    run_searches(LeastSquares(), [fit], problem.simulate, seed=1)
    return fit, dict(zip(problem.names, problem.box.values(fit.best.point).tolist(), strict=True))


BASE = {"skin.e": 0.5, "fat.e": 0.3}
EVERYTHING = {
    "friction": {"lower": 0.1, "upper": 1.0},
    "depth_offset": {"lower": "-0.5 mm", "upper": "0.5 mm", "prior": {"value": "0.1 mm", "sd": "0.2 mm"}},
    "gains": {"force": {"lower": 0.8, "upper": 1.2}, "torque": {"lower": 0.8, "upper": 1.2, "by": "all"}},
}
ALL_TRUE = {
    "skin.e@p1": 0.5, "skin.e@p2": 0.7, "fat.e": 0.3, "friction": 0.4, "depth_offset_mm@p1": 0.2,
    "depth_offset_mm@p2": -0.15, "gain.force@p1": 1.05, "gain.force@p2": 0.95, "gain.torque": 1.1,
}  # fmt: skip


RATIO = Parameter(name="e_ratio", unit="1", lower=0.1, upper=2.0, kind="shape", description="of a test")


@pytest.mark.slow
@pytest.mark.parametrize("solver", [ExactPress, Press])
@pytest.mark.parametrize("tied", [None, Tie(source="skin.e", factor=0.6), Tie(source="skin.e", factor=RATIO)])
def test_the_jacobian_is_that_of_the_residuals(state, solver, tied):
    """For every kind of unknown at once, with exact slopes and with differences."""
    truth = ALL_TRUE | ({"fat.e": None, "fat.e_ratio": 0.6} if tied else {})
    problem = state(truth, EVERYTHING, space(tied, by="spot"), solver)
    names = {p.name for p in problem.study.space.parameters}
    assert len(problem.names) == len(ALL_TRUE) - (len(names) == 1)
    values = problem.box.values(np.linspace(0.35, 0.62, len(problem.names)))
    found = problem.jacobian(values)
    for i, name in enumerate(problem.names):
        step = 1e-4 * (problem.bounds[1][i] - problem.bounds[0][i])
        moved = [problem.residuals(values + sign * step * np.eye(len(values))[i]) for sign in (-1.0, 1.0)]
        expected = (moved[1] - moved[0]) / (2.0 * step)
        np.testing.assert_allclose(found[:, i], expected, atol=2e-3 * np.abs(expected).max(), err_msg=name)


@pytest.mark.parametrize("solver", [ExactPress, Press])
@pytest.mark.parametrize(
    ("searched", "changes", "truth"),
    [
        ({"friction": EVERYTHING["friction"]}, {}, {**BASE, "friction": 0.35}),
        (
            {"friction": {**EVERYTHING["friction"], "by": "spot"}}, {},
            {**BASE, "friction@p1": 0.3, "friction@p2": 0.8},
        ),
        (
            {"depth_offset": {"lower": "-0.5 mm", "upper": "0.5 mm"}}, {},
            {**BASE, "depth_offset_mm@p1": 0.21, "depth_offset_mm@p2": -0.33},
        ),
        (
            {"gains": {"torque": {"lower": 0.8, "upper": 1.2}}}, {},
            {**BASE, "gain.torque@p1": 1.1, "gain.torque@p2": 0.9},
        ),
        ({}, {"by": "spot"}, {"skin.e@p1": 0.25, "skin.e@p2": 0.8, "fat.e": 0.3}),
    ],
    ids=["friction", "friction by spot", "offset", "gain", "modulus by spot"],
)  # fmt: skip
def test_what_made_the_curves_is_recovered(state, solver, searched, changes, truth):
    fit, found = fitted(state(truth, searched, space(**changes), solver))
    assert found == pytest.approx(truth, rel=2e-3, abs=2e-4), fit.message


def test_every_point_is_compared_before_and_after_the_onset(state):
    for offset in (-0.4, 0.4):
        problem = state(
            {**BASE, "depth_offset_mm": offset}, {"depth_offset": EVERYTHING["depth_offset"]}, spots=["p1"]
        )
        values = np.array([0.5, 0.3, offset])
        (term,) = problem.terms
        inputs = problem.inputs("p1", problem.box.point(values))
        assert np.isfinite(term.values(problem.simulated(term, inputs), inputs, "force")).all()
        assert problem.fopt(values) < 1e-9


def test_a_search_starts_at_the_studys_own_friction_without_offset_at_gains_of_one(state):
    problem = state(
        {**ALL_TRUE, "skin.e": 0.5}, {**EVERYTHING, "depth_offset": {"lower": "-1 mm", "upper": "3 mm"}}
    )
    start = dict(zip(problem.names, problem.box.values(problem.point_of({"skin.e": 0.8})), strict=True))
    assert start["friction"] == pytest.approx(press().friction)
    assert start["depth_offset_mm@p2"] == pytest.approx(0.0, abs=1e-12)
    assert start["gain.force@p1"] == start["gain.torque"] == pytest.approx(1.0)
    assert start["skin.e"] == pytest.approx(0.8)
    assert start["fat.e"] == pytest.approx(np.sqrt(0.1))  # the middle of its logarithm


class Singular(ExactPress):
    """Gives no slopes, and beyond some stiffness of the skin nothing at all."""

    most = np.inf

    def simulate(self, job, limb):
        if job.thetas["skin"][0] > self.most:
            return Simulation(job=job, status=Status.DIVERGED, response=None, message="too stiff")
        bare = super().simulate(replace(job, slopes=False), limb)
        return replace(bare, diagnostics={"slopes": "none: the tangent is singular"})


def test_where_a_tangent_is_singular_slopes_are_differences(state):
    values = None
    jacobians = []
    for solver in (ExactPress, Singular):
        problem = state(ALL_TRUE, EVERYTHING, space(None, by="spot"), solver)
        values = problem.box.values(np.full(len(problem.names), 0.5)) if values is None else values
        jacobians.append(problem.jacobian(values))
        assert problem.failure == ""
    exact, differenced = jacobians
    np.testing.assert_allclose(differenced, exact, atol=0.01 * np.abs(exact).max(axis=0).min())


def test_a_simulation_without_neighbours_has_no_jacobian_but_a_reason(state):
    class Lonely(Singular):
        most = 0.318

    problem = state(ALL_TRUE, EVERYTHING, space(None, by="spot"), Lonely)
    values = problem.box.values(np.full(len(problem.names), 0.5))
    assert np.isnan(problem.jacobian(values)).all()
    assert problem.failure == "no slopes: p1: diverged: too stiff"
    assert np.isfinite(problem.residuals(values)).all()
    slopes, failures = problem.columns(problem.box.point(values))
    assert set(failures.values()) == {"p1: diverged: too stiff", "p2: diverged: too stiff"}
    assert set(failures) == {"skin.e@p1", "skin.e@p2"}
    lost = [name in failures for name in problem.names]
    assert np.isnan(slopes[:, lost]).all()
    assert np.isfinite(slopes[:, ~np.array(lost)]).all()


def test_a_step_that_fails_is_reported_where_other_slopes_are_differences(state):
    class Rough(Singular):
        def simulate(self, job, limb):
            if job.protocol.friction > most:
                return Simulation(job=job, status=Status.DIVERGED, response=None, message="too rough")
            return super().simulate(job, limb)

    class Tilting(StandardParametrisation):
        def inputs(self, space, spot, protocol, values):
            found = super().inputs(space, spot, protocol, values)
            tilt = (found.protocol.friction, 0.0)  # so that no slopes lead there
            return replace(found, protocol=replace(found.protocol, tilt_deg=tilt))

    problem = state(ALL_TRUE, EVERYTHING, space(None, by="spot"), Rough)
    problem.parametrisation = Tilting(problem.parametrisation.settings)
    point = np.full(len(problem.names), 0.5)
    most = problem.inputs("p1", point).protocol.friction
    slopes, failures = problem.columns(point)
    assert failures == {"friction": "p2: diverged: too rough"}
    assert np.isnan(slopes).all(axis=0).tolist() == [name == "friction" for name in problem.names]


def test_a_prior_is_where_a_search_starts(state):
    searched = {"friction": {**EVERYTHING["friction"], "prior": {"value": 0.3, "sd": 0.1}}}
    problem = state({**BASE, "friction": 0.4}, searched)
    assert problem.box.values(problem.point_of({}))[2] == pytest.approx(0.3)


@settings(max_examples=5)
@given(truth=st.floats(0.2, 0.8), prior=st.floats(0.2, 0.8))
def test_a_strong_prior_holds_a_value_and_a_weak_one_changes_nothing(truth, prior):
    for sd, expected in ((1e-5, prior), (1e6, truth)):
        of = space(prior=Prior(value=prior, sd=sd))
        problem = _state({"skin.e": truth, "fat.e": 0.3}, of)
        assert fitted(problem)[1]["skin.e"] == pytest.approx(expected, rel=1e-3)


def _state(truth, of):
    """A problem of one spot without a study on disk."""
    found = StandardParametrisation()
    term = SpotTerm(
        spot="p1",
        measured=measured(found, "p1", {**truth, "space": of}),
        weights={"force": 1.0},
        protocol=press(),
        materials={region.region: region.material for region in of.regions},
        rules=ScoringRules(),
        abscissae=ABSCISSAE,
    )
    solver = ExactPress()
    study = type("_Study", (), {"space": of, "solver": solver, "filters": (), "degree": lambda *_: 1})()
    return Problem(study, [term], lambda jobs: [solver.simulate(job, None) for job in jobs], found)


def test_one_run_gives_the_scale_where_all_moduli_are_tied(state):
    of = space(Tie(source="skin.e", factor=0.6))
    problem = state({"skin.e": 0.83}, of=of)
    start = scaled_start(problem, problem.point_of({}))
    assert problem.box.values(start) == pytest.approx([0.83], rel=1e-5)


def test_what_no_curve_depends_on_is_reported_and_stays(state):
    gain = {"gains": {"force": {"lower": 0.5, "upper": 2.0}, "lateral": {"lower": 0.5, "upper": 2.0}}}
    fit, found = fitted(state({**BASE, **dict.fromkeys(
        ["gain.force@p1", "gain.force@p2", "gain.lateral@p1", "gain.lateral@p2"], 1.0)}, gain))  # fmt: skip
    assert fit.message.endswith(
        "no curve depends on gain.lateral@p1, gain.lateral@p2, left where the search started"
    )
    assert found["gain.lateral@p1"] == pytest.approx(1.0)


@pytest.mark.parametrize("solver", [ExactPress, Press])
def test_what_no_curve_separates_is_reported(state, solver):
    """All moduli and all gains: only their products are in the curves, unless a prior holds one."""
    both = {name: {"lower": 0.5, "upper": 2.0, "by": "all"} for name in ("force", "torque")}
    truth = {**BASE, "gain.force": 1.1, "gain.torque": 0.9}
    fit, _ = fitted(state(truth, {"gains": both}, solver=solver))
    names = "skin.e, fat.e, gain.force, gain.torque"
    assert fit.message.endswith(f"no curve separates {names}: fix one or give it a prior")
    both["force"]["prior"] = {"value": 1.1, "sd": 0.01}
    fit, found = fitted(state(truth, {"gains": both}, solver=solver))
    assert fit.message == "converged"
    assert found == pytest.approx(truth, rel=2e-3)


@pytest.mark.parametrize(("limit", "ends"), [(0.5, []), (0.0, ["skin.e"])])
def test_a_bound_of_physical_meaning_is_no_end_of_a_range(state, limit, ends):
    fit, _ = fitted(state({"skin.e": 0.1, "fat.e": 0.5}, of=space(lower=0.5, physical_lower=limit)))
    assert [parameter.name for parameter, _ in fit.at_bounds()] == ends


def test_what_is_observed_of_the_response_is_compared(state):
    problem = state({"skin.e": 0.5, "fat.e": 0.5})
    (term, *_), inputs = problem.terms, problem.inputs("p1", np.full(2, 0.3))
    simulation = problem.simulated(term, inputs)

    def louder(response):
        curves = {n: replace(c, ordinate=1.1 * c.ordinate, slopes={}) for n, c in response.curves.items()}
        return Response(curves=curves)

    observed = term.residuals(simulation, replace(inputs, observe=louder))
    gained = term.residuals(simulation, replace(inputs, gains={"force": 1.1, "torque": 1.1}))
    assert np.array_equal(observed, gained)
    assert not np.allclose(observed, term.residuals(simulation, inputs))


# ---------------------------------------------------------------------- states

STATES = {"p1": "rest", "p2": "contracted", "p3": "contracted"}
FACTOR = {"stiffness": {"skin": {"lower": 0.5, "upper": 4.0, "prior": {"value": 1.5, "sd": 1.0}}}}
CONTRACTED = {**BASE, "stiffness.skin@contracted": 2.2}


def in_states(states=STATES, **changes):
    return replace(space(**changes), states=states)


def test_a_factor_is_of_each_state_over_the_first():
    found = StandardParametrisation(StandardSettings(**FACTOR))
    spots = list(STATES)
    names = [p.name for p in found.parameters(in_states(), spots)]
    assert names == ["skin.e", "fat.e", "stiffness.skin@contracted"]
    third = in_states({**STATES, "p3": "tired"})
    assert [p.name for p in found.parameters(third, spots)][2:] == [
        "stiffness.skin@contracted",
        "stiffness.skin@tired",
    ]
    thetas = [found.inputs(in_states(), spot, press(), CONTRACTED).thetas for spot in spots]
    assert [of["skin"].tolist() for of in thetas] == [[0.5], pytest.approx([1.1]), pytest.approx([1.1])]
    assert [of["fat"].tolist() for of in thetas] == [[0.3]] * 3


def test_of_one_state_it_is_the_joint_fit(state):
    """Neither a parameter more nor another residual."""
    joint = state(BASE, spots=["p2", "p3"])
    of_state = state(BASE, FACTOR, in_states(by="state"), spots=["p2", "p3"])
    assert of_state.names == joint.names
    values = np.array([0.4, 0.35])
    np.testing.assert_array_equal(of_state.residuals(values), joint.residuals(values))
    np.testing.assert_array_equal(of_state.jacobian(values), joint.jacobian(values))


@pytest.mark.parametrize("solver", [ExactPress, Press])
@pytest.mark.parametrize(
    ("searched", "changes", "truth"),
    [
        (FACTOR, {}, CONTRACTED),
        ({}, {"by": "state"}, {"skin.e@rest": 0.4, "skin.e@contracted": 0.9, "fat.e": 0.3}),
        (
            {"friction": {**EVERYTHING["friction"], "by": "state"}}, {},
            {**BASE, "friction@rest": 0.3, "friction@contracted": 0.7},
        ),
    ],
    ids=["factor", "modulus", "friction"],
)  # fmt: skip
def test_what_differs_between_states_is_recovered(state, solver, searched, changes, truth):
    problem = state(truth, searched, in_states(**changes), solver, spots=list(STATES), noise=1e-4)
    fit, found = fitted(problem)
    assert found == pytest.approx(truth, rel=2e-3, abs=2e-4), fit.message


def test_the_slopes_of_a_factor_are_those_of_the_residuals(state):
    problem = state(CONTRACTED, FACTOR, in_states(), spots=list(STATES))
    values = np.array([0.45, 0.32, 1.7])
    found = problem.jacobian(values)
    for i in range(3):
        step = 1e-5 * np.eye(3)[i]
        expected = (problem.residuals(values + step) - problem.residuals(values - step)) / 2e-5
        np.testing.assert_allclose(found[:, i], expected, atol=2e-3 * np.abs(expected).max())


def test_a_state_needs_spots_that_have_one_and_a_factor_its_region():
    found = StandardParametrisation(StandardSettings(**FACTOR))
    with pytest.raises(StudyError, match="by state, and no spot has one"):
        found.parameters(space(), ["p1", "p2"])
    bone = StandardParametrisation(StandardSettings(stiffness={"bone": FACTOR["stiffness"]["skin"]}))
    with pytest.raises(StudyError, match="no region 'bone'"):
        bone.parameters(in_states(), ["p1", "p2"])
    with pytest.raises(ValueError, match="is by state"):
        StandardSettings(stiffness={"skin": {**FACTOR["stiffness"]["skin"], "by": "spot"}})
