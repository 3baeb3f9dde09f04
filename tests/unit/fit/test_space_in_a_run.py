"""Values by spot, ties, gains and layers, from the study to the report."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from palpate.domain import (
    Curve,
    Parameter,
    ParameterSpace,
    Prior,
    RegionMaterial,
    Response,
    Scenario,
    Simulation,
    Status,
    Tie,
)
from palpate.domain.indenter import Sphere
from palpate.fit.least_squares import LeastSquares
from palpate.fit.parametrisation import StandardParametrisation, StandardSettings
from palpate.plugins.interfaces import Solver
from palpate.plugins.provides import Provides
from palpate.stages import core_stages, pipeline
from palpate.testing import LinearMaterial
from palpate_certainty import stages
from palpate_certainty.emulated_curves import SimulatedCurves, runs_of_sets

pytestmark = pytest.mark.usefixtures("one_figure")

DEPTH, TURN = (
    np.linspace(0.0, 10.0, 21),
    np.concatenate([np.linspace(0, -22.5, 16), np.linspace(-22.5, 0, 16)[1:]]),
)
ROWS = [(0.0, 0.0), (10.0, 0.0), (10.0, -22.5), (10.0, 0.0)]
TRUTH = {"p1": (0.5, 0.3), "p2": (0.5, 0.0)}
ONE = (Scenario(name="I", weights={"force": 1.0, "torque": 1.0}),)


def layered(skin, fat, muscle=0.0):
    """Curves of a press on skin, fat and perhaps muscle; a spot without fat has zero of it."""
    return Response(
        curves={
            "force": Curve(
                channel="force",
                abscissa=DEPTH,
                ordinate=skin * DEPTH**1.5 + 0.1 * fat * DEPTH**2.5 + 0.02 * muscle * DEPTH**3.5,
            ),
            "torque": Curve(
                channel="torque", abscissa=TURN, ordinate=(3.0 * skin + 2.0 * fat) * np.tanh(TURN / 9)
            ),
        }
    )


class Layers(Solver):
    """The small sphere, at p2, is where there is no fat."""

    name = "layers"
    summary = "layers in closed form"
    provides = Provides(body="layers")

    def simulate(self, job, limb):
        by_region = {region: float(theta[0]) for region, theta in job.thetas.items()}
        if job.protocol.indenter.radius_mm < 7.5:
            by_region["fat"] = 0.0
        return Simulation(job=job, status=Status.OK, response=layered(**by_region))


@pytest.fixture
def run(make_study, plugins, tmp_path, monkeypatch):
    """Run a study of skin and fat whose true values are these by spot."""

    def runs(truth, space, searched=None, torque_gain=1.0, reported=False, **changes):
        if not reported:
            monkeypatch.setattr("palpate_report.from_run.write_report", lambda data, folder: None)
        study = make_study(
            solver=Layers(),
            space=space,
            search=LeastSquares(),
            parametrisation=StandardParametrisation(StandardSettings(**(searched or {}))),
            **{"n_sets": 0, **changes},
        )
        press = replace(study.protocol, path=np.array(ROWS))
        small = replace(press, indenter=Sphere(radius_mm=5.0))
        study = replace(
            study, protocol=press, spots=(study.spots[0], replace(study.spots[1], protocol=small))
        )
        for spot in study.spots:
            curves = layered(*truth[spot.spot.name]).curves
            gains = {"force": 1.0, "torque": torque_gain}
            rows = [
                f"{name},{x!r},{gains[name] * y!r}\n"
                for name, curve in curves.items()
                for x, y in zip(curve.abscissa.tolist(), curve.ordinate.tolist(), strict=True)
            ]
            spot.files[0].write_text("".join(rows))
        return pipeline.run_study(study, tmp_path / "run", plugins)

    return runs


def space(*, tied=None, muscle=None, **changes):
    """Skin, fat, and muscle where a tie of it is given; ``tied`` is that of the fat."""
    material = LinearMaterial()
    (e,) = material.parameters
    skin = RegionMaterial(region="skin", material=material, searched=(replace(e, **changes),), fixed={})
    followers = [
        RegionMaterial(
            region=region,
            material=material,
            searched=() if tie else (e,),
            fixed={},
            tied={"e": tie} if tie else {},
        )
        for region, tie in (("fat", tied), ("muscle", muscle))
        if region == "fat" or tie
    ]
    return ParameterSpace(regions=(skin, *followers))


def row(result, fit, spot, scenario="I"):
    (found,) = result.fit.table.filter(fit=fit, spot=spot, scenario=scenario).iter_rows(named=True)
    return found


@pytest.mark.parametrize("first", ["I", "III"])
def test_both_layers_are_found_where_one_spot_lacks_one(run, first):
    """By both channels and by each alone, whichever scenario is searched first."""
    result = run(TRUTH, space(), generalise_by=first)
    for scenario in ("I", "II", "III"):
        joint = row(result, "all spots", "p1", scenario)
        assert (joint["skin.e"], joint["fat.e"]) == pytest.approx((0.5, 0.3), rel=1e-3)
    alone = row(result, "p2", "p2")
    assert alone["skin.e"] == pytest.approx(0.5, rel=1e-3)
    assert "no curve depends on fat.e" in alone["message"]
    assert "no curve" not in joint["message"]


@pytest.mark.slow
def test_each_spot_has_a_value_of_its_own_after_a_sweep_of_one_column(run):
    result = run({"p1": (0.2, 0.3), "p2": (0.8, 0.0)}, space(by="spot"), n_sets=6, scenarios=ONE)
    assert [p.name for p in result.design.parameters] == ["skin.e", "fat.e"]
    assert row(result, "all spots", "p1")["skin.e"] == pytest.approx(0.2, rel=1e-3)
    assert row(result, "all spots", "p2")["skin.e"] == pytest.approx(0.8, rel=1e-3)


@pytest.mark.slow
def test_each_state_has_a_value_or_a_factor(run):
    """In the tables, the report and what leads the run."""
    states = {"p1": "rest", "p2": "contracted"}
    truth = {"p1": (0.2, 0.3), "p2": (0.5, 0.0)}
    by_state = replace(space(by="state"), states=states)
    result = run(truth, by_state, n_sets=6, scenarios=ONE, reported=True)
    assert row(result, "all spots", "p1")["skin.e"] == pytest.approx(0.2, rel=1e-3)
    assert row(result, "all spots", "p2")["skin.e"] == pytest.approx(0.5, rel=1e-3)
    assert row(result, "p2", "p2")["skin.e"] == pytest.approx(0.5, rel=1e-3)


@pytest.mark.slow
def test_a_factor_of_a_state_is_in_the_tables(run):
    factor = {"stiffness": {"skin": {"lower": 0.5, "upper": 5.0}}}
    states = {"p1": "rest", "p2": "contracted"}
    truth = {"p1": (0.2, 0.3), "p2": (0.5, 0.0)}
    result = run(truth, replace(space(), states=states), factor, scenarios=ONE, reported=True)
    rest, tense = (row(result, "all spots", spot) for spot in states)
    assert (rest["skin.e"], tense["skin.e"]) == pytest.approx((0.2, 0.2), rel=1e-3)
    assert rest["stiffness.skin"] is None
    assert tense["stiffness.skin"] == pytest.approx(2.5, rel=1e-3)
    intervals = result.fit.intervals
    assert "stiffness.skin@contracted" in intervals["parameter"].to_list()


@pytest.mark.slow
def test_what_is_tied_follows_in_sweep_and_fit(run):
    tied = space(tied=Tie(source="skin.e", factor=0.6))
    result = run(TRUTH, tied, n_sets=4, scenarios=ONE)
    assert result.design.values.shape == (4, 1)
    for simulation in result.simulations:
        assert simulation.job.thetas["fat"] == pytest.approx(0.6 * simulation.job.thetas["skin"])
    joint = row(result, "all spots", "p1")
    assert (joint["skin.e"], joint["fat.e"]) == pytest.approx((0.5, 0.3), rel=1e-3)
    for table in (result.selected.selection, result.selected.generalisation):
        np.testing.assert_allclose(table["fat.e"], 0.6 * table["skin.e"])


@pytest.mark.slow
def test_three_layers_of_which_two_are_tied(run):
    ties = {"tied": Tie(source="skin.e", factor=0.6), "muscle": Tie(source="fat.e", factor=0.5)}
    result = run({"p1": (0.5, 0.3, 0.15), "p2": (0.5, 0.0, 0.15)}, space(**ties), scenarios=ONE)
    for fit, spot in (("all spots", "p1"), ("p1", "p1"), ("p2", "p2")):
        found = [row(result, fit, spot)[f"{region}.e"] for region in ("skin", "fat", "muscle")]
        assert found == pytest.approx([0.5, 0.3, 0.15], rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("by", [None, "spot"])
def test_a_ratio_is_found(run, by):
    ratio = Parameter(
        name="e_ratio", unit="1", lower=0.1, upper=2.0, kind="shape", description="of a test", by=by
    )
    tied = space(tied=Tie(source="skin.e", factor=ratio))
    result = run(TRUTH, tied, n_sets=6, reported=True, scenarios=ONE)
    joint = row(result, "all spots", "p1")
    found = [joint[name] for name in ("skin.e", "fat.e_ratio", "fat.e")]
    assert found == pytest.approx([0.5, 0.6, 0.3], rel=1e-3)
    selected = result.selected.selection
    np.testing.assert_allclose(selected["fat.e"], selected["fat.e_ratio"] * selected["skin.e"])
    coefficients = result.report.tables["table1_coefficients"]
    assert coefficients["parameter"].unique(maintain_order=True).to_list() == ["e"]
    assert coefficients["region"].unique(maintain_order=True).to_list() == ["skin", "fat"]
    lead = result.report.conclusion.lead
    assert ("fat.e_ratio by spot" if by else "fat.e_ratio = 0.6") in lead
    assert "initial shear modulus of skin " in lead
    assert ("initial shear modulus of fat " in lead) is (not by)


@pytest.mark.slow
def test_a_gain_is_found_and_a_prior_counts(run):
    searched = {"gains": {"torque": {"lower": 0.5, "upper": 2.0, "by": "all"}}}
    known = space(prior=Prior(value=0.5, sd=0.1))
    result = run(TRUTH, known, searched, torque_gain=1.3, reported=True, scenarios=ONE)
    assert row(result, "all spots", "p1")["gain.torque"] == pytest.approx(1.3, rel=1e-3)
    assert "gain.torque = 1.3" in result.report.conclusion.lead


@pytest.fixture
def asked(monkeypatch):
    """Every job that is simulated; all sets but two start from these two, and friction makes the torque."""
    jobs, simulate = [], Layers.simulate

    def recorded(self, job, limb):
        jobs.append(job)
        found = simulate(self, job, limb)
        force, torque = found.response.curves.values()
        torque = replace(torque, ordinate=torque.ordinate * (0.5 + 0.5 * job.protocol.friction))
        return replace(found, response=Response(curves={"force": force, "torque": torque}))

    monkeypatch.setattr(Layers, "simulate", recorded)
    monkeypatch.setattr(Layers, "n_warm_starts", lambda self, number: 2 * (number >= 2))
    return jobs


SEARCHED = {
    "friction": {"lower": 0.1, "upper": 1.5},
    "gains": {"torque": {"lower": 0.5, "upper": 2.0, "prior": {"value": 1.2, "sd": 0.1}}},
}


@pytest.mark.slow
def test_contours_simulate_nothing_and_know_the_sets_of_the_sweep(run, asked, monkeypatch):
    made = []

    def planes_of_fits(assessed, design, swept, *, main):
        n_asked = len(asked)
        found = real(assessed, design, swept, main=main)
        assert len(asked) == n_asked
        simulated = SimulatedCurves(assessed[0].end.problem, ["force", "torque"])
        made.append((found, runs_of_sets(simulated, design, swept), design, simulated))
        return found

    real = stages.planes_of_fits
    monkeypatch.setattr(stages, "planes_of_fits", planes_of_fits)
    result = run(TRUTH, space(), SEARCHED, n_sets=7, scenarios=ONE)
    assert sum(bool(job.warm_starts) for job in asked if job.set_id >= 0) == 2 * 5
    ((planes, runs, design, simulated),) = made
    assert not planes.is_empty()
    np.testing.assert_array_equal(runs.values[:, :2], design.values)
    forces = [s.response.curves["force"] for s in result.simulations if s.job.spot == "p1"]
    np.testing.assert_allclose(
        runs.ordinates[:, simulated.places["p1", "force"]], [curve.ordinate for curve in forces], atol=1e-12
    )


@pytest.mark.slow
def test_a_set_that_a_fit_would_simulate_otherwise_is_left_out(run, monkeypatch):
    made = []

    def planes_of_fits(assessed, design, swept, *, main):
        made.append(runs_of_sets(SimulatedCurves(assessed[0].end.problem, ["force"]), design, swept))
        return pl.DataFrame()

    monkeypatch.setattr(stages, "planes_of_fits", planes_of_fits)
    run(TRUTH, space(), {"friction": {"lower": 0.1, "upper": 0.9}}, n_sets=4, scenarios=ONE)
    assert made == [None]


@pytest.mark.slow
def test_the_posterior_asks_for_no_set_of_the_sweep_again(run, asked, plugins, monkeypatch):
    pytest.importorskip("emcee")

    def run_study(study, folder, plugins):
        found = real(study, folder, plugins)
        del asked[:]
        monkeypatch.setattr(core_stages, "write_fit_state", lambda *_: pytest.fail("no fit is to be made"))
        pipeline.run_stage("certainty", study, folder, plugins)
        return found

    monkeypatch.setattr(stages, "planes_of_fits", lambda *args, main: pl.DataFrame())
    real = pipeline.run_study
    monkeypatch.setattr(pipeline, "run_study", run_study)
    found = run(TRUTH, space(), n_sets=7, scenarios=ONE)
    thetas = [[float(theta[0]) for theta in job.thetas.values()] for job in asked]
    assert thetas
    apart = np.abs(np.array(thetas)[:, None] - found.design.values).max(axis=2)
    assert apart.min() > 1e-9
