"""Processor time of a run: nothing is lost, nothing counts twice."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.domain import HomogeneousTests, Job, Simulation, Status
from palpate.errors import StoppedError
from palpate.executors import Batch, InProcess, Limits, Processes
from palpate.executors.attempts import spent_on_jobs_here
from palpate.simulation.processor_time import FILE, OWN, ProcessorTime, cost_rows, processor_time
from palpate.testing.executors import LinearMaterial, LinearSolver

STAGES = ("fit", "intervals", "report")


def simulation(seconds, *, mesh="", **diagnostics):
    return Simulation(
        job=Job(spot="p1", set_id=0, mesh=mesh), status=Status.OK, seconds=seconds, diagnostics=diagnostics
    )


durations = st.floats(0.0, 100.0)
events = st.one_of(
    st.tuples(st.just("stage"), st.sampled_from(STAGES)),
    st.tuples(st.just("pass"), durations),
    st.tuples(st.just("write"), st.none()),
    st.tuples(st.just("job"), st.tuples(durations, durations, durations, st.sampled_from(("", "fine")))),
)


@given(st.lists(st.lists(events, max_size=12), min_size=1, max_size=3))
def test_the_sum_is_the_time_of_this_process_and_of_all_jobs(commands):
    now = [5.0]
    spent = 0.0
    with TemporaryDirectory() as folder:
        for command in commands:
            time = ProcessorTime(Path(folder), now[0] - 1.0, lambda: now[0])  # began 1 s before
            spent += 1.0
            for kind, value in command:
                match kind:
                    case "stage":
                        with time.charging(value):
                            now[0] += 1.0
                            spent += 1.0
                    case "pass":
                        now[0] += value
                        spent += value
                    case "write":
                        time.write()
                    case _:
                        own_s, slopes_s, worker_s, mesh = value
                        parts = {"processor_s": own_s, "slopes_s": slopes_s, "worker_s": worker_s}
                        time.simulated(simulation(1.0, mesh=mesh, **parts))
                        spent += own_s + worker_s
            time.write()
        found = processor_time(Path(folder))
    assert found["processor_s"].sum() == pytest.approx(spent)
    n_jobs = sum(kind == "job" for command in commands for kind, _ in command)
    assert found.filter(found["work"] != "slopes")["n_simulations"].sum() <= n_jobs
    assert cost_rows(found)[-1][3] == f"{found['processor_s'].sum():.1f}"


def test_each_kind_of_work_has_its_row(tmp_path):
    time = ProcessorTime(tmp_path, 0.0, lambda: 2.0)
    with time.charging("fit"):
        time.simulated(simulation(9.0, processor_s=4.0, slopes_s=1.0, worker_s=0.5))
        time.simulated(simulation(9.0, mesh="fine", processor_s=20.0, slopes_s=5.0))
        time.simulated(simulation(7.0))  # its worker was killed, and could not report
    assert {row[:2]: row[2:] for row in processor_time(tmp_path).rows()} == {
        ("start-up", OWN): (0, 2.0),
        ("fit", "paths"): (2, 10.0),
        ("fit", "slopes"): (1, 1.0),
        ("fit", "fine meshes"): (1, 20.0),
        ("fit", "workers"): (0, 0.5),
    }


@pytest.mark.parametrize("content", [b"", b"[]", b'[{"stage": 3}]', b"7", b"\xff"])
def test_a_damaged_file_counts_as_nothing(tmp_path, content):
    (tmp_path / FILE).write_bytes(content)
    assert processor_time(tmp_path).is_empty()


def test_a_folder_that_cannot_be_written_hides_no_error_of_a_stage(tmp_path):
    time = ProcessorTime(tmp_path / "missing", 0.0, lambda: 2.0)
    with pytest.raises(StoppedError), time.charging("fit"):
        raise StoppedError("stopped")
    time.write()
    assert processor_time(tmp_path / "missing").is_empty()


@pytest.mark.parametrize("executor", [InProcess(), Processes()])
def test_a_job_brings_its_processor_time_from_wherever_it_ran(executor):
    jobs = [
        Job(
            spot="p1",
            set_id=set_id,  # the one of number 2 raises
            materials={"tissue": LinearMaterial()},
            thetas={"tissue": np.array([0.5])},
            protocol=HomogeneousTests(paths={"uniaxial": np.linspace(1.0, 1.5, 6)}),
        )
        for set_id in range(4)
    ]
    batch = Batch(solver=LinearSolver(), jobs=jobs, limbs={}, limits=Limits(time_s=60.0), n_workers=1)
    before_s = spent_on_jobs_here()
    of = [simulation.diagnostics for _, simulation in executor.results(batch)]
    executor.close()
    here_s = spent_on_jobs_here() - before_s
    assert len(of) == 4
    assert all(each["processor_s"] >= 0.0 for each in of)
    if executor.holds_limits:
        assert here_s == 0.0
        assert of[0]["worker_s"] > 0.0  # it has imported palpate
    else:
        assert here_s == pytest.approx(sum(each["processor_s"] for each in of))
