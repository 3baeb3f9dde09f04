"""Solvers that answer with nonsense, and workers that others kill: rows with a reason, nothing lost."""

import contextlib
import errno
import os
import queue
import signal
import sys
import time
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest

from palpate.domain import Curve, Response, Simulation, Status
from palpate.errors import ExecutorError, PluginError, StudyError
from palpate.executors import Batch, InProcess, Limits, Processes, machine, pool
from palpate.executors.attempts import LONGEST_TRACEBACK
from palpate.experiment.measured import load_measured
from palpate.plugins.execution import Executor
from palpate.plugins.registry import load_file
from palpate.run.ledger import Ledger
from palpate.run.lock import Runner, locked
from palpate.sampling.drawing import draw_design
from palpate.simulation import jobs as simulation
from palpate.stages import status as run_status


def sweep(study, folder):
    design = draw_design(study.space, study.sampler, study.n_sets, study.seed)
    return simulation.simulate(study, design, {}, {spot.spot.name: None for spot in study.spots}, folder)


def batch_for(study, n_sets, **limits):
    design = SimpleNamespace(n_sets=n_sets, values=np.linspace([0.2, 10.0], [0.8, 40.0], n_sets))
    return Batch(
        solver=study.solver,
        jobs=simulation.jobs(replace(study, spots=study.spots[:1]), design, {}),
        limbs={},
        limits=Limits(**{"time_s": 60.0, **limits}),
        n_workers=2,
        plugin_files=study.plugin_files,
    )


# ------------------------------------------------------------------ nonsense


def nan(job, answer):
    curve = Curve(channel="force", abscissa=[0.0, 1.0], ordinate=[0.0, np.nan])
    return answer | {"response": Response(curves={"force": curve})}


def ragged(job, answer):
    curve = Curve(channel="force", abscissa=[0.0, 1.0, 2.0], ordinate=[0.0, 1.0])
    return answer | {"response": Response(curves={"force": curve})}


LINE = {"channel": "force", "abscissa": np.array([0.0, 1.0]), "ordinate": np.array([0.0, 1.0])}


def replaced(ordinate):
    """An answer whose curve was sound when it was made."""

    def damage(job, answer):
        curve = Curve(**LINE)
        object.__setattr__(curve, "ordinate", np.asarray(ordinate))
        return answer | {"response": Response(curves={"force": curve})}

    return damage


NONSENSE = {
    "nan": (nan, "unreadable", r"ordinate\[1\] is nan"),
    "ragged": (ragged, "unreadable", r"abscissa \(3,\) and ordinate \(2,\)"),
    "nothing": (lambda job, answer: None, "unreadable", "answered with a NoneType, not a Simulation"),
    "arrays": (lambda job, answer: answer | {"response": np.zeros(3)}, "unreadable", "response is a ndarray"),
    "status": (lambda job, answer: answer | {"status": "splendid"}, "unreadable", "splendid"),
    "no curve": (lambda job, answer: answer | {"response": None}, "unreadable", "ok without a curve"),
    "empty": (
        lambda job, answer: answer | {"response": Response(curves={})},
        "unreadable",
        "without a curve",
    ),
    "list": (lambda job, answer: answer | {"diagnostics": [1]}, "unreadable", "diagnostics are a list"),
    "replaced nan": (replaced([0.0, np.nan]), "unreadable", r"ordinate\[1\] is nan"),
    "replaced length": (replaced([0.0]), "unreadable", r"abscissa \(2,\) and ordinate \(1,\)"),
    "complex": (replaced([1j, 2.0]), "unreadable", "values of type complex128"),
    "letters": (replaced(["0", "1"]), "unreadable", "values of type <U1"),
    "2-D": (replaced(np.ones((2, 2))), "unreadable", "must be one-dimensional"),
    "no contact": (replaced([0.0, -0.0]), "unreadable", "no contact: force zero at every point"),
    "other channel": (
        lambda job, answer: (
            answer | {"response": Response(curves={"force": Curve(**LINE | {"channel": "torque"})})}
        ),
        "unreadable",
        "channel 'force' holds a curve of channel 'torque'",
    ),
    "no curve class": (
        lambda job, answer: answer | {"response": Response(curves={"force": SimpleNamespace(**LINE)})},
        "unreadable",
        "channel 'force' is a SimpleNamespace, not a Curve",
    ),
    "seconds": (lambda job, answer: answer | {"seconds": float("nan")}, "ok", ""),
    "text": (lambda job, answer: answer | {"message": "b\udcffd\0" + "x" * 3_000_000}, "ok", r"b\\udcffd\\0"),
    "no text": (lambda job, answer: answer | {"message": None}, "ok", "None"),
    "objects": (lambda job, answer: answer | {"diagnostics": {3: object, "x": [np.inf]}}, "ok", ""),
}


