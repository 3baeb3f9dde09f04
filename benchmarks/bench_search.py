"""How many simulations a search needs: ``make bench-search``.

Runs until Fopt is within 1 % of the least, from the middle of the paper's ranges, without a sweep: of
palpate's searches, and of SciPy's differential evolution and CMA-ES as peers on the same problem. Truths are
random, with noise of 1 % of the largest ordinate. Then 40 truths of each material: how many fits end in the
basin of the truth, and how many no worse than the best of 250 sets.

    python benchmarks/bench_search.py --fe --way CMA-ES    # at the demo's spot p1, by finite elements
"""

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cma
import numpy as np
import polars as pl
from scipy.optimize import differential_evolution

from palpate.domain import Design, Response
from palpate.experiment.measured import load_measured
from palpate.fit.least_squares import LeastSquares, LeastSquaresSettings
from palpate.fit.problem import Problem
from palpate.fit.running import Fit, run_searches
from palpate.fit.searches import DifferentialEvolution
from palpate.fit.stage import Case, FitStage
from palpate.fit.starts import accepted_start
from palpate.limb.loading import load_limbs
from palpate.plugins.catalogue import Plugins
from palpate.plugins.interfaces import Solver
from palpate.plugins.registry import load_file
from palpate.plugins.search import Search, Trial
from palpate.sampling.drawing import draw_design
from palpate.study.reading import Study, read_study
from palpate_materials.neo_hookean import NeoHookean
from palpate_materials.uncoupled import Ogden, Yeoh

pressed = load_file(Path(__file__).parents[1] / "tests" / "data" / "plugins" / "pressed_tissue.py")

MATERIALS = {
    "ogden": (Ogden(), ("c1", "m1", "kappa")),
    "yeoh": (Yeoh(), ("c1", "c2", "c3")),
    "neo-hookean": (NeoHookean(), ("E", "nu")),
}
ABSCISSAE = {"force": "depth_mm", "torque": "rotation_deg"}
WITHIN, MOST, N_SETS = 1.01, 20_000, 250


class ReachedError(Exception):
    """The optimum is near enough."""


@dataclass
class Task:
    """A problem to count on: its study, measured curves and limbs, and the Fopt to come to."""

    study: Study
    measured: Response
    limbs: dict
    goal: float = 0.0

    def stage(self) -> FitStage:
        space = self.study.space
        none = Design(
            parameters=space.parameters, values=np.zeros((0, len(space.parameters))), seed=1, n_drawn=0
        )
        return FitStage(
            study=self.study,
            design=none,
            measured=dict.fromkeys(self.study.spot_names, self.measured),
            scores=pl.DataFrame(),
            simulations=pressed.Here(self.study.solver, self.limbs),
            abscissae=ABSCISSAE,
        )

    def problem(self) -> tuple[Problem, pressed.Here, np.ndarray]:
        """The problem, what simulates it, and where searches start."""
        stage = self.stage()
        problem = stage.problem(Case("p1", self.study.spot_names, self.study.scenarios[0]), {})
        start = accepted_start(problem, np.full(len(problem.parameters), 0.5))
        return problem, stage.simulations, start

    def with_goal(self) -> "Task":
        search = LeastSquares(LeastSquaresSettings(tolerance=1e-9))
        ends = self.stage()
        ends.study = replace(self.study, search=search)
        return replace(self, goal=WITHIN * ends.run()[0].end.objective)


def say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def _without_slopes(solver: Solver) -> Solver:
    if isinstance(solver, pressed.Pressed):
        return pressed.Pressed(pressed.PressedSettings(exact=False))
    provides = replace(solver.provides, slopes=False)
    return type("WithoutSlopes", (type(solver),), {"provides": provides})(solver.settings)


def counted(task: Task, search: Search, exact: bool) -> float:
    """Simulations of a search of ours until the goal; infinite where it ends before."""
    study = task.study if exact else replace(task.study, solver=_without_slopes(task.study.solver))
    problem, here, start = replace(task, study=study).problem()
    fit = Fit(problem, start)

    def stepped(fit: Fit) -> None:
        if fit.objective <= task.goal:
            raise ReachedError

    try:
        run_searches(search, [fit], here.of, 1, stepped)
    except ReachedError:
        return here.n_coarse
    return np.inf


