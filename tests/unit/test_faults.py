"""Solvers that answer with nonsense, and workers that others kill: rows with a reason, nothing lost."""

import os
import signal
import time
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest

from palpate import run_status, simulation
from palpate.domain import Curve, Response, Simulation, Status
from palpate.errors import StudyError
from palpate.executors import InProcess, Limits, Processes, Work, machine, pool
from palpate.ledger import Ledger
from palpate.locking import Runner, locked
from palpate.plugins import load_file
from palpate.sampling import draw_design


def sweep(study, folder):
    design = draw_design(study.space, study.sampler, study.n_sets, study.seed)
    return simulation.simulate(study, design, {}, {spot.spot.name: None for spot in study.spots}, folder)


def work_for(study, n_sets, **limits):
    design = SimpleNamespace(n_sets=n_sets, values=np.linspace([0.2, 10.0], [0.8, 40.0], n_sets))
    return Work(
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


NONSENSE = {
    "nan": (nan, "crashed", r"ordinate\[1\] is nan"),
    "ragged": (ragged, "crashed", r"abscissa \(3,\) and ordinate \(2,\)"),
    "nothing": (lambda job, answer: None, "crashed", "answered with a NoneType, not a Simulation"),
    "arrays": (lambda job, answer: answer | {"response": np.zeros(3)}, "crashed", "response is a ndarray"),
    "status": (lambda job, answer: answer | {"status": "splendid"}, "crashed", "splendid"),
    "seconds": (lambda job, answer: answer | {"seconds": float("nan")}, "ok", ""),
    "text": (lambda job, answer: answer | {"message": "b\udcffd\0" + "x" * 3_000_000}, "ok", r"b\\udcffd\\0"),
    "no text": (lambda job, answer: answer | {"message": None}, "ok", "None"),
    "objects": (lambda job, answer: answer | {"diagnostics": {3: object, "x": [np.inf]}}, "ok", ""),
}


@pytest.mark.parametrize("name", NONSENSE)
def test_nonsense_is_a_row_with_its_reason_and_the_others_go_on(make_study, tissue, tmp_path, name):
    spoil, state, said = NONSENSE[name]

    class Spoilt(tissue.Analytic):
        def behave(self, job):
            whole = super().behave(job)
            if job.set_id != 2:
                return whole
            told = {"status": Status.OK, "response": whole.response, "message": ""} | {"diagnostics": {}}
            spoilt = spoil(job, told)
            return spoilt if spoilt is None else Simulation(job=job, **spoilt)

    found = sweep(make_study(solver=Spoilt(), n_sets=4), tmp_path / "run")
    assert [s.status.value for s in found] == ["ok", "ok", state, "ok"] * 2
    with Ledger(tmp_path / "run") as ledger:
        rows = ledger.frame("simulations").filter(set_id=2)
    assert rows["state"].to_list() == [state]  # both spots ask for the same
    assert rows["message"].str.contains(said).all()
    assert rows["message"].str.len_chars().max() < 5000
    assert (rows["seconds"] >= 0.0).all()


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
from palpate import Settings, Simulation, Solver, Status
class HardSettings(Settings):
    pids: str = Field(description="File for the ids of the processes.")
class Hard(Solver):
    name, summary, needs_limb, Settings = "hard", "does as it likes", False, HardSettings
    def version(self): return "1"
    def simulate(self, job, limb):
        if job.set_id == 1:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
            child = subprocess.Popen(["sleep", "600"])
            Path(self.settings.pids).write_text(f"{os.getpid()} {child.pid}")
            time.sleep(600)
        if job.set_id == 2:
            for _ in range(60):
                os.write(2, b"x" * 100_000 + b"\\n")
            print("last words")
        if job.set_id == 3:
            os.kill(os.getpid(), signal.SIGKILL)
        if job.set_id == 4:
            sys.exit(3)
        if job.set_id >= 10:
            with Path(self.settings.pids).open("a") as pids:
                pids.write(f"{job.set_id} {os.getpid()}\\n")
            time.sleep(0.05)
        return Simulation(job=job, status=Status.OK, response=None)
"""


@pytest.fixture
def hard(make_study, tmp_path):
    path = tmp_path / "hard.py"
    path.write_text(HARD)
    module = load_file(path)
    solver = module.Hard(module.HardSettings(pids=str(tmp_path / "pids")))
    study = make_study(solver=solver)
    return replace(study, plugin_files=(*study.plugin_files, path))


def has_ended(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z"
    except OSError:
        return True


def test_whatever_a_job_does_to_its_worker_it_has_one_outcome(hard, tmp_path, monkeypatch):
    sizes, heard = [], pool._Worker.heard

    def watched(self):
        heard(self)
        sizes.append(os.fstat(self._output.fileno()).st_size)

    monkeypatch.setattr(pool._Worker, "heard", watched)
    found = {o.index: o for o in Processes().outcomes(work_for(hard, 6, time_s=2.0))}
    assert sorted(found) == list(range(6))
    assert [found[i].status.value for i in range(6)] == ["ok", "timed_out", "ok", "crashed", "crashed", "ok"]
    assert "signal SIGKILL" in found[3].message
    assert found[3].quarantined
    assert found[4].message == "SystemExit: 3"
    assert max(sizes) <= pool.MOST_OUTPUT
    for pid in (tmp_path / "pids").read_text().split():
        deadline = time.monotonic() + 5.0
        while not has_ended(pid) and time.monotonic() < deadline:
            time.sleep(0.02)
        assert has_ended(pid), "a process that a job had started outlived it"


def test_a_worker_that_somebody_kills_costs_no_job(hard, tmp_path):
    work = work_for(hard, 40)
    found, hit = [], {}
    for outcome in Processes().outcomes(replace(work, jobs=work.jobs[10:])):
        found.append(outcome)
        set_id, pid = (tmp_path / "pids").read_text().splitlines()[-1].split()
        if len(found) in (3, 9, 15) and set_id not in hit and pid not in hit.values():
            os.kill(int(pid), signal.SIGKILL)
            hit[set_id] = pid
    assert hit
    assert sorted(o.index for o in found) == list(range(30))
    assert {o.status for o in found} == {Status.OK}


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
    from palpate.plugins import Plugins
    from palpate.study import read_study

    data = Path(__file__).parents[1] / "data" / "toy"
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
        found = list(Processes().outcomes(work_for(make_study(), 20)))
        check()
    assert {o.status for o in found} == {Status.OK}
    assert all(0.0 <= o.seconds < 60.0 for o in found)


@pytest.mark.parametrize("jump_h", [-30, 0, 30])
def test_a_clock_that_jumps_gives_no_negative_time_left(jump_h):
    runner = Runner(host="h", pid=1, since="2026-01-01 12:00:00 UTC", token="t")
    begun = datetime(2026, 1, 1, 12, tzinfo=UTC)
    times = [begun + timedelta(seconds=i) + timedelta(hours=jump_h) * (i > 5) for i in range(12)]
    rows = pl.DataFrame({"finished_at": [each.isoformat(timespec="milliseconds") for each in times]})
    left = run_status._seconds_left(rows, 10, runner)
    assert left is None or left >= 0.0
