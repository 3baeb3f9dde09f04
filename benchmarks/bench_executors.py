"""What executors add to each job, and how fast the main process feeds them: ``make bench-executors``.

    python benchmarks/bench_executors.py [--jobs 100000]

The solver sleeps, so that 16 workers need no 16 cores. Run with OMP_NUM_THREADS=1.

First table: jobs of 0.2 s on 1 to 16 workers, after a batch that has started them. «Added» is what a
worker waits for between two jobs: wall time times workers over jobs, less the job. «Main» is processor time
of the main process, which holds the Dask cluster and its threads too.

Second table: a whole sweep with jobs that take nothing: the main process makes, hands out, checks and
stores each of them. So many workers as a job takes longer than that can be kept busy.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from palpate.domain import (
    Design,
    Indentation,
    Parameter,
    ParameterSpace,
    RegionMaterial,
    Response,
    Scenario,
    Spot,
)
from palpate.domain.indenter import Sphere
from palpate.executors import Batch, Limits, Processes
from palpate.fit.parametrisation import StandardParametrisation
from palpate.fit.searches import BestSet
from palpate.plugins.execution import Executor
from palpate.plugins.registry import load_file
from palpate.run.keys import JobKeys
from palpate.sampling.samplers import LatinHypercube
from palpate.simulation import jobs as simulation
from palpate.study.reading import Study, StudySpot
from palpate_dask.executor import DaskExecutor

WORKERS = (1, 2, 4, 8, 16)
PAUSE_S = 0.2
JOBS_EACH = 20
"""Jobs for each worker."""

N_EMPTY = 2000
"""Jobs of the second table."""

NOTHING = Response(curves={})
"""Measured curves of a solver that needs none."""

SLEEPER = """
import time
import numpy as np
from pydantic import Field
from palpate import (
    Curve, IsotropicMaterial, Parameter, Provides, Response, Settings, Simulation, Solver, Status,
)
X = np.linspace(0.0, 10.0, 80)
class Foam(IsotropicMaterial):
    name, summary = "foam", "one number"
    parameters = (Parameter(name="k", unit="MPa", lower=0.1, upper=1.0, kind="modulus",
                            description="stiffness", physical_lower=0.0),)
    def energy(self, stretches, theta): return theta[0] * ((stretches - 1.0) ** 2).sum(axis=-1)
class SleepSettings(Settings):
    pause_s: float = Field(0.0, description="Time of a job.")
class Sleep(Solver[SleepSettings]):
    name, summary, provides = "sleep", "sleeps", Provides(body="layers", channels=("force",))
    def n_warm_starts(self, number):
        return 36 if number >= 36 else 0
    def simulate(self, job, limb):
        time.sleep(self.settings.pause_s)
        (theta,) = job.thetas.values()
        names = ("force", "torque")
        curves = {name: Curve(channel=name, abscissa=X, ordinate=theta[0] * X) for name in names}
        return Simulation(job=job, status=Status.OK, response=Response(curves=curves))
