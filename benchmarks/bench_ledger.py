"""The ledger next to Optuna's storages: seconds for each finished simulation, and for a large ledger.

    python benchmarks/bench_ledger.py [--rows 100000]

palpate keeps two curves of 80 points with each simulation; Optuna keeps two parameters and a
value with each trial, and no curves. Both wait for the same disk. Run with OMP_NUM_THREADS=1.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "chaos"))

from kills import make_study

from palpate.domain import Curve, Job, Response, Simulation, Status
from palpate.progress import Progress
from palpate.run.ledger import Ledger, Writer
from palpate.sampling.drawing import draw_design
from palpate.simulation import jobs as simulation

DEPTHS, ANGLES = np.linspace(0.0, 10.0, 80), np.linspace(-22.5, 22.5, 80)


def finished(i: int, key: str | None = None) -> tuple[str, Simulation]:
    """Make a key and a simulation with two curves."""
    curves = {
        "force": Curve(channel="force", abscissa=DEPTHS, ordinate=DEPTHS**1.5 * (1 + i % 7)),
        "torque": Curve(channel="torque", abscissa=ANGLES, ordinate=np.tanh(ANGLES / (2 + i % 5))),
    }
    answer = Simulation(
        job=Job(spot="p1", set_id=i), status=Status.OK, response=Response(curves=curves), seconds=1.0
    )
    return key or f"{i:064x}", answer


def timed(act: Callable[[], object]) -> tuple[float, float]:
    """Wall and processor seconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    act()
    return time.perf_counter() - wall, time.process_time() - cpu


def tell(what: str, wall: float, cpu: float, limit: float | None = None, unit: str = "ms") -> None:
    """Print a line."""
    scale = 1e3 if unit == "ms" else 1.0
    against = "" if limit is None else f"   (target {limit:g} {unit})"
    sys.stdout.write(f"{what:<58}{wall * scale:9.3f} {unit} wall {cpu * scale:9.3f} {unit} cpu{against}\n")


def stream(folder: Path, n: int) -> float:
    """As fast as results come."""
    every = [finished(i) for i in range(n)]

    def act() -> None:
        with Writer(folder) as writer:
            for each in every:
                writer.store(*each)

    wall, cpu = timed(act)
    tell(f"palpate, {n} results one after the other, each", wall / n, cpu / n, 5.0)
    return wall / n


def apart(folder: Path, n: int) -> None:
    """One every 50 ms, as a solver gives them: what the sweep waits for."""
    waited, every = 0.0, [finished(i) for i in range(n)]
    cpu = time.process_time()
    with Writer(folder) as writer:
        for each in every:
            time.sleep(0.05)
            started_at = time.perf_counter()
            writer.store(*each)
            waited += time.perf_counter() - started_at
    tell(
        f"palpate, {n} results 50 ms apart, each holds the sweep up",
        waited / n,
        (time.process_time() - cpu) / n,
        5.0,
    )
    with Writer(folder) as writer:
        wall, cpu = timed(lambda: [(writer.store(*finished(n + i)), writer.flush()) for i in range(n)])
    tell("palpate, from handed over to on the disk, each", wall / n, cpu / n)


def peers(folder: Path, n: int, ours: float) -> None:
    """Optuna's journal and its SQLite storage in the same run."""
    try:
        import optuna
    except ImportError:
        sys.stdout.write("Optuna is not installed: pip install optuna to see it here\n")
        return
    from optuna.storages.journal import JournalFileBackend

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    storages = {
        "journal": optuna.storages.JournalStorage(JournalFileBackend(str(folder / "journal.log"))),
        "RDB (SQLite)": f"sqlite:///{folder / 'optuna.sqlite'}",
    }
    ranges = {name: optuna.distributions.FloatDistribution(0.0, 1.0) for name in ("a", "b")}
    for name, storage in storages.items():
        study = optuna.create_study(storage=storage)
        trial = optuna.trial.create_trial(params={"a": 0.1, "b": 0.2}, distributions=ranges, value=1.0)

        def act(study: "optuna.Study" = study, trial: "optuna.trial.FrozenTrial" = trial) -> None:
            for _ in range(n):
                study.add_trial(trial)

        wall, cpu = timed(act)
        tell(f"Optuna {name}, {n} trials one after the other, each", wall / n, cpu / n)
        sys.stdout.write(f"{'':<4}palpate / Optuna {name}: {ours / (wall / n):.2f}\n")


class BegunError(Exception):
    """The sweep knows what is left."""


class UntilBegun(Progress):
    """Progress that stops the sweep once it knows what is left to be done."""

    def should_continue(self) -> bool:
        """Stop here."""
        raise BegunError


def large(folder: Path, n: int) -> None:
    """Open, resume and read a large ledger."""
    study = make_study(folder, n, 1)
    study = replace(study, spots=study.spots[:1])
    design = draw_design(study.space, study.sampler, n, 1)
    jobs = simulation.jobs(study, design, {})
    wall, cpu = timed(lambda: simulation.keys(study, jobs, {}))
    tell(f"keys of {n} jobs", wall, cpu, unit="s")
    keys = simulation.keys(study, jobs, {})
    with Writer(folder / "run") as writer:
        for i, key in enumerate(keys[:-1]):  # one is left to be done
            writer.store(*finished(i, key))
    measured = {spot.spot.name: spot for spot in study.spots}
    tell(
        f"open a ledger of {n} rows to write", *timed(lambda: Writer(folder / "run").__exit__(None)), 0.5, "s"
    )
    tell(f"open it and read every state of {n} rows", *timed(lambda: _entries(folder / "run")), 0.5, "s")

    def resume() -> None:
        try:
            simulation.simulate(study, design, {}, measured, folder / "run", UntilBegun())
        except BegunError:
            return

    resume()  # plans the sweep, as the first run did
    tell(f"resume {n} jobs, until it knows what is left", *timed(resume), 2.0, "s")
    with Ledger(folder / "run") as ledger:
        wall, cpu = timed(lambda: ledger.simulations(dict(zip(keys, jobs, strict=True))))
    tell(f"read the curves of {n} simulations", wall, cpu, unit="s")


def _entries(folder: Path) -> None:
    with Ledger(folder) as ledger:
        ledger.seconds()


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rows", type=int, default=100_000)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=os.environ.get("TMPDIR")) as name:
        folder = Path(name)
        for part in ("stream", "apart", "peers", "large"):
            (folder / part).mkdir()
        ours = stream(folder / "stream", 2000)
        apart(folder / "apart", 40)
        peers(folder / "peers", 200, ours)
        large(folder / "large", asked.rows)


if __name__ == "__main__":
    main()
