"""Kills runs, at random moments and at every write, and looks for what was lost: nothing may be.

    python tests/chaos/kills.py --random 200 --workers 20

Each victim is a fork of this process, so that a trial costs milliseconds. After each kill the
simulations that were on the disk must still be there; after the last one an undisturbed
run must leave the same bytes in every table as a run that was never killed, and have repeated
no finished simulation. The last line counts what was tried and what was lost; the exit code
is 1 if anything was.
"""

import argparse
import contextlib
import itertools
import json
import os
import random
import signal
import sqlite3
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from conftest import FIRST_PARTY, PATH, SCENARIOS, TISSUE_FILE, TRUTH, write_curves

from palpate import units
from palpate.domain import Indentation, ParameterSpace, RegionMaterial, Spot
from palpate.domain.indenter import Sphere
from palpate.executors import InProcess
from palpate.fit.least_squares import LeastSquares
from palpate.fit.parametrisation import StandardParametrisation
from palpate.mechanics import spectral  # noqa: F401 - forks inherit what is imported
from palpate.plugins.catalogue import Plugins
from palpate.plugins.registry import load_file
from palpate.run import atomic_files, ledger as ledgers
from palpate.run.fit_state import FitState
from palpate.run.ledger import Ledger
from palpate.sampling.samplers import LatinHypercube
from palpate.stages import core_stages, pipeline
from palpate.study.reading import Study, StudySpot
from palpate_indentation import motions  # noqa: F401
from palpate_report import sections  # noqa: F401
from palpate_report.figures import drawings  # noqa: F401
from palpate_report.page import html

tissue = load_file(TISSUE_FILE)


class Slow(tissue.Analytic):
    """Takes two milliseconds and writes each finished simulation to a file."""

    name = "slow"

    def behave(self, job):
        time.sleep(0.002)
        return super().behave(job)


def make_study(folder: Path, n_sets: int, n_workers: int) -> Study:
    """Study of two spots with a true value."""
    spots = []
    for name, truth in TRUTH.items():
        write_curves(folder / f"{name}.csv", tissue.answer(*truth))
        spots.append(StudySpot(spot=Spot(name=name), measured={None: (folder / f"{name}.csv",)}, mesh=None))
    material = tissue.Spongy()
    region = RegionMaterial(region="soft_tissue", material=material, searched=material.parameters, fixed={})
    solver = Slow() if n_workers == 1 else tissue.Analytic()
    return Study(
        name="sponge", description="", file=folder / "study.toml", data="simulated", spots=tuple(spots),
        loader=tissue.Table(), limb_source=None,
        protocol=Indentation(indenter=Sphere(radius_mm=7.5), path=PATH, friction=1.0),
        space=ParameterSpace(regions=(region,)), sampler=LatinHypercube(), n_sets=n_sets, seed=1, filters=(),
        solver=solver, scenarios=SCENARIOS[:1],
        generalise_by="I", truth={}, n_workers=n_workers, time_limit_s=60.0,
        search=LeastSquares(),
        parametrisation=StandardParametrisation(),
        plugin_files=(TISSUE_FILE,), executor=InProcess() if n_workers == 1 else None,
    )  # fmt: skip


def forked(act: Callable[[], None]) -> int:
    """Do something in a fork of this process, and return its process id at once."""
    pid = os.fork()
    if pid:
        return pid
    code = 1
    try:
        os.setsid()
        act()
        code = 0
    except BaseException as error:
        sys.stderr.write(f"{type(error).__name__}: {error}\n")
    finally:
        os._exit(code)


def finished(folder: Path) -> dict[str, str]:
    """Keys and digests on the disk, read as anyone could."""
    path = folder / "ledger.sqlite"
    if not path.exists():
        return {}
    connection = sqlite3.connect(path)
    try:
        return dict(connection.execute("SELECT key, digest FROM simulations"))
    except sqlite3.OperationalError:
        return {}  # killed before the first table
    finally:
        connection.close()


def tables(folder: Path) -> dict[str, bytes]:
    """Bytes of every final table."""
    paths = [*folder.glob("*.parquet"), *(folder / "report" / "tables").iterdir()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(paths)}