"""


def study_of(folder: Path, executor: Executor, n_workers: int, pause_s: float) -> Study:
    """A study of one spot whose solver sleeps."""
    file = folder / "sleeper.py"
    file.write_text(SLEEPER)
    module = load_file(file)
    material = module.Foam()
    region = RegionMaterial(region="r", material=material, searched=material.parameters, fixed={})
    return Study(
        name="sleep", description="", file=folder / "study.toml", data="simulated",
        spots=(StudySpot(spot=Spot(name="p1"), measured={}, mesh=None),), loader=None, limb_source=None,
        protocol=Indentation(indenter=Sphere(radius_mm=7.5), path=[(0.0, 0.0), (9.0, 0.0)], friction=1.0),
        space=ParameterSpace(regions=(region,)), sampler=LatinHypercube(), n_sets=8, seed=1, filters=(),
        solver=module.Sleep(module.SleepSettings(pause_s=pause_s)),
        scenarios=(Scenario(name="force", weights={"force": 1.0}),), generalise_by="force",
        truth={}, n_workers=n_workers, time_limit_s=60.0, plugin_files=(file,), executor=executor,
        search=BestSet(), parametrisation=StandardParametrisation(),
    )  # fmt: skip


def design_of(study: Study, n_sets: int) -> Design:
    """So many sets."""
    parameters: tuple[Parameter, ...] = study.space.parameters
    values = np.linspace([0.2], [0.8], n_sets)
    return Design(parameters=parameters, values=values, seed=1, n_drawn=n_sets)


def batch_of(study: Study, n_sets: int) -> Batch:
    """All sets as jobs for an executor."""
    return Batch(
        solver=study.solver,
        jobs=simulation.jobs(study, design_of(study, n_sets), {}),
        limbs={},
        limits=Limits(time_s=60.0),
        n_workers=study.n_workers,
        plugin_files=study.plugin_files,
    )


def timed(act: Callable[[], object]) -> tuple[float, float]:
    """Wall and processor seconds of this process."""
    wall, cpu = time.perf_counter(), time.process_time()
    act()
    return time.perf_counter() - wall, time.process_time() - cpu


def write(*cells: object) -> None:
    """Print a row of a table."""
    sys.stdout.write("| " + " | ".join(map(str, cells)) + " |\n")
    sys.stdout.flush()


def scaling(folder: Path, kinds: dict[str, type[Executor]]) -> None:
    """Print what executors add to each job."""
    write("executor", "workers", "jobs", "wall s", "added ms a job", "busy", "main, cpu ms a job")
    write(*["---"] * 7)
    for name, kind in kinds.items():
        for n_workers in WORKERS:
            executor, n_jobs = kind(), JOBS_EACH * n_workers
            study = study_of(folder, executor, n_workers, PAUSE_S)
            list(executor.results(batch_of(study, 2 * n_workers)))
            wall, cpu = timed(lambda: list(executor.results(batch_of(study, n_jobs))))  # noqa: B023 - called at once
            executor.close()
            each = wall * n_workers / n_jobs
            added, busy = f"{1e3 * (each - PAUSE_S):.1f}", f"{PAUSE_S / each:.0%}"
            write(name, n_workers, n_jobs, f"{wall:.2f}", added, busy, f"{1e3 * cpu / n_jobs:.2f}")


def sweep(folder: Path, executor: Executor, n_jobs: int) -> None:
    """A whole sweep of jobs that take nothing, on two workers."""
    folder.mkdir()
    study = study_of(folder, executor, 2, 0.0)
    simulation.simulate(study, design_of(study, n_jobs), {}, {"p1": NOTHING}, folder)


def feeding(folder: Path, kinds: dict[str, type[Executor]]) -> None:
    """Print how many jobs a second a sweep takes, its start left out."""
    sys.stdout.write("\n")
    write("executor", "jobs", "wall ms a job", "main, cpu ms a job", "workers fed, jobs of 1 s")
    write(*["---"] * 5)
    for name, kind in kinds.items():
        counts = (N_EMPTY // 10, N_EMPTY)
        costs = [timed(partial(sweep, folder / f"{name}-{n}", kind(), n)) for n in counts]
        wall, cpu = (np.subtract(*costs[::-1]) / (0.9 * N_EMPTY)).tolist()
        write(name, N_EMPTY, f"{1e3 * wall:.2f}", f"{1e3 * cpu:.2f}", f"{1.0 / cpu:.0f}")


def planning(folder: Path, n_jobs: int) -> None:
    """Print what a large sweep costs before its first job."""
    study = study_of(folder, Processes(), 2, 0.0)
    design = design_of(study, n_jobs)
    found: list[list[object]] = []
    made = timed(lambda: found.append(simulation.jobs(study, design, {})))  # type: ignore[arg-type]
    keyed = timed(lambda: list(map(JobKeys(study.solver, {}).key, found[0])))  # type: ignore[arg-type]
    sys.stdout.write(f"\n{n_jobs:,} jobs: made in {made[1]:.2f} cpu s, their keys in {keyed[1]:.2f} cpu s\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--jobs", type=int, default=100_000)
    given = parser.parse_args()
    kinds: dict[str, type[Executor]] = {"processes": Processes, "dask": DaskExecutor}
    with tempfile.TemporaryDirectory() as folder:
        planning(Path(folder), given.jobs)
        feeding(Path(folder), kinds)
        sys.stdout.write("\n")
        scaling(Path(folder), kinds)


if __name__ == "__main__":
    main()