@pytest.mark.parametrize("name", NONSENSE)
def test_nonsense_is_a_row_with_its_reason_and_the_others_go_on(make_study, tissue, tmp_path, name):
    damage, state, expected = NONSENSE[name]

    class Corrupt(tissue.Analytic):
        def behave(self, job):
            whole = super().behave(job)
            if job.set_id != 2:
                return whole
            reported = {"status": Status.OK, "response": whole.response, "message": ""} | {"diagnostics": {}}
            corrupt = damage(job, reported)
            return corrupt if corrupt is None else Simulation(job=job, **corrupt)

    found = sweep(make_study(solver=Corrupt(), n_sets=4), tmp_path / "run")
    assert [s.status.value for s in found] == ["ok", "ok", state, "ok"] * 2
    with Ledger(tmp_path / "run") as ledger:
        rows = ledger.frame().filter(set_id=2)
    assert rows["state"].to_list() == [state]  # both spots ask for the same
    assert rows["message"].str.contains(expected).all()
    assert rows["message"].str.len_chars().max() < 5000
    assert (rows["seconds"] >= 0.0).all()


def test_what_a_solver_prints_in_this_process_is_no_result(make_study, tissue, tmp_path, capsys):
    class Chatty(tissue.Analytic):
        def behave(self, job):
            sys.stdout.write("hello")
            return super().behave(job)

    sweep(make_study(solver=Chatty(), n_sets=2), tmp_path / "run")
    out, err = capsys.readouterr()
    assert (out, err.count("hello")) == ("", 2)


def test_a_loader_that_ends_the_process_is_an_error(make_study, tissue, plugins):
    class Leaving(tissue.Table):
        def load(self, path, channel=None):
            raise SystemExit(0)

    with pytest.raises(PluginError, match=r"'table' .* raised SystemExit: 0"):
        load_measured(make_study(loader=Leaving()), plugins.channels)


def test_a_job_that_crashed_keeps_its_traceback(make_study, tissue, tmp_path):
    class Deep(tissue.Analytic):
        def behave(self, job):
            return self.deeper(job, 400)

        def deeper(self, job, n):
            return self.deeper(job, n - 1) if n else 1.0 / 0.0

    (one, *_) = sweep(make_study(solver=Deep(), n_sets=2), tmp_path / "run")
    assert one.message == "ZeroDivisionError: float division by zero"
    assert "in deeper" in one.diagnostics["traceback"]
    assert one.diagnostics["traceback"].endswith("float division by zero\n")
    assert len(one.diagnostics["traceback"]) <= LONGEST_TRACEBACK + 3


def test_a_solver_that_raises_between_two_jobs_loses_no_other(make_study, tissue, tmp_path):
    class Tired(tissue.Analytic):
        def simulate_many(self, jobs, limb):
            for job in jobs:
                yield self.simulate(job, limb)
                if job.set_id % 3 == 1:
                    raise OSError("no licence left")

    found = sweep(make_study(solver=Tired(), n_sets=8), tmp_path / "run")
    assert {s.status for s in found} == {Status.OK}


def test_a_solver_that_raises_before_its_first_job_fails_every_one(make_study, tissue, tmp_path):
    class Dead(tissue.Analytic):
        def simulate_many(self, jobs, limb):
            raise OSError("no licence")

    found = sweep(make_study(solver=Dead(), n_sets=3), tmp_path / "run")
    assert [s.message for s in found] == ["OSError: no licence"] * 6


# ------------------------------------------------------------------- workers

