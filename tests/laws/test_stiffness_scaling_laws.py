"""Laws of the best multiple of a set, for a tissue that answers in proportion to its moduli."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from palpate import _core, pipeline
from palpate.channels import TORQUE
from palpate.domain import Design, Parameter, Response, Scenario, Status
from palpate.errors import StudyError
from palpate.plugins.catalogue import Plugins
from palpate.plugins.interfaces import SetFilter
from palpate.run.directory import RunDirectory
from palpate.stages import scoring, selection, simulation
from palpate.stages.experiment import load_measured
from palpate.stages.sampling import draw_design
from palpate.stages.stiffness_scaling import best_scaled_sets, best_scales, scale_bounds, scaled_sets
from palpate.stages.sweep import Simulations
from palpate.study.reading import read_study

TOY = Path(__file__).parents[1] / "data" / "toy"
KEYS = ["spot", "scenario", "set_id"]


class Swept:
    """A study with its measured curves, design and simulations."""

    def __init__(self, study, plugins, folder):
        self.folder = folder
        self.study, self.measured = study, load_measured(study, plugins.channels)
        self.design = draw_design(study.space, study.sampler, study.n_sets, study.seed)
        jobs = simulation.jobs(study, self.design, self.measured)
        self.simulations = [study.solver.simulate(job, None) for job in jobs]

    def stiffness_scaling(self):
        return best_scales(self.study, self.simulations, self.design, self.measured)

    def best(self):
        with Simulations(self.study, self.folder, {}) as simulations:
            return best_scaled_sets(simulations, self.simulations, self.design, self.measured)

    def objectives(self, values):
        """Fopt of other sets, from simulations of their own."""
        design = replace(self.design, values=values)
        simulations = [
            self.study.solver.simulate(job, None)
            for job in simulation.jobs(self.study, design, self.measured)
        ]
        scores = scoring.score(simulations, self.measured, self.study.scoring)
        return selection.objectives(scores, self.study.scenarios)


@pytest.fixture
def swept(make_study, plugins, tmp_path):
    return lambda **changes: Swept(make_study(**changes), plugins, tmp_path / "run")


def test_fopt_on_the_ray_is_that_of_a_simulation_there(swept):
    of = swept()
    for row in of.stiffness_scaling().iter_rows(named=True):
        scale = np.full(of.design.n_sets, row["scale"])
        values = scaled_sets(of.design.parameters, of.design.values, scale)
        there = of.objectives(values).filter(**{key: row[key] for key in KEYS})
        assert row["fopt"] == pytest.approx(there["fopt"][0], rel=1e-9, abs=1e-14)


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0.0, 1.0))
def test_no_other_multiple_within_the_ranges_is_better(swept, share):
    of = swept()
    lower, upper = scale_bounds(of.design)
    other = lower + share * (upper - lower)
    there = of.objectives(scaled_sets(of.design.parameters, of.design.values, other))
    both = of.stiffness_scaling().join(there, on=KEYS, suffix="_there")
    assert both.height == 6 * of.design.n_sets
    assert (both["fopt"] <= both["fopt_there"] + 1e-12).all()


def test_the_scale_of_a_single_channel_is_the_core_s_closed_form(swept):
    of = swept()
    lower, upper = scale_bounds(of.design)
    curve = of.measured["p1"]["torque"]
    sims = [s.response["torque"] for s in of.simulations if s.job.spot == "p1"]
    path = _core.Measured(curve.abscissa, curve.ordinate).along(sims[0].abscissa)
    scale, _ = path.best_scale(np.stack([c.ordinate for c in sims]))
    rows = of.stiffness_scaling().filter(spot="p1", scenario="II")
    np.testing.assert_allclose(rows["scale"], np.clip(scale, lower, upper), rtol=1e-12)


def test_a_set_on_the_ray_of_the_truth_finds_the_truth(swept):
    of = swept()
    of.design = replace(of.design, values=np.array([[0.2, 10.0], [0.9, 9.0]]))
    of.simulations = [
        of.study.solver.simulate(job, None) for job in simulation.jobs(of.study, of.design, of.measured)
    ]
    row = of.best().row(by_predicate=(pl.col("spot") == "p1") & (pl.col("scenario") == "I"), named=True)
    assert (row["set_id"], row["message"]) == (0, "as expected")
    assert row["scale"] == pytest.approx(2.0, rel=1e-12)
    assert row["soft_tissue.stiffness"] == pytest.approx(0.4)
    assert row["soft_tissue.grip"] == pytest.approx(20)
    assert row["fopt"] < 1e-24


def test_a_channel_of_degree_0_stays_as_it_is_along_a_ray(swept, tissue):
    class Ratio(tissue.Analytic):
        """Gives grip over stiffness for a torque, which no common factor changes."""

        def behave(self, job):
            whole, ((stiffness, _),) = super().behave(job), job.thetas.values()
            torque = whole.response["torque"]
            ratio = replace(torque, ordinate=torque.ordinate / stiffness)
            return replace(whole, response=Response(curves={**whole.response.curves, "torque": ratio}))

    declared = [{"torque": replace(TORQUE, degree=degree)} for degree in (0, 1)]
    messages = [swept(solver=Ratio(), channels=channels).best()["message"] for channels in declared]
    assert [(m == "as expected").all() for m in messages] == [True, False]


def test_the_best_is_never_worse_than_the_sweep(swept):
    of = swept()
    best = of.best()
    chosen = of.objectives(of.design.values).group_by("spot", "scenario").agg(pl.col("fopt").min())
    both = best.join(chosen, on=["spot", "scenario"], suffix="_swept")
    assert both.height == 6
    assert (both["fopt"] <= both["fopt_swept"] + 1e-12).all()
    assert (both["message"] == "as expected").all()
    np.testing.assert_allclose(both["fopt"], both["fopt_scaled"], rtol=1e-9, atol=1e-14)


positive = st.floats(1e-6, 1e6)


@given(st.lists(st.tuples(positive, positive, st.floats(0.0, 1.0), st.booleans()), min_size=1, max_size=4))
def test_every_modulus_stays_in_its_range_and_one_touches_it(ranges):
    """Ranges of either sign; a multiple at the bound moves some modulus to an end."""
    parameters, values = [], []
    for i, (a, b, share, negative) in enumerate(ranges):
        lower, upper = min(a, b), max(a, b) * 1.001
        if negative:
            lower, upper = -upper, -lower
        parameters.append(
            Parameter(name=f"a.p{i}", unit="MPa", lower=lower, upper=upper, kind="modulus", description="")
        )
        values.append(min(max(lower + share * (upper - lower), lower), upper))
    design = Design(parameters=tuple(parameters), values=np.array([values]), seed=0, n_drawn=1)
    for bound in scale_bounds(design):
        ends = [(p.lower, p.upper) for p in parameters]
        raw = design.values[0] * bound[0]
        assert all(
            low - 1e-9 * abs(low) <= v <= high + 1e-9 * abs(high)
            for v, (low, high) in zip(raw, ends, strict=True)
        )
        touches = any(np.isclose(v, end, rtol=1e-9).any() for v, end in zip(raw, ends, strict=True))
        assert touches or bound[0] == 1e-3


def test_a_shape_and_a_modulus_of_zero_stay():
    shape = Parameter(name="a.nu", unit="1", lower=0.0, upper=0.5, kind="shape", description="")
    none = Parameter(name="a.c2", unit="MPa", lower=-1.0, upper=1.0, kind="modulus", description="")
    design = Design(parameters=(shape, none), values=np.array([[0.4, 0.0]]), seed=0, n_drawn=1)
    lower, upper = scale_bounds(design)
    assert (lower[0], upper[0]) == (1e-3, np.inf)
    np.testing.assert_array_equal(
        scaled_sets(design.parameters, design.values, np.array([3.0])), [[0.4, 0.0]]
    )


class Soft(SetFilter):
    name = "soft"
    summary = "Sets of little stiffness"

    def accept(self, space, values):
        return values[:, 0] <= 0.3


def test_a_multiple_that_a_filter_refuses_is_not_scaled(swept):
    of = swept()
    free, held = of.stiffness_scaling(), swept(filters=(Soft(),)).stiffness_scaling()
    stiffness = of.design.values[free["set_id"].to_numpy(), 0] * free["scale"].to_numpy()
    refused = stiffness > 0.3
    assert refused.any()
    assert (~refused).any()
    np.testing.assert_array_equal(held["scale"].to_numpy()[refused], 1.0)
    np.testing.assert_array_equal(held["scale"].to_numpy()[~refused], free["scale"].to_numpy()[~refused])


def test_a_solver_out_of_proportion_is_reported(swept, tissue):
    class Offset(tissue.Analytic):
        def simulate(self, job, limb):
            whole = super().simulate(job, limb)
            force = replace(whole.response["force"], ordinate=whole.response["force"].ordinate + 3.0)
            response = replace(whole.response, curves={**whole.response.curves, "force": force})
            return replace(whole, response=response)

    best = swept(solver=Offset(), scenarios=(Scenario(name="III", weights={"force": 1.0}),)).best()
    assert all("not in proportion" in message for message in best["message"])
    assert (best["fopt"] > best["fopt_scaled"]).all()


def test_a_multiple_does_not_take_the_number_of_its_set(swept, tissue):
    of = swept()

    class Noting(tissue.Analytic):
        def simulate(self, job, limb):
            numbers.append(job.set_id)
            return super().simulate(job, limb)

    numbers = []
    of.study = replace(of.study, solver=Noting())
    assert len(of.best()) == len(numbers) > 0
    assert max(numbers) < 0


def test_a_multiple_that_fails_is_a_row_with_its_reason(swept, tissue):
    of = swept()

    class Broken(tissue.Analytic):
        def simulate(self, job, limb):
            whole = super().simulate(job, limb)
            return replace(whole, status=Status.DIVERGED, response=None, message="no equilibrium")

    of.study = replace(of.study, solver=Broken())
    best = of.best()
    assert best.height == 6
    assert all("diverged: no equilibrium" in message for message in best["message"])


def test_a_solver_that_raises_leaves_a_row_with_its_reason(swept, tissue):
    of = swept()

    class Raising(tissue.Analytic):
        def simulate(self, job, limb):
            raise SystemExit(0)

    of.study = replace(of.study, solver=Raising())
    assert of.best()["message"].str.contains("crashed: SystemExit: 0").all()


def test_a_run_with_rays_reports_them_and_one_without_drops_them(make_study, plugins, tmp_path, one_figure):
    result = pipeline.run_study(make_study(stiffness_scaling=True), tmp_path / "run", plugins)
    scaled = result.selected.stiffness_scaling
    assert (scaled["fopt"] <= result.selected.selection["fopt"] + 1e-12).all()
    assert result.report.tables["stiffness_scaling"].equals(scaled)
    assert RunDirectory(tmp_path / "run").manifest()["stiffness_scaling"] is True
    assert (
        pipeline.run_stage("select", make_study(stiffness_scaling=True), tmp_path / "run", plugins)
        .table("stiffness_scaling")
        .equals(scaled)
    )
    without = pipeline.run_study(make_study(), tmp_path / "run", plugins)
    assert "stiffness_scaling" not in without.report.tables
    assert not (tmp_path / "run" / "stiffness_scaling.parquet").exists()


def test_a_fixed_modulus_leaves_no_scaling(tmp_path):
    toy = Plugins.load([TOY / "toy_plugin.py"], entry_points=False)
    for name in ("s1.txt", "s2.txt"):
        (tmp_path / name).write_bytes((TOY / name).read_bytes())
    text = (
        (TOY / "study.toml").read_text().replace("[selection]\n", "[selection]\nstiffness_scaling = true\n")
    )
    (tmp_path / "study.toml").write_text(text)
    assert read_study(tmp_path, toy).stiffness_scaling is True
    searched = 'k = { lower = "1000 kPa", upper = "3 MPa" }\na = 0.5'
    assert searched in text
    (tmp_path / "study.toml").write_text(text.replace(searched, 'k = "2 MPa"'))
    with pytest.raises(StudyError, match=r"stiffness_scaling: .*rubber\.k does not scale"):
        read_study(tmp_path, toy)
