"""The small study that a plugin's suite runs."""

import pytest

from palpate import Simulation, Solver, Status, hookimpl
from palpate.errors import StudyError
from palpate.plugins.provides import Provides
from palpate.testing import bench
from palpate.testing.studies import StudyRunner


@pytest.fixture
def runner(tmp_path):
    return StudyRunner(tmp_path)


def test_a_study_of_only_the_bench_finds_a_set_near_the_truth(runner):
    small = runner(limb={"source": "small_block"})
    assert small.study.solver.name == "half_space_on_mesh"
    assert len(small.simulations) == 3
    (row,) = small.selection.to_dicts()
    assert 0.4 < row["tissue.e"] < 0.7  # of a range from 0.1 to 1, the truth in its middle
    assert set(small.scores["channel"]) == {"force", "torque"}


class Failing(Solver):
    name, summary, provides = "failing", "has no answer for a set", Provides(body="layers")

    def simulate(self, job, limb):
        if job.set_id == 2:
            return Simulation(job=job, status=Status.DIVERGED, response=None, message="no balance")
        return bench.HalfSpace().simulate(job, limb)


class Components:
    @staticmethod
    @hookimpl
    def palpate_solvers():
        return [Failing]


def test_a_failed_simulation_and_a_mistake_are_failures(runner):
    with pytest.raises(AssertionError, match="a simulation failed: no balance"):
        runner(Components(), solver={"name": "failing"})
    with pytest.raises(StudyError, match="takes no mesh; remove the table"):
        runner(limb={"source": "small_block"}, solver={"name": "half_space"})
    with pytest.raises(AssertionError, match="is taken by"):
        runner(bench)