HARD = """
import os, signal, subprocess, sys, time
from pathlib import Path
from pydantic import Field
from palpate import Curve, Provides, Response, Settings, Simulation, Solver, Status
class HardSettings(Settings):
    pids: str = Field(description="File for the ids of the processes.")
class Hard(Solver[HardSettings]):
    name, summary, provides = "hard", "does as it likes", Provides(body="layers")
    def simulate(self, job, limb):
        if job.set_id == 1:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
            child = subprocess.Popen(["sleep", "600"])
            Path(self.settings.pids).write_text(f"{os.getpid()} {child.pid}")
            while True:
                pass
        if job.set_id == 2:
            for _ in range(60):
                os.write(2, b"x" * 100_000 + b"\\n")
            print("last words")
        if job.set_id == 3:
            for _ in range(60):
                os.write(2, b"x" * 100_000)
            os.kill(os.getpid(), signal.SIGKILL)
        if job.set_id == 4:
            sys.exit(3)
        if job.set_id == 7:
            os.write(2, b"I leave one behind\\n")
            child = subprocess.Popen(["sleep", "600"], start_new_session=True)
            with Path(self.settings.pids).open("a") as pids:
                pids.write(f"{child.pid} ")
            os._exit(1)
        if job.set_id in (8, 9):
            time.sleep(0.5 if job.set_id == 8 else 600)
        if job.set_id >= 10:
            began = Path(f"{self.settings.pids} of {job.set_id}")
            if job.set_id % 18 == 0 and not began.exists():
                began.touch()
                os.kill(os.getpid(), signal.SIGKILL)
            time.sleep(0.05)
        rise = Curve(channel="force", abscissa=[0, 1], ordinate=[0, 1])
        return Simulation(job=job, status=Status.OK, response=Response(curves={"force": rise}))
"""


@pytest.fixture
def hard(make_study, tmp_path):
    path = tmp_path / "hard.py"
    path.write_text(HARD)
    module = load_file(path)
    solver = module.Hard(module.HardSettings(pids=str(tmp_path / "pids")))
    study = make_study(solver=solver)
    return replace(study, plugin_files=(*study.plugin_files, path))


@pytest.mark.slow
def test_every_job_has_one_result_whatever_its_worker_does(hard, tmp_path, until, has_ended):
    found = dict(Processes().results(batch_for(hard, 6, time_s=1.0)))
    assert sorted(found) == list(range(6))
    assert [found[i].status.value for i in range(6)] == ["ok", "timed_out", "ok", "crashed", "crashed", "ok"]
    how = "signal SIGKILL (killed from outside, or for its memory); last output: "
    assert found[3].message.endswith(f"on this job: {how}{'x' * pool.LONGEST_LINE}")
    assert not found[3].n_crashes  # what is killed from outside may end well another time
    assert found[4].message == "SystemExit: 3"
    for pid in (tmp_path / "pids").read_text().split():
        until(lambda pid=pid: has_ended(pid))  # what a job has started does not outlive it


def test_a_job_may_wait_for_a_processor_but_not_for_ever(hard, monkeypatch):
    batch = batch_for(hard, 10, time_s=0.2)
    monkeypatch.setattr(pool, "PATIENCE", 1e9)
    ((_, found),) = Processes().results(replace(batch, jobs=batch.jobs[8:9]))
    assert found.status is Status.OK, found.message  # asleep for 0.5 s, as if others had the processor
    monkeypatch.setattr(pool, "PATIENCE", 1.0)
    ((_, found),) = Processes().results(replace(batch, jobs=batch.jobs[9:]))
    assert found.message.endswith(" s without an answer (limit 1 times 0.2 s)")


def test_a_process_that_leaves_the_group_blocks_nothing(hard, tmp_path, monkeypatch, has_ended):
    monkeypatch.setattr(pool, "LAST_OUTPUT_S", 0.1)
    batch = batch_for(hard, 8)
    ((_, found),) = Processes().results(replace(batch, jobs=batch.jobs[7:]))
    assert found.status is Status.CRASHED
    assert found.message.endswith("last output: I leave one behind")
    for pid in (tmp_path / "pids").read_text().split():
        assert not has_ended(pid)
        os.kill(int(pid), signal.SIGKILL)


@pytest.mark.slow
def test_a_worker_that_starts_after_a_plugin_file_was_edited_has_it_as_the_run_began(hard, tmp_path):
    (tmp_path / "hard.py").write_text("half of a line that is being ed")
    batch = batch_for(hard, 12)
    ((_, found),) = Processes().results(replace(batch, jobs=batch.jobs[11:]))
    assert found.status is Status.OK


