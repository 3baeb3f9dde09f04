"""Workers: every job has one result, also when its process ends."""

import os
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from palpate.domain import Status
from palpate.domain.component import Settings
from palpate.errors import PluginError
from palpate.executors import Batch, InProcess, Limits, Processes, n_cores, thread_limits
from palpate.plugins.interfaces import Solver
from palpate.simulation.jobs import jobs

HOW = {1: Status.CRASHED, 2: Status.TIMED_OUT, 3: Status.CRASHED, 4: Status.DIVERGED, 5: Status.UNREADABLE}


def batch_of(study, to_do, n_workers=2, limit_s=1.0):
    return Batch(
        solver=study.solver,
        jobs=to_do,
        limbs={},
        limits=Limits(time_s=limit_s),
        n_workers=n_workers,
        plugin_files=study.plugin_files,
    )


def results(study, executor, n_sets=8, limit_s=1.0):
    design = SimpleNamespace(n_sets=n_sets, values=np.linspace([0.2, 10.0], [0.8, 40.0], n_sets))
    to_do = jobs(study, design, {})
    found = list(executor.results(batch_of(study, to_do, limit_s=limit_s)))
    assert sorted(index for index, _ in found) == list(range(len(to_do)))
    return to_do, dict(found)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["Faulty", "Batch"])
def test_failures_stay_with_their_job(make_study, solver):
    to_do, found = results(make_study(solver), Processes())
    for index, job in enumerate(to_do):
        assert found[index].status is HOW.get(job.set_id, Status.OK), (index, found[index])
    assert "exit code 17" in found[1].message
    assert found[2].message == "stopped after 1 s of processor time (limit 1 s for each thread)"
    assert found[2].seconds >= 1.0
    # Taken with the job that ended the worker, it is repeated, which is said too.
    assert found[3].message.startswith("ZeroDivisionError: stretch of zero")
    assert found[4].response["force"].abscissa.size == 8


def test_processes_and_one_process_give_the_same_bits(make_study):
    study = make_study()
    _, alone = results(study, InProcess())
    _, spread = results(study, Processes())
    for index, result in alone.items():
        for channel in ("force", "torque"):
            assert np.array_equal(result.response[channel].ordinate, spread[index].response[channel].ordinate)


def test_an_exception_in_this_process_is_a_row(make_study, tissue):
    class Raising(tissue.Analytic):
        def behave(self, job):
            if job.set_id == 3:
                raise ZeroDivisionError("stretch of zero")
            if job.set_id == 4:
                raise SystemExit(3)
            return super().behave(job)

    _, found = results(make_study(solver=Raising()), InProcess())
    assert found[3].message == "ZeroDivisionError: stretch of zero"
    assert found[4].message == "SystemExit: 3"
    assert [o.status for i, o in found.items() if i % 8 not in (3, 4)] == [Status.OK] * 12


def test_a_solver_that_swallows_a_job_leaves_it_unreadable(make_study, tissue):
    class Forgetful(tissue.Analytic):
        def simulate_many(self, jobs, limb):
            for job in jobs:
                if job.set_id == 2:
                    continue
                if job.set_id == 6:
                    return
                yield self.simulate(job, limb)

    _, found = results(make_study(solver=Forgetful()), InProcess())
    statuses = [found[i].status for i in range(8)]
    assert [i for i, s in enumerate(statuses) if s is not Status.OK] == [2, 6, 7]
    assert "without a result" in found[2].message


@pytest.mark.parametrize("copies", [False, True])
def test_jobs_of_one_name_keep_their_results(make_study, tissue, copies):
    class Backwards(tissue.Analytic):
        def simulate_many(self, jobs, limb):
            for job in reversed(list(jobs)):
                answer = self.simulate(job, limb)
                yield replace(answer, job=replace(job)) if copies else answer

    study = make_study(solver=Backwards())
    design = SimpleNamespace(n_sets=4, values=np.linspace([0.2, 10.0], [0.8, 40.0], 4))
    to_do = [replace(job, set_id=-1) for job in jobs(study, design, {})[:4]]
    found = dict(InProcess().results(batch_of(study, to_do)))
    if copies:  # which of the jobs is meant cannot be known
        assert {s.status for s in found.values()} == {Status.UNREADABLE}
        return
    for index, job in enumerate(to_do):
        expected = study.solver.simulate(job, None).response["torque"].ordinate
        assert np.array_equal(found[index].response["torque"].ordinate, expected)


