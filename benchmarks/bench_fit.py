"""Runs, time and errors of fits by finite elements: ``make bench-fit``.

The studies are the ready ones, whose data another solver made on finer meshes, without a sweep and by the
scenario that generalises; the errors are those of the values under [truth]. The last row has the same mesh
and solver make the data. The sweep that the paper would have run is the peer: its time is that of as many
simulations as it has, each as long as the fit's were in the mean.

    python benchmarks/bench_fit.py --rows 1 4    # some of the rows
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from palpate.domain import Job
from palpate.limb.loading import load_limbs
from palpate.plugins.catalogue import Plugins
from palpate.plugins.registry import load_file
from palpate.stages.pipeline import run_study
from palpate.study.reading import Study, read_study

N_SETS = 250
HEADS = (
    "fit",
    "nodes",
    "runs",
    "of them fine",
    "wall",
    f"{N_SETS} sets",
    "errors [%]",
    "before the correction [%]",
)


@dataclass(frozen=True)
class Row:
    """One fit: a ready study, changed, and the figure that is asked of it."""

    title: str
    study: str
    change: Callable[[Study], Study] = lambda study: study


def say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def ready(name: str, plugins: Plugins) -> Study:
    """A ready study without its sweep, by the scenario that generalises alone."""
    study = read_study(Path(plugins.studies[name].directory) / "study.toml", plugins)
    main = tuple(s for s in study.scenarios if s.name == study.generalise_by)
    return replace(study, n_sets=0, scenarios=main)


def one_spot(study: Study) -> Study:
    return replace(study, spots=study.spots[:1])


def coarse(study: Study) -> Study:
    return replace(study, spots=tuple(replace(spot, fine_mesh=None) for spot in study.spots))


def errors(study: Study, values: dict[str, float]) -> str:
    """Relative error of each searched value."""
    parts = []
    for name, value in values.items():
        parts.append(f"{name.partition('.')[2]} {100.0 * (value / study.truth[name] - 1.0):+.2f}")
    return ", ".join(parts)


def fitted(row: Row, plugins: Plugins) -> str:
    study = row.change(ready(row.study, plugins))
    limbs = load_limbs(study)
    names = [p.name for p in study.space.parameters]
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        table = run_study(study, Path(folder) / "run", plugins).fit
        wall = time.perf_counter() - started
    first = table.table.row(0, named=True)
    cases = table.table.unique(["fit", "scenario"])
    runs, fine = int(cases["n_runs"].sum()), int(cases["n_fine"].sum())
    before = {}
    if not table.mesh.is_empty():
        joint = table.mesh.filter(table.mesh["fit"] == first["fit"])
        before = dict(zip(joint["parameter"], joint["coarse"], strict=True))
    nodes = [limbs[spot].mesh.n_nodes for spot in study.spot_names]
    sweep = wall / max(runs, 1) * N_SETS * len(study.spots)
    cells = (
        row.title,
        f"{min(nodes)} to {max(nodes)}",
        f"{runs}",
        f"{fine}",
        f"{wall:.0f} s",
        f"{sweep:.0f} s",
        errors(study, {name: first[name] for name in names}),
        errors(study, before),
    )
    return f"| {' | '.join(cells)} |"


def same_mesh(plugins: Plugins) -> str:
    """Largest error where the solver itself made the data on the mesh that is fitted."""
    bench = load_file(Path(__file__).parent / "bench_search.py")
    study = coarse(one_spot(ready("forearm-demo", plugins)))
    limbs = load_limbs(study)
    region = study.space.regions[0]
    names = [f"{region.region}.{p.name}" for p in region.material.parameters]
    fixed = {f"{region.region}.{name}": value for name, value in region.fixed.items()}
    true = np.array([{**fixed, **study.truth}[name] for name in names])
    theta = region.material.to_textbook(true, region.convention)
    spot = study.spot_names[0]
    job = Job(
        spot=spot,
        set_id=0,
        materials={region.region: region.material},
        thetas={region.region: theta},
        protocol=study.protocol_at(spot),
    )
    measured = study.solver.simulate(job, limbs[spot]).response
    task = bench.Task(study, measured, limbs)
    stage = task.stage()
    case = stage.run()[0]
    return (
        f"same mesh and solver, one spot: {errors(study, case.values())} %, {stage.simulations.n_coarse} runs"
    )


ROWS = (
    Row("one spot of the robot log, coarse mesh", "robot-log", lambda s: coarse(one_spot(s))),
    Row("demo, four spots jointly and each", "forearm-demo"),
    Row("robot log, four spots jointly and each", "robot-log"),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, nargs="*", default=range(1, len(ROWS) + 2), help="rows to run")
    chosen = parser.parse_args().rows
    plugins = Plugins.load()
    say(f"| {' | '.join(HEADS)} |\n|{'---|' * len(HEADS)}")
    for number, row in enumerate(ROWS, start=1):
        if number in chosen:
            say(fitted(row, plugins))
    if len(ROWS) + 1 in chosen:
        say(same_mesh(plugins))


if __name__ == "__main__":
    main()