@pytest.mark.slow
def test_a_killed_worker_costs_no_job(hard):
    batch = batch_for(hard, 40)
    found = list(Processes().results(replace(batch, jobs=batch.jobs[10:])))
    assert sorted(index for index, _ in found) == list(range(30))
    assert {s.status for _, s in found} == {Status.OK}
    repeated = {s.job.set_id: s for _, s in found if s.n_crashes}
    assert set(repeated) == {18, 36}
    assert {s.n_crashes for s in repeated.values()} == {1}
    said = "repeated, as its worker had ended: signal SIGKILL"
    assert all(said in s.message for s in repeated.values())


STARTS = """
import os, signal
from pathlib import Path
starts = Path({starts!r})
with starts.open("a") as file:
    file.write("x")
if len(starts.read_text()) <= {n_killed}:
    os.kill(os.getpid(), signal.{name})
"""


@pytest.mark.slow
@pytest.mark.parametrize(("n_killed", "name"), [(2, "SIGKILL"), (100, "SIGSEGV")])
def test_a_worker_that_dies_while_it_starts_is_replaced_a_few_times(make_study, tmp_path, n_killed, name):
    path = tmp_path / "starts.py"
    path.write_text(STARTS.format(starts=str(tmp_path / "starts"), n_killed=n_killed, name=name))
    batch = batch_for(make_study(), 2)
    batch = replace(batch, plugin_files=(*batch.plugin_files, path), n_workers=1)
    if n_killed == 2:
        assert {s.status for _, s in Processes().results(batch)} == {Status.OK}
    else:
        with pytest.raises(PluginError, match=r"3 worker processes in a row ended before .* signal SIGSEGV"):
            list(Processes().results(batch))


def test_a_stop_of_the_whole_machine_ends_no_job(hard, tmp_path, monkeypatch):
    """The clock runs while every process is stopped, as in a frozen container."""

    class Frozen(queue.SimpleQueue):
        def get(self, timeout):
            nonlocal stood_still
            try:
                return super().get(timeout=timeout)
            except queue.Empty:
                if any(worker.started for worker in sweep._workers):
                    stood_still += 1000.0
                raise

    stood_still, true = 0.0, time.monotonic
    monkeypatch.setattr(pool, "monotonic", lambda: true() + stood_still)
    monkeypatch.setattr(pool, "TICK_S", 0.02)
    monkeypatch.setattr(pool.queue, "SimpleQueue", Frozen)
    batch = batch_for(hard, 14)
    sweep = pool.Pool(batch, 1)
    with contextlib.closing(sweep):
        assert {s.status for _, s in sweep.results(replace(batch, jobs=batch.jobs[10:]))} == {Status.OK}
    assert stood_still > 0.0


def test_a_machine_that_starts_no_worker_is_an_error(make_study, monkeypatch):
    def refused(*_):
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    monkeypatch.setattr(pool, "_Worker", refused)
    with pytest.raises(ExecutorError, match="Too many open files; raise the limit"):
        list(Processes().results(batch_for(make_study(), 2)))


# ----------------------------------------------------------------- executors


class Idle(Executor):
    name, summary = "idle", "does nothing"

    def results(self, batch):
        return iter(())


class Junk(Executor):
    name, summary = "junk", "yields what is no result"

    def results(self, batch):
        yield 3


class Twice(Executor):
    name, summary = "twice", "yields a result twice"

    def results(self, batch):
        for result in InProcess().results(batch):
            yield result
            yield result


class Careless(Executor):
    name, summary = "careless", "passes any result of a solver on"

    def results(self, batch):
        for index, job in enumerate(batch.jobs):
            yield index, Simulation(job=job, status=Status.OK, seconds=0.1)


@pytest.mark.parametrize(
    ("executor", "expected"),
    [
        (Idle, "executor 'idle' ended without a result for 3 of 3 jobs"),
        (Junk, "'junk' .* yielded 3, not the place and the Simulation of a job that was waiting"),
        (Twice, "'twice' .* not the place and the Simulation of a job that was waiting"),
    ],
)
def test_an_executor_that_breaks_its_contract_is_named(make_study, tmp_path, executor, expected):
    with pytest.raises(PluginError, match=expected):
        sweep(make_study(executor=executor(), n_sets=3), tmp_path / "run")


def test_results_of_an_executor_are_checked_like_any_others(make_study, tmp_path):
    found = sweep(make_study(executor=Careless(), n_sets=3), tmp_path / "run")
    assert {s.status for s in found} == {Status.UNREADABLE}


# -------------------------------------------------------------------- memory


