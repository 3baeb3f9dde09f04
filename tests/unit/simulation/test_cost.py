"""How long a sweep will take: from what is there, else from a simulation that is timed."""

import re
from dataclasses import replace

import pytest
from hypothesis import example, given, strategies as st

from palpate.domain import Job, Simulation, Status
from palpate.fit.least_squares import LeastSquares
from palpate.fit.searches import BestSet, DifferentialEvolution
from palpate.mesh.specimens import block
from palpate.run.ledger import Writer
from palpate.simulation import jobs as simulation
from palpate.simulation.cost import Cost, cost, n_of_fit, timed
from palpate.simulation.forecast import Part, work_of
from palpate.stages import pipeline
from palpate.stages.pipeline import check_study


def jobs_of(study, plugins):
    inputs = check_study(study, plugins)
    jobs = simulation.jobs(study, inputs.design, inputs.measured)
    return jobs, simulation.keys(study, jobs, inputs.limbs), inputs


def test_a_new_study_is_timed_and_one_with_results_is_not(make_study, plugins, tmp_path):
    study = make_study(cache=tmp_path / "cache")
    jobs, keys, inputs = jobs_of(study, plugins)
    by_key = dict(zip(keys, jobs, strict=True))
    new = cost(study, by_key, None, {})
    assert (new.n_left, new.seconds_each, new.seconds, new.n_workers) == (len(by_key), None, None, 1)
    assert timed(study, jobs, inputs.limbs) >= 0.0
    cold = replace(study, cache=None)
    found = simulation.simulate(cold, inputs.design, inputs.limbs, inputs.measured, tmp_path / "run")
    with Writer(tmp_path / "cache") as cache:
        for key, each in list(dict(zip(keys, found, strict=True)).items())[:4]:
            cache.store(key, replace(each, seconds=8.0))
    some = cost(study, by_key, None, {})
    assert (some.n_left, some.seconds_each) == (len(by_key) - 4, 8.0)
    assert some.seconds == pytest.approx(8.0 * some.n_left)
    assert cost(study, by_key, tmp_path / "run", {}).n_left == 0


def test_results_of_another_mesh_or_range_tell_the_time_of_one(make_study, plugins, tmp_path):
    study = make_study()
    _, _, inputs = jobs_of(study, plugins)
    simulation.simulate(study, inputs.design, inputs.limbs, inputs.measured, tmp_path / "run")
    other = replace(study, seed=7)
    jobs, keys, _ = jobs_of(other, plugins)
    left = cost(other, dict(zip(keys, jobs, strict=True)), tmp_path / "run", {})
    assert left.n_left == len(set(keys))
    assert left.seconds_each is not None


def test_an_executor_that_is_not_known_gives_no_time_of_all():
    left = Cost(n_left=3, seconds_each=2.0, n_workers=0)
    assert (left.seconds, str(left)) == (None, "3 simulations to do, each about 2 s here; then the fit")


@given(
    seconds=st.floats(0.0, 1e6), n_left=st.integers(0, 10**5), n_fit=st.integers(0, 99), n=st.integers(0, 64)
)
@example(seconds=1.0, n_left=1, n_fit=0, n=1)
def test_no_estimate_is_zero(seconds, n_left, n_fit, n):
    text = str(Cost(n_left=n_left, seconds_each=seconds, n_workers=n, n_fit=n_fit, fit_work=n_fit, n_spots=4))
    assert not re.search(r"\b0 s", text)
    assert bool(re.search(r"\d s\b|min|second", text)) == (n_left + n_fit > 0)


def test_the_paper_s_way_has_no_fit(make_study, tmp_path, plugins):
    study = make_study(search=BestSet())
    jobs, keys, _ = jobs_of(study, plugins)
    left = replace(cost(study, dict(zip(keys, jobs, strict=True)), None, {}), seconds_each=1.0)
    assert str(left) == f"{left.n_left} simulations to do, about {left.seconds:.0f} s (workers: 1)"


@pytest.mark.slow
@pytest.mark.usefixtures("one_figure")
def test_a_fit_without_a_sweep_has_a_time_too(make_study, plugins, tmp_path):
    study = make_study(n_sets=0, search=LeastSquares())
    parts = pipeline.parts_of(study, check_study(study, plugins), plugins)
    left = cost(study, {}, None, {}, parts)
    assert (left.n_left, left.seconds_each) == (0, None)
    assert left.n_fit > 0
    left = replace(left, seconds_each=30.0, n_workers=2)
    assert left.fit_seconds == pytest.approx(30.0 * left.n_fit / 2)
    assert str(left).startswith(f"about {left.n_fit} simulations, about ")
    one, many = (replace(left, n_workers=n).fit_seconds for n in (1, 50))
    assert one == pytest.approx(2 * many)  # its two spots run side by side, and no more than these
    pipeline.run_study(study, tmp_path / "run", plugins)
    again = cost(study, {}, tmp_path / "run", {}, parts)
    assert again.n_fit < left.n_fit
    unknown = replace(study, search=DifferentialEvolution())
    none = cost(study, {}, None, {}, pipeline.parts_of(unknown, check_study(unknown, plugins), plugins))
    assert (none.n_fit, none.fit_seconds) == (0, None)


def test_slopes_by_differences_take_more_simulations(make_study, monkeypatch):
    study = make_study(n_sets=0, search=LeastSquares())
    assert not study.solver.provides.slopes
    plain = n_of_fit(study)
    monkeypatch.setattr(study.solver, "provides", replace(study.solver.provides, slopes=True))
    assert plain == pytest.approx((1 + 2 * len(study.space.names)) * n_of_fit(study), abs=4)


def test_finer_meshes_take_longer_and_few_of_them_do_not_change_the_time_of_one(make_study, tmp_path):
    study = make_study(n_sets=0)
    limbs = {"p1": block(n_across=4, n_down=2), "p1/fine": block(n_across=8, n_down=4)}
    parts = [Part(stage="fit", counts={"p1": 5, "p1/fine": 1})]
    left = cost(study, {}, None, limbs, parts)
    assert left.n_fit == 6
    assert left.fit_work == pytest.approx(5.0 + work_of("p1/fine", limbs))
    assert left.fit_work > 10.0
    with Writer(tmp_path / "run") as writer:
        for key, seconds in (("a", 2.0), ("b", 2.0), ("c", 40.0)):
            job = Job(spot="p1", set_id=-1, materials={}, thetas={}, protocol=study.protocol)
            writer.store(key, Simulation(job=job, status=Status.OK, seconds=seconds))
    assert cost(study, {}, tmp_path / "run", limbs, parts).seconds_each == 2.0


@given(
    n_left=st.integers(0, 5000),
    each=st.floats(0.0, 1e4),
    n_workers=st.integers(1, 64),
    more=st.integers(0, 9),
)
def test_more_workers_never_take_longer_and_none_is_faster_than_one_simulation(n_left, each, n_workers, more):
    few = Cost(n_left=n_left, seconds_each=each, n_workers=n_workers).seconds
    many = Cost(n_left=n_left, seconds_each=each, n_workers=n_workers + more).seconds
    assert many <= few * (1.0 + 1e-12)
    assert many >= each * (1.0 - 1e-12) or n_left == 0
