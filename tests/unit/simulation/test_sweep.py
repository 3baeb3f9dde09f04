"""What becomes of jobs that fail, of jobs that others have done, and of a sweep that is to stop."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from palpate.domain import Limb, Mesh, Spot, Status
from palpate.errors import StoppedError
from palpate.executors import Batch, InProcess, Limits, Processes
from palpate.experiment.measured import load_measured
from palpate.fit.least_squares import LeastSquares
from palpate.plugins.registry import load_file
from palpate.progress import Progress
from palpate.run.ledger import Ledger
from palpate.sampling.drawing import draw_design
from palpate.simulation import jobs as simulation
from palpate.simulation.sweep import Simulations
from palpate.stages import pipeline


class Following(Progress):
    """Progress that stops after some steps and keeps what was reported."""

    def __init__(self, n_steps=10**9):
        self.n_steps, self.steps, self.notes = n_steps, [], []

    def begin(self, stage, total):
        self.total = total

    def step(self, note=""):
        self.steps.append(note)

    def note(self, text):
        self.notes.append(text)

    def should_continue(self):
        return len(self.steps) < self.n_steps


@pytest.fixture
def sweep(make_study, plugins, tmp_path):
    def run(solver, folder="run", progress=None, n_sets=6, **changes):
        study = make_study(solver=solver, n_sets=n_sets, **changes)
        design = draw_design(study.space, study.sampler, study.n_sets, study.seed, n_total=study.n_total)
        measured = load_measured(study, plugins.channels)
        return simulation.simulate(study, design, {}, measured, tmp_path / folder, progress or Following())

    return run


def planned(folder):
    with Ledger(folder) as ledger:
        return ledger.sweep().select("spot", "set_id", "key")


def test_a_sweep_that_is_stopped_continues_with_what_is_missing(sweep, tmp_path, tissue):
    log = tmp_path / "log.txt"
    solver = tissue.Analytic(tissue.AnalyticSettings(log=str(log)))
    with pytest.raises(StoppedError, match=r"stopped with 3 simulations finished.*palpate run .*run"):
        sweep(solver, progress=Following(n_steps=6), n_workers=1)
    n_tried = len(log.read_text().splitlines())
    sweep(solver)
    tried = log.read_text().splitlines()
    assert len(set(tried)) == len(tried) > n_tried


def test_a_key_of_another_study_is_not_computed_again(sweep, tissue, tmp_path):
    log = tmp_path / "log.txt"
    solver = tissue.Analytic(tissue.AnalyticSettings(log=str(log)))
    first = sweep(solver, "one", cache=tmp_path / "cache")
    assert len(log.read_text().splitlines()) == 6
    second = sweep(solver, "two", cache=tmp_path / "cache", name="another")
    assert len(log.read_text().splitlines()) == 6
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a.response["torque"].ordinate, b.response["torque"].ordinate)
    sweep(solver, "three")
    assert len(log.read_text().splitlines()) == 12


@pytest.mark.slow
def test_a_job_that_kills_its_worker_twice_is_not_tried_again(sweep, tmp_path, tissue):
    log = tmp_path / "log.txt"
    solver = tissue.Faulty(tissue.Faulty.Settings(log=str(log)))
    found = sweep(solver, n_sets=2, n_workers=2, time_limit_s=30.0)
    assert found[1].status is Status.CRASHED
    assert "ended twice on this job: exit code 17" in found[1].message
    with Ledger(tmp_path / "run") as ledger:
        assert sorted(ledger.frame()["n_crashes"]) == [0, 2]
    n_lines = len(log.read_text().splitlines())
    again = sweep(solver, n_sets=2, n_workers=2, time_limit_s=30.0)
    assert len(log.read_text().splitlines()) == n_lines
    assert again[1].message == found[1].message
    more = sweep(solver, n_sets=2, n_workers=2, time_limit_s=30.0, n_attempts=3)
    assert "ended 3 times on this job" in more[1].message


class Repeating(InProcess):
    def results(self, batch):
        for index, found in super().results(batch):
            yield index, replace(found, n_crashes=index % 2, message="repeated, as memory ran out")


def test_simulations_that_were_repeated_are_reported(sweep, tissue):
    progress = Following()
    sweep(tissue.Analytic(), progress=progress, executor=Repeating())
    assert "3 simulations had to be repeated; the last: repeated, as memory ran out" in progress.notes


def jobs_for(study, n_sets):
    values = np.linspace([0.2, 10.0], [0.8, 40.0], n_sets)
    design = SimpleNamespace(n_sets=n_sets, values=values, first_values=values)
    return simulation.jobs(replace(study, spots=study.spots[:1]), design, {})


def test_the_study_sets_the_attempts(make_study, tissue, tmp_path):
    log = tmp_path / "log.txt"
    study = make_study(solver=tissue.Faulty(tissue.Faulty.Settings(log=str(log))))
    batch = Batch(
        solver=study.solver,
        jobs=jobs_for(study, 2)[1:],
        limbs={},
        limits=Limits(time_s=30.0, n_attempts=1),
        plugin_files=study.plugin_files,
    )
    ((_, result),) = Processes().results(batch)
    assert result.n_crashes == 1
    assert "ended once" in result.message
    assert len(log.read_text().splitlines()) == 1


def test_a_repeated_stage_reads_the_ledger_bit_for_bit(sweep, make_study, tmp_path, tissue):
    log, folder = tmp_path / "log.txt", tmp_path / "run"
    solver = tissue.Analytic(tissue.AnalyticSettings(log=str(log)))
    sweep(solver, n_sets=2)
    before, study = planned(folder), make_study(solver=solver)
    trials = [replace(job, set_id=-1 - i) for i, job in enumerate(jobs_for(study, 4))]
    asked = (trials[:3], trials[1:])
    with Simulations(study, folder, {}) as simulations:
        first = [each for jobs in asked for each in simulations.of(jobs)]
        assert len(log.read_text().splitlines()) == 2 + 4
    with Simulations(study, folder, {}) as simulations:
        again = [each for jobs in asked for each in simulations.of(jobs)]
    assert len(log.read_text().splitlines()) == 2 + 4
    for a, b in zip(first, again, strict=True):
        assert a.job is b.job
        assert (a.status, a.seconds, a.diagnostics) == (b.status, b.seconds, b.diagnostics)
        assert np.array_equal(a.response["torque"].ordinate, b.response["torque"].ordinate)
    assert planned(folder).equals(before)


class Counting(InProcess):
    def __init__(self):
        super().__init__()
        self.n_batches = self.n_closed = 0

    def results(self, batch):
        self.n_batches += 1
        return super().results(batch)

    def close(self):
        self.n_closed += 1


@pytest.mark.slow
def test_all_stages_share_one_executor_which_is_closed_at_the_end(make_study, plugins, tmp_path, one_figure):
    executor = Counting()
    study = make_study(executor=executor, search=LeastSquares())
    pipeline.run_study(study, tmp_path / "run", plugins)
    assert executor.n_batches > 1
    assert executor.n_closed == 1


def test_the_executor_is_closed_when_a_stage_is_interrupted(sweep, tissue):
    class Interrupting(Following):
        def step(self, note=""):
            raise KeyboardInterrupt

    executor = Counting()
    with pytest.raises(KeyboardInterrupt):
        sweep(tissue.Analytic(), progress=Interrupting(), executor=executor)
    assert (executor.n_batches, executor.n_closed) == (1, 1)


def test_each_job_is_done_on_the_limb_of_its_name(make_study, tissue, tmp_path):
    class Weighing(tissue.Analytic):
        def simulate(self, job, limb):
            return replace(super().simulate(job, limb), message=f"{limb.mesh.points_mm.max():g}")

    def limb(size):
        mesh = Mesh(
            points_mm=size * np.eye(4, 3),
            cells={"tet4": [[0, 1, 2, 3]]},
            cell_regions={"tet4": [0]},
            regions=("soft_tissue",),
            node_sets={},
        )
        return Limb(spot=Spot(name="p1"), mesh=mesh)

    study = make_study(solver=Weighing())
    (job,) = jobs_for(study, 1)
    with Simulations(study, tmp_path / "run", {"p1": limb(1.0), "p1/fine": limb(2.0)}) as simulations:
        coarse, fine = simulations.of([job, replace(job, mesh="fine")])
    assert (coarse.message, fine.message) == ("1", "2")


GREEDY = """
import os
import numpy as np
from palpate import Curve, Response, Simulation, Solver, Status
class Greedy(Solver):
    name, summary = "greedy", "takes memory"
    def simulate(self, job, limb):
        room = np.ones(int((1 if job.set_id else 400) * 1e6 / 8))
        rise = Curve(channel="force", abscissa=[0, 1], ordinate=[0, 1])
        return Simulation(job=job, status=Status.OK, response=Response(curves={"force": rise}))
