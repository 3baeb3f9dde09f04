"""How long a sweep will take: from what is there, else from a simulation that is timed."""

from dataclasses import replace

import pytest
from hypothesis import given, strategies as st

from palpate.pipeline import check_study
from palpate.run.ledger.cache import ResultCache
from palpate.stages import simulation
from palpate.stages.cost import Cost, cost, timed


def jobs_of(study, plugins):
    inputs = check_study(study, plugins)
    jobs = simulation.jobs(study, inputs.design, inputs.measured)
    return jobs, simulation.keys(study, jobs, inputs.limbs), inputs


def test_a_new_study_is_timed_and_one_with_results_is_not(make_study, plugins, tmp_path):
    study = make_study(cache=tmp_path / "cache")
    jobs, keys, inputs = jobs_of(study, plugins)
    by_key = dict(zip(keys, jobs, strict=True))
    new = cost(study, by_key, None)
    assert (new.n_left, new.seconds_each, new.seconds, new.n_workers) == (len(by_key), None, None, 1)
    assert timed(study, jobs, inputs.limbs) >= 0.0
    cold = replace(study, cache=None)
    found = simulation.simulate(cold, inputs.design, inputs.limbs, inputs.measured, tmp_path / "run")
    for key, each in list(dict(zip(keys, found, strict=True)).items())[:4]:
        ResultCache(tmp_path / "cache").store(key, replace(each, seconds=8.0))
    some = cost(study, by_key, None)
    assert (some.n_left, some.seconds_each) == (len(by_key) - 4, 8.0)
    assert some.seconds == pytest.approx(8.0 * some.n_left)
    assert cost(study, by_key, tmp_path / "run").n_left == 0


def test_results_of_another_mesh_or_range_tell_the_time_of_one(make_study, plugins, tmp_path):
    study = make_study()
    _, _, inputs = jobs_of(study, plugins)
    simulation.simulate(study, inputs.design, inputs.limbs, inputs.measured, tmp_path / "run")
    other = replace(study, seed=7)
    jobs, keys, _ = jobs_of(other, plugins)
    left = cost(other, dict(zip(keys, jobs, strict=True)), tmp_path / "run")
    assert left.n_left == len(set(keys))
    assert left.seconds_each is not None


def test_an_executor_that_is_not_known_gives_no_time_of_all():
    left = Cost(n_left=3, seconds_each=2.0, n_workers=0)
    assert (left.seconds, str(left)) == (None, "3 simulations to do, each about 2 s here")


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
