"""Jobs on Dask clusters: the same bits as here, limits held, nothing lost with the scheduler."""

import gc
import os
import re
import signal
import subprocess
import sys
import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import polars as pl
import psutil
import pytest

from palpate.domain import (
    Curve,
    Indentation,
    ParameterSpace,
    RegionMaterial,
    Response,
    Scenario,
    Spot,
    Status,
)
from palpate.domain.indenter import Sphere
from palpate.errors import ExecutorError, PluginError
from palpate.executors import Batch, InProcess, Limits, Processes
from palpate.fit.least_squares import LeastSquares
from palpate.fit.parametrisation import StandardParametrisation
from palpate.fit.searches import BestSet
from palpate.fit.stage import FitStage
from palpate.fit.tables import fit_result
from palpate.plugins.catalogue import Plugins
from palpate.plugins.registry import load_file
from palpate.progress import Progress
from palpate.run.ledger import Ledger
from palpate.sampling.drawing import draw_design
from palpate.sampling.samplers import LatinHypercube
from palpate.sampling.study_design import draw_study
from palpate.simulation import jobs as simulation
from palpate.simulation.sweep import Simulations
from palpate.study.reading import Study, StudySpot
from palpate_dask import cluster as dask_cluster, worker_runtime
from palpate_dask.executor import DaskExecutor, DaskSettings