"""


def test_only_the_job_with_too_much_memory_fails(make_study, tmp_path):
    path = tmp_path / "greedy.py"
    path.write_text(GREEDY)
    study = make_study(solver=load_file(path).Greedy())
    batch = Batch(
        solver=study.solver,
        jobs=jobs_for(study, 3),
        limbs={},
        limits=Limits(time_s=30.0, memory_MB=200.0),
        n_workers=1,
        plugin_files=(*study.plugin_files, path),
    )
    found = dict(Processes().results(batch))
    assert [found[i].status for i in range(3)] == [Status.CRASHED, Status.OK, Status.OK]
    assert "MemoryError" in found[0].message


def test_workers_finish_their_jobs_and_start_no_more(make_study, tissue, tmp_path, has_ended):
    log = tmp_path / "log.txt"
    study = make_study(solver=tissue.Analytic(tissue.AnalyticSettings(log=str(log))))
    ended = []
    batch = Batch(
        solver=study.solver,
        jobs=jobs_for(study, 200),
        limbs={},
        limits=Limits(time_s=30.0),
        n_workers=2,
        plugin_files=study.plugin_files,
        should_continue=lambda: len(ended) < 5,
    )
    for result in Processes().results(batch):
        ended.append(result)  # noqa: PERF402 - should_continue looks at how many there are
    assert 5 <= len(ended) < 100
    assert {s.status for _, s in ended} == {Status.OK}
    assert all(has_ended(int(line.split()[-1])) for line in log.read_text().splitlines())


def has_warm_starts(tissue, monkeypatch):
    """A solver whose third set starts from the first two, and all later ones from the first four."""

    def n_warm_starts(self, number):
        return max(n for n in (0, 2, 4) if n <= number)

    monkeypatch.setattr(tissue.Analytic, "n_warm_starts", n_warm_starts)


def test_warm_starts_are_simulated_before_what_starts_from_them(sweep, tissue, tmp_path, monkeypatch):
    has_warm_starts(tissue, monkeypatch)
    log = tmp_path / "log.txt"
    found = sweep(tissue.Analytic(tissue.AnalyticSettings(log=str(log))), n_sets=7, executor=InProcess())
    sets = [int(line.split()[1]) for line in log.read_text().splitlines()]
    groups = [sorted(sets[i:j]) for i, j in ((0, 2), (2, 4), (4, 7))]
    assert groups == [[0, 1], [2, 3], [4, 5, 6]]
    for job in (each.job for each in found):
        n = {0: 0, 1: 0, 2: 2, 3: 2}.get(job.set_id, 4)
        assert (0 if job.warm_starts is None else len(job.warm_starts["soft_tissue"])) == n
        assert job.is_warm_start == (job.set_id < 4)


def test_an_extended_sweep_has_the_same_warm_starts(sweep, tissue, tmp_path, monkeypatch):
    has_warm_starts(tissue, monkeypatch)
    log = tmp_path / "log.txt"
    solver = tissue.Analytic(tissue.AnalyticSettings(log=str(log)))
    for n_total in (3, 5, 9, 4):
        sweep(solver, n_sets=6, n_total=n_total)
    assert len(log.read_text().splitlines()) == 9


def test_warm_starts_are_in_the_key_of_what_starts_from_them(make_study, tissue, monkeypatch):
    has_warm_starts(tissue, monkeypatch)
    study = make_study(solver=tissue.Analytic())
    *_, job = jobs_for(study, 5)
    (region,) = job.warm_starts
    others = {region: job.warm_starts[region] * 1.01}
    fewer = {region: job.warm_starts[region][:2]}
    changed = [replace(job, warm_starts=warm_starts) for warm_starts in (others, fewer, None)]
    keys = simulation.keys(study, [job, *changed], {})
    assert len(set(keys)) == 4
    copied, no_warm_start = (
        replace(job, warm_starts={region: job.warm_starts[region].copy()}),
        replace(job, is_warm_start=True),
    )
    assert simulation.keys(study, [copied, no_warm_start], {}) == [keys[0]] * 2


def test_sets_of_a_search_start_from_the_first_on_their_path(make_study, tissue, tmp_path, monkeypatch):
    has_warm_starts(tissue, monkeypatch)
    study = make_study(solver=tissue.Analytic())
    first, second, third = (
        replace(job, set_id=-1, warm_starts=None, is_warm_start=False, slopes=False)
        for job in jobs_for(study, 3)[:3]
    )
    with Simulations(study, tmp_path / "run", {}) as simulations:
        found = simulations.of([first, second]) + simulations.of([replace(first, slopes=True), third])
        asked = [simulations.known[simulations.key(each.job)].job for each in found]
    (region,) = first.thetas
    assert [job.is_warm_start for job in asked] == [True, False, True, False]
    for job in (asked[1], asked[3]):
        np.testing.assert_array_equal(job.warm_starts[region], first.thetas[region][None])
    with Simulations(study, tmp_path / "other", {}) as simulations:
        # Where others are asked for first, the same set has the same key, and another start.
        simulations.of([third])
        assert simulations.key(second) == simulations.key(found[1].job)
        (again,) = simulations.of([second])
        started = simulations.known[simulations.key(again.job)].job
    np.testing.assert_array_equal(started.warm_starts[region], third.thetas[region][None])


def test_a_set_on_a_finer_mesh_starts_from_rest(make_study, tissue, tmp_path, monkeypatch):
    has_warm_starts(tissue, monkeypatch)
    study = make_study(solver=tissue.Analytic())
    first, second = (replace(job, set_id=-1, warm_starts=None, mesh="fine") for job in jobs_for(study, 2)[:2])
    with Simulations(study, tmp_path / "run", {}) as simulations:
        simulations.of([first, second])
        assert all(each.job.warm_starts is None for each in simulations.known.values())