def peer(task: Task, minimise: Callable[[Callable[[np.ndarray], float], np.ndarray], None]) -> float:
    """Simulations of a minimiser of functions until the goal."""
    problem, here, start = task.problem()

    def objective(point: np.ndarray) -> float:
        (found,) = problem.evaluate([Trial(point=np.clip(point, 0.0, 1.0))])
        if found.objective <= task.goal:
            raise ReachedError
        return found.objective if np.isfinite(found.objective) else 1e6

    try:
        minimise(objective, start)
    except ReachedError:
        return here.n_coarse
    return np.inf


def by_scipy(objective: Callable[[np.ndarray], float], start: np.ndarray) -> None:
    differential_evolution(objective, [(0.0, 1.0)] * start.size, rng=1, x0=start, polish=False, maxiter=300)


def by_cma(objective: Callable[[np.ndarray], float], start: np.ndarray) -> None:
    options = {"bounds": [0.0, 1.0], "seed": 1, "verbose": -9, "maxfevals": MOST}
    cma.fmin2(objective, start, 0.3, options)


def best_of_sweep(task: Task) -> float:
    """Least Fopt of 250 sets."""
    (problem, _, _), study = task.problem(), task.study
    design = draw_design(study.space, study.sampler, N_SETS, 1, study.filters, max_draws=64 * N_SETS)
    return min(problem.fopt(row) for row in design.values)


WAYS: dict[str, Callable[[Task], float]] = {
    "least_squares, exact slopes": lambda task: counted(task, LeastSquares(), True),
    "least_squares, differences": lambda task: counted(task, LeastSquares(), False),
    "differential_evolution": lambda task: counted(task, DifferentialEvolution(), True),
    "SciPy's differential evolution": lambda task: peer(task, by_scipy),
    "CMA-ES": lambda task: peer(task, by_cma),
}


def tasks(name: str, n: int) -> Iterator[tuple[Task, np.ndarray]]:
    """Problems of random truths of a material, each with its truth."""
    material, searched = MATERIALS[name]
    study = pressed.study_of(material, searched, [pressed.Rising()])
    for i, row in enumerate(pressed.truths(study, n, seed=5)):
        yield Task(study, pressed.measured_at(study, row, noise=0.01, seed=i), {}), row


def demo() -> Task:
    """The demo's spot p1."""
    plugins = Plugins.load()
    folder = Path(plugins.studies["forearm-demo"].directory)
    study = read_study(folder / "study.toml", plugins)
    study = replace(study, spots=study.spots[:1])
    measured = load_measured(study, plugins.channels)
    return Task(study, measured["p1"], load_limbs(study))


def count(title: str, problems: list[Task], ways: list[str]) -> None:
    """Print the runs of each way, medians over the problems."""
    known = [task.with_goal() for task in problems]
    say(f"\n{title}: runs to Fopt + 1 %, median of {len(known)} (least to most)")
    first = 0.0
    for way in ways:
        runs = np.array([WAYS[way](task) for task in known])
        median = np.median(runs)
        first = first or median
        say(f"| {way} | {median:.0f} ({runs.min():.0f} to {runs.max():.0f}) | {median / first:.1f} × |")
    if not problems[0].limbs:
        ends = [WITHIN * best_of_sweep(task) / task.goal for task in known]
        say(f"| best of {N_SETS} sets | {N_SETS}, to {np.median(ends):.1f} × Fopt | {N_SETS / first:.1f} × |")


def far(name: str, n: int) -> None:
    """Print how many fits from the middle end in the basin of the truth."""
    right, better, runs = 0, 0, []
    for task, row in tasks(name, n):
        stage = task.stage()
        case = stage.run()[0]
        objective = case.end.objective if case.end else np.inf
        right += objective <= WITHIN * stage.problem(case, {}).fopt(row)
        better += objective <= best_of_sweep(task)
        runs.append(stage.simulations.n_coarse)
    say(f"| {name} | {right} of {n} | {better} of {n} | {np.median(runs):.0f}, at most {max(runs)} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fe", action="store_true", help="count at the spot p1 of the demo")
    parser.add_argument("--way", action="append", choices=WAYS, help="count only this way; may be repeated")
    parser.add_argument("--truths", type=int, default=10, help="truths to count on for each material")
    parser.add_argument("--far", type=int, default=40, help="truths of the second table")
    chosen = parser.parse_args()
    ways = chosen.way or list(WAYS)
    if chosen.fe:
        count("demo, spot p1", [demo()], ways)
        return
    for name in MATERIALS:
        count(name, [task for task, _ in tasks(name, chosen.truths)], ways)
    say("\n| far starts | right basin | not worse than the best of 250 sets | runs of the fit |")
    for name in MATERIALS:
        far(name, chosen.far)


if __name__ == "__main__":
    main()