TISSUE = """
import os, time
from pathlib import Path
import numpy as np
from pydantic import Field
from palpate import (
    Curve, IsotropicMaterial, Parameter, Provides, Response, Settings, Simulation, Solver, Status,
)
class Foam(IsotropicMaterial):
    name, summary = "foam", "one number"
    parameters = (Parameter(name="k", unit="MPa", lower=0.1, upper=1.0, kind="modulus",
                            description="stiffness", physical_lower=0.0),)
    def energy(self, stretches, theta): return theta[0] * ((stretches - 1.0) ** 2).sum(axis=-1)
class PressSettings(Settings):
    log: str = Field("", description="File with a line for each simulation.")
    pause_s: float = Field(0.0, description="Taken for each.")
    hurts: bool = Field(False, description="Whether some jobs end or stop their process.")
class Press(Solver):
    name, summary, Settings = "press", "closed form", PressSettings
    provides = Provides(body="layers", channels=("force",))
    def simulate(self, job, limb):
        with Path(self.settings.log).open("a") as log:
            log.write(f"{job.set_id} {os.getpid()}\\n")
        time.sleep(self.settings.pause_s)
        if self.settings.hurts and job.set_id == 1: os._exit(17)
        while self.settings.hurts and job.set_id == 2: pass
        (theta,) = job.thetas.values()
        x = np.linspace(0.0, 10.0, 9)
        force = Curve(channel="force", abscissa=x, ordinate=theta[0] * x**1.5)
        return Simulation(job=job, status=Status.OK, response=Response(curves={"force": force}))
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("plugin") / "foam.py"
    path.write_text(TISSUE)
    return path


@pytest.fixture
def study(file, tmp_path):
    module, material = load_file(file), load_file(file).Foam()
    region = RegionMaterial(region="r", material=material, searched=material.parameters, fixed={})
    return Study(
        name="foam", description="", file=tmp_path / "study.toml", data="simulated",
        spots=(StudySpot(spot=Spot(name="p1"), measured={}, mesh=None),), loader=None, limb_source=None,
        protocol=Indentation(indenter=Sphere(radius_mm=7.5), path=[(0.0, 0.0), (9.0, 0.0)], friction=1.0),
        space=ParameterSpace(regions=(region,)), sampler=LatinHypercube(), n_sets=8, seed=1, filters=(),
        solver=module.Press(module.PressSettings(log=str(tmp_path / "log.txt"))),
        scenarios=(Scenario(name="force", weights={"force": 1.0}),), generalise_by="force",
        truth={}, n_workers=2, time_limit_s=60.0, plugin_files=(file,), executor=DaskExecutor(),
        search=BestSet(), parametrisation=StandardParametrisation(),
    )  # fmt: skip


def batch_of(study, **limits):
    design = SimpleNamespace(n_sets=8, values=np.linspace([0.2], [0.8], 8))
    return Batch(
        solver=study.solver,
        jobs=simulation.jobs(study, design, {}),
        limbs={},
        limits=Limits(**{"time_s": 60.0, **limits}),
        n_workers=2,
        plugin_files=study.plugin_files,
    )


def hurting(study, tmp_path):
    return replace(study, solver=type(study.solver)(study.solver.settings.model_copy(update={"hurts": True})))


def sweep(study, folder):
    design = draw_design(study.space, study.sampler, study.n_sets, study.seed)
    return simulation.simulate(study, design, {}, {"p1": {}}, folder)


def started(tmp_path):
    log = tmp_path / "log.txt"
    return [line.split() for line in log.read_text().splitlines()] if log.exists() else []


def test_the_executor_is_a_plugin_s():
    assert Plugins.load().executors["dask"] is DaskExecutor


def test_what_cannot_be_sent_is_refused_before_there_is_a_cluster(study, monkeypatch):
    class Local(type(study.space.regions[0].material)):
        pass

    monkeypatch.setattr("palpate_dask.flow.connected", None)
    region = replace(study.space.regions[0], material=Local())
    batch = batch_of(replace(study, space=ParameterSpace(regions=(region,))))
    with pytest.raises(PluginError, match="a material of the study cannot be sent"):
        list(DaskExecutor().results(batch))


@pytest.mark.slow
def test_a_cluster_of_this_machine_holds_limits_and_gives_the_same_bits(study, tmp_path, has_ended):
    study = hurting(study, tmp_path)
    found = dict(DaskExecutor().results(batch_of(study, time_s=1.0)))
    expected = dict(Processes().results(batch_of(study, time_s=1.0)))
    assert sorted(found) == list(range(8))
    assert [found[i].status for i in range(8)] == [expected[i].status for i in range(8)]
    assert found[1].status is Status.CRASHED
    assert found[1].n_crashes == 2
    assert "exit code 17" in found[1].message
    assert found[2].status is Status.TIMED_OUT
    for i in (0, 3, 7):
        assert np.array_equal(found[i].response["force"].ordinate, expected[i].response["force"].ordinate)
    assert all(has_ended(int(pid)) for _, pid in started(tmp_path))


def test_a_fit_takes_the_same_steps_on_a_cluster(study, tmp_path):
    x = np.linspace(0.0, 9.0, 19)
    force = Curve(channel="force", abscissa=x, ordinate=0.5 * x**1.5)
    found = []
    for executor in (InProcess(), DaskExecutor()):
        of_kind = replace(study, executor=executor, search=LeastSquares(), n_sets=0)
        with Simulations(of_kind, tmp_path / executor.name, {}) as simulations:
            stage = FitStage(
                study=of_kind,
                design=draw_study(of_kind, None),
                measured={"p1": Response(curves={"force": force})},
                scores=pl.DataFrame(),
                simulations=simulations,
                abscissae={"force": "depth_mm"},
            )
            found.append(fit_result(stage.run(), simulations))
    here, there = found
    assert here.table["n_runs"][0] > 2
    assert here.trace.equals(there.trace)
    assert here.table.equals(there.table)


def test_a_cluster_of_this_machine_opens_no_port():
    with dask_cluster.connected(DaskSettings(), 1) as client:
        assert client.scheduler.address.startswith("inproc://")
        ports = [each.laddr for each in psutil.Process().net_connections("inet") if each.status == "LISTEN"]
        assert ports == []
        assert client.submit(sum, [1, 2]).result() == 3


def test_workers_stay_warm_and_what_is_not_to_go_on_is_drained(study, tmp_path):
    results = []
    batch = replace(batch_of(study), should_continue=lambda: len(results) < 3)
    for result in DaskExecutor().results(batch):
        results.append(result)  # noqa: PERF402 - should_continue looks at how many there are
    assert 3 <= len(results) < 8
    assert len(started(tmp_path)) == len(results)
    assert len({pid for _, pid in started(tmp_path)}) <= 2


@pytest.mark.slow
def test_cluster_and_processes_stay_for_the_next_batch_until_they_are_closed(
    study, tmp_path, monkeypatch, until, has_ended
):
    opened, connected = [], dask_cluster.connected

    def counting(*given):
        opened.append(given)
        return connected(*given)

    monkeypatch.setattr("palpate_dask.flow.connected", counting)
    executor, batch = DaskExecutor(), replace(batch_of(study), n_workers=1)
    for jobs in (batch.jobs[:2], batch.jobs[2:3]):
        assert {s.status for _, s in executor.results(replace(batch, jobs=jobs))} == {Status.OK}
    (process,) = {pid for _, pid in started(tmp_path)}
    other = replace(batch, jobs=batch.jobs[:1], limits=Limits(time_s=50.0))
    assert {s.status for _, s in executor.results(other)} == {Status.OK}
    assert len(opened) == 1
    assert len({pid for _, pid in started(tmp_path)}) == 2  # other limits: another runtime there
    until(lambda: has_ended(int(process)))
    executor.close()
    for _, pid in started(tmp_path):
        until(lambda pid=pid: has_ended(int(pid)))


# ------------------------------------------------------------------ bad clusters


def test_an_address_without_a_scheduler_is_reported(study):
    executor = DaskExecutor(DaskSettings(address="tcp://127.0.0.1:9", timeout="1 s"))
    with pytest.raises(ExecutorError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9 within 1 s"):
        list(executor.results(batch_of(study)))


def test_workers_of_other_versions_are_refused_with_both(study, monkeypatch):
    here = worker_runtime.versions
    answers = iter([here(study.solver) | {"palpate": "9.9", "extra": "1"}])
    monkeypatch.setattr(worker_runtime, "versions", lambda *given: next(answers, None) or here(*given))
    with pytest.raises(ExecutorError, match=r"versions: palpate .* instead of 9\.9; extra absent instead"):
        list(DaskExecutor().results(batch_of(study)))


def test_the_code_of_installed_plugins_is_among_the_versions(study):
    found = worker_runtime.versions(study.solver)
    assert re.fullmatch(r"\d+\.\d+\.\d+, source [0-9a-f]{16}", found["palpate-materials"])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"address": "head:8786"}, "not of the form tls://host:port"),
        ({"address": "tls://head:8786"}, "tls:// needs certificates"),
        ({"address": "tcp://10.0.0.7:8786"}, "would be reached unencrypted"),
        ({"address": "tcp://localhost:1", "scheduler_file": "s.json"}, "different clusters; keep one"),
        ({"scheduler_file": "nowhere.json"}, "no file 'nowhere.json'"),
        ({"tls": {"ca_file": "ca.pem", "cert": "c.pem", "key": "k.pem"}}, "ca_file: no file 'ca.pem'"),
        ({"jobqueue": {"system": "slurm", "memory": "2 s"}}, "not of the kind of MB"),
        ({"jobqueue": {"system": "cron", "memory": "2 GB"}}, "slurm"),
        ({"adress": "tcp://localhost:1"}, "adress"),
    ],
)
def test_settings_that_cannot_work_are_refused(given, said):
    with pytest.raises(ValueError, match=said):
        DaskSettings(**given)


def test_a_private_network_may_be_unencrypted():
    assert DaskSettings(address="tcp://10.0.0.7:8786", plain_tcp=True).plain_tcp
    assert DaskSettings(address="tcp://127.0.0.1:8786").address


# ---------------------------------------------------------- a cluster of its own


@pytest.fixture
def cluster(tmp_path, until):
    """Scheduler and worker as processes of their own; yields the scheduler and its file."""
    file, processes = tmp_path / "scheduler.json", []

    def run(*given):
        code = f"from distributed.cli import {given[0]} as cli; cli.main()"
        processes.append(
            subprocess.Popen(
                [sys.executable, "-c", code, "--scheduler-file", str(file), "--no-dashboard", *given[1:]],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        )

    run("dask_scheduler", "--host", "127.0.0.1", "--port", "0")
    until(file.exists)
    run("dask_worker", "--nthreads", "1", "--no-nanny", "--host", "127.0.0.1", "--death-timeout", "300")
    yield processes[0], file
    for process in processes:
        process.kill()
        process.wait()


@pytest.mark.slow
def test_the_scheduler_s_end_loses_nothing_and_the_sweep_continues_elsewhere(study, tmp_path, cluster):
    scheduler, file = cluster
    settings = study.solver.settings.model_copy(update={"pause_s": 0.1})
    study = replace(study, n_sets=40, solver=type(study.solver)(settings))
    there = DaskExecutor(DaskSettings(scheduler_file=str(file), timeout="60 s"))

    class Killing(Progress):
        """Kills the scheduler once some simulations are counted."""

        n_steps = 0

        def step(self, note=""):
            self.n_steps += 1
            if self.n_steps == 4:
                os.kill(scheduler.pid, signal.SIGKILL)

    design = draw_design(study.space, study.sampler, study.n_sets, study.seed)
    folder = tmp_path / "run"
    with pytest.raises(ExecutorError, match=r"scheduler is gone.*everything finished is kept"):
        simulation.simulate(replace(study, executor=there), design, {}, {"p1": {}}, folder, Killing())
    with Ledger(folder) as ledger:
        kept = ledger.frame()
    assert 4 <= kept.height < 40
    found = sweep(replace(study, executor=InProcess()), folder)
    assert {s.status for s in found} == {Status.OK}
    with Ledger(folder) as ledger:
        rows = ledger.frame()
    assert rows.height == 40
    assert rows["n_attempts"].max() == 1


SBATCH = """#!/bin/sh
cp "$1" {folder}/job.sh
setsid sh {folder}/job.sh > {folder}/job.log 2>&1 < /dev/null &
echo $!
"""


@pytest.mark.slow
def test_jobs_of_a_batch_system_work_over_tls_and_end_with_the_run(
    study, tmp_path, monkeypatch, until, has_ended
):
    """The commands of Slurm, played by this machine."""
    pytest.importorskip("dask_jobqueue")
    for name, script in {"sbatch": SBATCH, "scancel": "#!/bin/sh\nkill -- -$1\n"}.items():
        (tmp_path / name).write_text(script.format(folder=tmp_path))
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    queue = {
        "system": "slurm",
        "cores": 2,
        "memory": "1 GB",
        "options": {"interface": "lo", "shared_temp_directory": str(tmp_path), "queue": "short"},
    }
    found = list(DaskExecutor(DaskSettings(jobqueue=queue)).results(batch_of(study)))
    assert sorted(index for index, _ in found) == list(range(8))
    assert {s.status for _, s in found} == {Status.OK}
    job = (tmp_path / "job.sh").read_text()
    assert "#SBATCH -p short" in job
    assert "tls://127.0.0.1" in job
    assert "--nthreads 2" in job
    for _, pid in started(tmp_path):
        until(lambda pid=pid: has_ended(int(pid)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # dask-jobqueue leaves files of its keys open
        gc.collect()


def test_a_plugin_file_that_a_worker_cannot_load_is_reported(study, tmp_path):
    broken = tmp_path / "broken.py"
    broken.write_text("raise RuntimeError('no licence')")
    batch = replace(batch_of(study), plugin_files=(*study.plugin_files, broken))
    with pytest.raises((ExecutorError, PluginError), match="no licence"):
        list(DaskExecutor().results(batch))