@pytest.mark.parametrize(("memory_MB", "n"), [(0.0, 64), (10.0, 64), (250.0, 4), (1500.0, 1)])
def test_no_more_workers_than_their_memory_has_room_for(monkeypatch, memory_MB, n):
    monkeypatch.setattr(machine, "n_cores", lambda: 64)
    monkeypatch.setattr(machine, "free_memory", lambda: 1000.0)
    assert machine.n_fitting(memory_MB) == n


def test_a_batch_system_s_share_of_the_memory_counts(monkeypatch, tmp_path):
    monkeypatch.setattr(machine, "_CGROUP", tmp_path)
    whole = machine.free_memory()
    assert whole > 10.0
    (tmp_path / "memory.max").write_text("9000000\n")
    (tmp_path / "memory.current").write_text("2000000\n")
    assert machine.free_memory() == pytest.approx(7.0)
    (tmp_path / "memory.max").write_text("max\n")
    assert machine.free_memory() > 10.0


def test_a_share_of_a_group_around_this_process_counts(monkeypatch, tmp_path):
    (tmp_path / "own").write_text("0::/slurm/job_7/step_0\n")
    monkeypatch.setattr(machine, "_CGROUP", tmp_path)
    monkeypatch.setattr(machine, "_OWN_GROUP", tmp_path / "own")
    for name, most in (("slurm", "max"), ("slurm/job_7", "9000000"), ("slurm/job_7/step_0", "max")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "memory.max").write_text(f"{most}\n")
        (tmp_path / name / "memory.current").write_text("2000000\n")
    assert machine.free_memory() == pytest.approx(7.0)


def test_a_limit_that_nothing_would_hold_is_refused(tmp_path):
    from palpate.plugins.catalogue import Plugins
    from palpate.study.reading import read_study

    data = Path(__file__).parents[2] / "data" / "toy"
    plugins = Plugins.load([data / "toy_plugin.py"], entry_points=False)
    for name in ("s1.txt", "s2.txt"):
        (tmp_path / name).write_bytes((data / name).read_bytes())
    path = tmp_path / "study.toml"
    path.write_text(
        (data / "study.toml").read_text().replace("[executor]", '[executor]\nmemory_limit = "1 GB"')
    )
    with pytest.raises(StudyError, match=r"executor\.memory_limit.*'in_process' holds no job to it"):
        read_study(path, plugins)
    assert not InProcess.holds_limits


# --------------------------------------------------------------------- clock


def test_a_clock_that_jumps_ends_no_job_and_no_lock(make_study, tissue, tmp_path, monkeypatch):
    jumps = iter(np.random.default_rng(3).uniform(-1e7, 1e7, 10**5))
    true = time.time
    monkeypatch.setattr(time, "time", lambda: true() + next(jumps))
    with locked(tmp_path) as check:
        found = list(Processes().results(batch_for(make_study(), 20)))
        check()
    assert {s.status for _, s in found} == {Status.OK}
    assert all(0.0 <= s.seconds < 60.0 for _, s in found)


@pytest.mark.parametrize("jump_h", [-30, 0, 30])
def test_a_clock_that_jumps_gives_no_negative_time_left(jump_h):
    runner = Runner(host="h", pid=1, since="2026-01-01 12:00:00 UTC", token="t")
    started = datetime(2026, 1, 1, 12, tzinfo=UTC)
    times = [started + timedelta(seconds=i) + timedelta(hours=jump_h) * (i > 5) for i in range(12)]
    rows = pl.DataFrame(
        {"finished_at": [each.isoformat(timespec="milliseconds") for each in times], "seconds": 0.5}
    )
    left = run_status._seconds_left(rows, 10, runner)
    assert left is None or left >= 0.0


def test_results_of_a_cache_do_not_shorten_the_time_left():
    runner = Runner(host="h", pid=1, since="2026-01-01 12:00:00 UTC", token="t")
    started = datetime(2026, 1, 1, 12, tzinfo=UTC)
    cached = [started + timedelta(milliseconds=10 * i) for i in range(100)]
    simulated = [started + timedelta(seconds=8.0 * (i + 1)) for i in range(4)]
    times = [each.isoformat(timespec="milliseconds") for each in (*cached, *simulated)]
    rows = pl.DataFrame({"finished_at": times, "seconds": 7.5})
    assert run_status._seconds_left(rows, 10, runner) == pytest.approx(80.0)
    assert run_status._seconds_left(rows.head(100), 10, runner) is None