def test_workers_stay_warm(make_study, tissue, tmp_path):
    log = tmp_path / "log.txt"
    study = make_study(solver="Analytic")
    solver = tissue.Analytic(tissue.Analytic.Settings(log=str(log)))
    results(make_study(solver=solver), Processes(), n_sets=10)
    lines = [line.split() for line in log.read_text().splitlines()]
    assert len(lines) == 20
    assert len({pid for *_, pid in lines}) <= 2
    assert str(os.getpid()) not in {pid for *_, pid in lines}
    assert study.solver.settings.log == ""


def test_a_solver_of_no_importable_module_is_refused(make_study, tissue):
    class Local(tissue.Analytic):
        pass

    with pytest.raises(PluginError, match=r"solver 'analytic' cannot be sent.*plugin file"):
        results(make_study(solver=Local()), Processes())


def test_a_worker_that_cannot_load_the_plugins_reports_why(make_study, tmp_path):
    broken = tmp_path / "broken.py"
    broken.write_text("raise RuntimeError('no licence')")
    with pytest.raises(PluginError, match="RuntimeError: no licence"):
        results(make_study(plugin_files=(broken,)), Processes())


def test_what_a_solver_prints_does_not_corrupt_the_results(make_study, tmp_path, tissue):
    talkative = tmp_path / "talkative.py"
    talkative.write_text(
        "import os, sys\n"
        "from palpate import Curve, Response, Simulation, Solver, Status\n"
        "class Talkative(Solver):\n"
        "    name = 'talkative'\n"
        "    summary = 'prints'\n"
        "    def simulate(self, job, limb):\n"
        "        print('hello'); os.write(1, b'raw'); sys.stdin.read()\n"
        "        rise = Curve(channel='force', abscissa=[0, 1], ordinate=[0, 1])\n"
        "        return Simulation(job=job, status=Status.OK, response=Response(curves={'force': rise}))\n"
    )
    from palpate.plugins.registry import load_file

    solver = load_file(talkative).Talkative()
    study = make_study(solver=solver, plugin_files=(*make_study().plugin_files, talkative))
    _, found = results(study, Processes())
    assert {s.status for s in found.values()} == {Status.OK}


def test_closing_the_sweep_stops_the_workers(make_study, tmp_path, tissue, until, has_ended):
    log = tmp_path / "log.txt"
    solver = tissue.Faulty(tissue.Faulty.Settings(log=str(log)))
    study = make_study(solver=solver)
    design = SimpleNamespace(n_sets=3, values=np.tile([0.4, 20.0], (3, 1)))
    every = {(job.spot, job.set_id): job for job in jobs(study, design, {})}
    hangs_then_works = [every["p1", 2], every["p2", 0]]
    sweep = Processes().results(batch_of(study, hangs_then_works, limit_s=600.0))
    next(sweep)
    until(lambda: " 2 " in log.read_text())  # a job that hangs has started
    pids = {int(line.split()[-1]) for line in log.read_text().splitlines()}
    sweep.close()
    assert all(map(has_ended, pids))


def test_threads_of_all_workers_fit_the_machine():
    assert n_cores() >= 1
    limits = thread_limits(1)
    assert limits["OMP_NUM_THREADS"] == limits["NPROC"] == "1"
    assert "--xla_cpu_multi_thread_eigen=false" in limits["XLA_FLAGS"]
    assert "XLA_FLAGS" not in thread_limits(2)
    assert thread_limits(2)["OPENBLAS_NUM_THREADS"] == "1"


def test_a_worker_sees_its_thread_limit(make_study, tmp_path):
    curious = tmp_path / "curious.py"
    curious.write_text(
        "import os\n"
        "from palpate import Curve, Response, Simulation, Solver, Status\n"
        "class Curious(Solver):\n"
        "    name = 'curious'\n"
        "    summary = 'looks around'\n"
        "    def simulate(self, job, limb):\n"
        "        rise = Curve(channel='force', abscissa=[0, 1], ordinate=[0, 1])\n"
        "        return Simulation(job=job, status=Status.OK, response=Response(curves={'force': rise}),\n"
        "                          message=os.environ['OMP_NUM_THREADS'])\n"
    )
    from palpate.plugins.registry import load_file

    solver: Solver = load_file(curious).Curious(Settings())
    files = (*make_study().plugin_files, curious)
    _, found = results(make_study(solver=solver, plugin_files=files), Processes())
    assert {int(s.message) for s in found.values()} == {max(1, n_cores() // 2)}