class Trials:
    """Runs of one study, some of them killed."""

    def __init__(self, home: Path, n_sets: int, n_workers: int) -> None:
        self.home = home
        home.mkdir()
        self.study = make_study(home, n_sets, n_workers)
        self.plugins = Plugins.load([TISSUE_FILE], entry_points=False, modules=FIRST_PARTY)
        self.counts: Counter[str] = Counter()
        started_at = time.monotonic()
        self.run_to_the_end("whole")
        self.seconds = time.monotonic() - started_at
        self.expected = tables(home / "whole")

    def run(self, name: str) -> None:
        """Run the study; the pictures are left out."""
        from palpate_report import from_run as writing

        def draw_none(content: object, folder: Path) -> tuple[Path, ...]:
            return ()

        writing.write_figures = draw_none
        pipeline.run_study(self.study, self.home / name, self.plugins)

    def run_to_the_end(self, name: str) -> None:
        """Run the study in an undisturbed fork."""
        _, status = os.waitpid(forked(lambda: self.run(name)), 0)
        if status:
            raise SystemExit(f"an undisturbed run ended with status {status}")

    def kill_at_random(self, name: str, moment: random.Random) -> None:
        """Kill a run some time after it began."""
        before = finished(self.home / name)
        pid = forked(lambda: self.run(name))
        time.sleep(moment.uniform(0.0, self.seconds))
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        self._count("random", before, name)

    def kill_at_write(self, name: str, number: int, *, after: bool) -> bool:
        """Kill a run before, or after, its so-manieth write; returns whether it had that many."""
        before = finished(self.home / name)

        def act() -> None:
            count_writes(number, after=after)
            self.run(name)

        _, status = os.waitpid(forked(act), 0)
        self._count("at writes", before, name)
        self.counts["killed"] += os.WIFSIGNALED(status)
        return os.WIFSIGNALED(status)

    def kill_in_fit(self, name: str, step: int) -> None:
        """Kill a run in its fit, after so many steps."""
        before = finished(self.home / name)

        def act() -> None:
            keep, steps = core_stages.write_fit_state, itertools.count(1)

            def killing(folder: Path, state: FitState) -> None:
                keep(folder, state)
                if next(steps) == step:
                    os.kill(os.getpid(), signal.SIGKILL)

            core_stages.write_fit_state = killing
            self.run(name)

        _, status = os.waitpid(forked(act), 0)
        self._count("in the fit" if os.WIFSIGNALED(status) else "too late", before, name)

    def check_end(self, name: str) -> None:
        """Let a run end, and compare its tables with those of one never killed."""
        self.run_to_the_end(name)
        if tables(self.home / name) != self.expected:
            self.counts["other bytes"] += 1
        with Ledger(self.home / name) as ledger:
            self.counts["twice"] += int((ledger.frame()["n_attempts"] > 1).sum())

    def _count(self, kind: str, before: dict[str, str], name: str) -> None:
        now = finished(self.home / name)
        self.counts[f"kills {kind}"] += 1
        self.counts["lost"] += sum(now.get(key) != digest for key, digest in before.items())


def count_writes(number: int, *, after: bool) -> None:
    """Kill this process at its so-manieth write: a flush, a move, or a statement of SQL that writes."""
    n_writes = 0

    def numbered(act: Callable[..., object]) -> Callable[..., object]:
        def write(*arguments: object, **options: object) -> object:
            nonlocal n_writes
            n_writes += 1
            if n_writes == number and not after:
                os.kill(os.getpid(), signal.SIGKILL)
            done = act(*arguments, **options)
            if n_writes == number:
                os.kill(os.getpid(), signal.SIGKILL)
            return done

        return write

    os.fsync, os.replace = numbered(os.fsync), numbered(os.replace)
    atomic_files.os, ledgers._insert = os, numbered(ledgers._insert)


def no_orphans(trials: Trials, name: str, moment: random.Random) -> None:
    """Kill a run once it has worker processes, and wait for them to end by themselves."""
    before = finished(trials.home / name)
    pid = forked(lambda: trials.run(name))
    trials.counts["workers seen"] += until(n_workers_alive)
    time.sleep(moment.uniform(0.0, 0.5) * trials.seconds)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    until(lambda: n_workers_alive() == 0)
    trials.counts["orphans"] += n_workers_alive()
    trials._count("with workers", before, name)


def until(reached: Callable[[], int]) -> int:
    """Wait until a value is not 0, at most five minutes; returns it."""
    deadline = time.monotonic() + 300.0
    while not (value := reached()) and time.monotonic() < deadline:
        time.sleep(0.1)  # each look reads the environment of every process
    return value


def n_workers_alive() -> int:
    """Worker processes of the runs of this process; a fork shows the environment of its parent's start."""
    mine, n_alive = f"{MARK}={os.getpid()}".encode(), 0
    for process in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):
            n_alive += mine in process.read_bytes().split(b"\0")
    return n_alive


MARK = "PALPATE_CHAOS"


def main() -> int:
    """Try everything and tell the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--random", type=int, default=200, help="kills at random moments")
    parser.add_argument("--workers", type=int, default=20, help="of them with worker processes")
    parser.add_argument("--first", type=int, default=1, help="first write at which a run is killed")
    parser.add_argument("--most", type=int, default=10**9, help="most kills at writes")
    parser.add_argument("--stride", type=int, default=1, help="writes from one kill to the next")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    moment, counts = random.Random(asked.seed), Counter()
    os.environ[MARK] = str(os.getpid())
    # What a run imports and compiles before it writes a page is inherited by every fork.
    html.template(), html.library(), units.convert("1 m", "mm")
    # JAX is imported, but computes nothing here: it has no threads that a fork could miss.
    warnings.filterwarnings("ignore", r"os\.fork\(\) was called", RuntimeWarning)
    # A kill leaves what the kernel has taken: no disk has to be waited for.
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        small = Trials(Path(folder) / "small", n_sets=3, n_workers=1)
        number = asked.first
        while small.counts["kills at writes"] < asked.most and small.kill_at_write(
            f"run{number}", number, after=number % 4 > 1
        ):
            small.check_end(f"run{number}")
            number += asked.stride
        counts += small.counts
        if asked.random:
            large = Trials(Path(folder) / "large", n_sets=60, n_workers=1)
            for i in range(asked.random):
                large.kill_at_random(f"run{i // 5}", moment)
                if i % 5 == 4 or i + 1 == asked.random:
                    large.check_end(f"run{i // 5}")
            for step in (1, 4):
                large.kill_in_fit("fit", step)
            large.check_end("fit")
            counts += large.counts
        if asked.workers:
            spread = Trials(Path(folder) / "spread", n_sets=60, n_workers=2)
            for i in range(asked.workers):
                no_orphans(spread, f"workers{i}", moment)
            spread.check_end(f"workers{asked.workers - 1}")
            counts += spread.counts
    bad = {name: counts[name] for name in ("lost", "twice", "other bytes", "orphans")}
    sys.stdout.write(json.dumps({**counts, **bad}) + "\n")
    return int(any(bad.values()))


if __name__ == "__main__":
    sys.exit(main())
