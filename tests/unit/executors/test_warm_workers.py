"""Worker processes between batches: they stay, with their limbs, and never outlive their executor."""

from collections import deque
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from palpate.domain import Limb, Mesh, Spot, Status
from palpate.errors import ExecutorError
from palpate.executors import Batch, Limits, Pool, Processes, pool
from palpate.plugins.registry import load_file
from palpate.simulation.jobs import jobs

WEIGHING = """
import os
from palpate import Curve, Response, Simulation, Solver, Status
class Weighing(Solver):
    name, summary = "weighing", "reports its limb and its process"
    def simulate(self, job, limb):
        rise = Curve(channel="force", abscissa=[0, 1], ordinate=[0, 1])
        size = 0.0 if limb is None else limb.mesh.points_mm.max()
        return Simulation(job=job, status=Status.OK, response=Response(curves={"force": rise}),
                          message=f"{size:g} {os.getpid()}")
"""


def limb(size):
    mesh = Mesh(
        points_mm=size * np.eye(4, 3),
        cells={"tet4": [[0, 1, 2, 3]]},
        cell_regions={"tet4": [0]},
        regions=("soft_tissue",),
        node_sets={},
    )
    return Limb(spot=Spot(name="p1"), mesh=mesh)


@pytest.fixture
def batch(make_study, tmp_path):
    """Make a batch of one job on each of the limbs named."""
    path = tmp_path / "weighing.py"
    path.write_text(WEIGHING)
    study = make_study(solver=load_file(path).Weighing())
    job, *_ = jobs(study, SimpleNamespace(n_sets=1, values=np.array([[0.4, 20.0]])), {})

    def make(names, limbs, n_workers=1, **changes):
        batch = Batch(
            solver=study.solver,
            jobs=[replace(job, spot=name) for name in names],
            limbs=limbs,
            limits=Limits(time_s=30.0),
            n_workers=n_workers,
            plugin_files=(*study.plugin_files, path),
        )
        return replace(batch, **changes)

    return make


def sizes_and_processes(executor, batch):
    found = dict(executor.results(batch))
    assert [found[i].status for i in range(len(batch.jobs))] == [Status.OK] * len(batch.jobs)
    answers = [found[i].message.split() for i in range(len(batch.jobs))]
    return [float(size) for size, _ in answers], {int(process) for _, process in answers}


def test_one_worker_serves_many_batches_and_is_sent_a_limb_once(batch, monkeypatch, has_ended):
    sent, tell = [], pool._Worker.tell

    def counting(worker, *message):
        sent.extend(message[1:2] if message[0] == "limb" else ())
        tell(worker, *message)

    monkeypatch.setattr(pool._Worker, "tell", counting)
    names = [f"p{i}" for i in range(pool.MOST_LIMBS + 1)]
    limbs = {name: limb(1.0 + i) for i, name in enumerate(names)}
    executor, first = Processes(), names[:4]
    expected = [1.0, 2.0, 3.0, 4.0]
    for _ in range(2):
        sizes, processes = sizes_and_processes(executor, batch(first, limbs))
        assert sizes == expected
    assert sorted(sent) == first
    sizes, again = sizes_and_processes(executor, batch(names, limbs))  # more than it keeps
    assert sizes == [limbs[name].mesh.points_mm.max() for name in names]
    assert sorted(sent) == names
    sent.clear()
    # Another limb of the same name takes its place, and without limbs none is used.
    assert sizes_and_processes(executor, batch(["p8"], {"p8": limb(50.0)})) == ([50.0], processes)
    assert sizes_and_processes(executor, batch(["p8"], {})) == ([0.0], processes)
    assert (sent, again) == (["p8"], processes)
    assert not has_ended(*processes)
    executor.close()
    assert has_ended(*processes)


@pytest.mark.slow
def test_what_a_worker_was_not_started_for_gets_other_workers(batch, tissue, has_ended):
    executor = Processes()
    _, first = sizes_and_processes(executor, batch(["p1"], {}))
    more = batch(["p1"], {}, limits=Limits(time_s=30.0, memory_MB=2000.0))
    _, second = sizes_and_processes(executor, more)
    assert has_ended(*first)
    left_early = executor.results(more)
    next(left_early)
    _, third = sizes_and_processes(executor, replace(more, jobs=more.jobs[:1]))
    assert second != third
    del executor, left_early
    assert has_ended(*third)


def test_two_batches_at_a_time_are_refused(batch):
    executor = Processes()
    first = executor.results(batch(["p1", "p2"], {}))
    next(first)
    list(executor.results(batch(["p1"], {})))
    with pytest.raises(ExecutorError, match="given other jobs, before these had ended"):
        list(first)
    executor.close()


def worker(*limbs, busy=False):
    last = limbs[-1] if limbs else None
    return SimpleNamespace(limbs=dict.fromkeys(limbs), limb_name=last, assigned=[0] if busy else [])


@pytest.mark.parametrize(
    ("waiting", "workers", "expected"),
    [
        # What it has; of that, what it did last.
        ({"p1": 1, "p2": 5, "p3": 9}, [worker("p1", "p2"), worker("p3")], ["p2"] * 4),
        # What no other has.
        ({"p1": 9, "p2": 1}, [worker(), worker("p1")], ["p2"]),
        # Nothing else waits: another's limb, rather than to be idle.
        ({"p1": 3}, [worker("p2"), worker("p1", busy=True)], ["p1"]),
        # Fewer than two for each worker: one at a time.
        ({"p1": 4}, [worker("p1"), worker()], ["p1"]),
        ({"p1": 5}, [worker("p1"), worker()], ["p1"] * 2),
    ],
)
def test_a_worker_gets_jobs_of_a_limb_that_it_has(batch, waiting, workers, expected):
    names = [name for name, n in waiting.items() for _ in range(n)]
    of = Pool(batch(names, {}), 2)
    of._workers = workers
    of._pending = {name: deque(i for i, each in enumerate(names) if each == name) for name in waiting}
    assert [names[i] for i in of._take(workers[0])] == expected


def test_few_jobs_keep_every_worker_busy(batch, until):
    executor = Processes()
    limbs = {f"p{i}": limb(1.0) for i in range(4)}
    processes = set()

    def served():
        processes.update(sizes_and_processes(executor, batch(list(limbs), limbs, n_workers=2))[1])
        return len(processes) == 2

    until(served)  # a worker may be late to start
    executor.close()
