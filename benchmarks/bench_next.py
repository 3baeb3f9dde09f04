"""What chosen presses are worth: ``make bench-next``.

Simulated sessions on strips of tissue in closed form, at four spots of different thickness. Each has random
parameters; presses have noise and an onset of their own; gains, friction and what the model leaves out are
drawn once, in part for each spot. One way presses four spots alike, as the paper; others press the first spot
so, and then twice where the next press is expected to reduce the error most, of the parameters or of the
force of a tool. With ``--mesh`` every curve has an error of the mesh, one standard deviation of which is so
much and which the budget states: most of it is shared by all presses, the rest is of each. Prints each
session as it ends, then how wide the intervals are relative to the four alike, how many hold the truth, and
the width that was expected over that of the fit.

    python benchmarks/bench_next.py --n 50
"""

import argparse
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import pairwise, repeat
from pathlib import Path

import bench_coverage as strips
import numpy as np
import polars as pl

from palpate import Curve, Job, Response, Simulation
from palpate.api.fit import path_of
from palpate.domain import Design, Indentation, Spot
from palpate.domain.indenter import Sphere
from palpate.fit.stage import FitStage
from palpate.study.reading import StudySpot
from palpate.study.tool import Tool
from palpate_certainty.assessment import Assessment
from palpate_certainty.assumptions import ASSUMED
from palpate_certainty.mesh_error import independent_parts
from palpate_planning.candidates import CandidatePress
from palpate_planning.propose import PlanningStage, PlanOptions

THICKNESS = {"p1": 1.0, "p2": 0.8, "p3": 1.25, "p4": 1.5}
"""Strain of the strips of each spot, over that of the first."""
UNDER_TOOL = 1.5
"""That under the tool whose force is predicted: more than under the first press."""
DEPTHS_MM, TWISTS_DEG = (5.0, 7.5, 10.0), ((), (-22.5, 22.5, 0.0), (-45.0, 45.0, 0.0))
N_CHOSEN, N_POINTS, N_DRAWS, COMMON = 2, 3, 64, 0.5
NAMES = ("c1", "c2", "c3")


def protocol_of(depth: float, twist: tuple[float, ...]) -> Indentation:
    path = [(0.0, 0.0), (depth, 0.0), *((depth, angle) for angle in twist)]
    return Indentation(indenter=Sphere(radius_mm=7.5), path=path, friction=1.0)


CANDIDATES = [
    CandidatePress(
        name=f"{spot}-{depth:g}-{max(twist, default=0):g}", spot=spot, protocol=protocol_of(depth, twist)
    )
    for spot in THICKNESS
    for depth in DEPTHS_MM
    for twist in TWISTS_DEG
]
TOOL = Tool(
    name="tool",
    protocol=protocol_of(10.0, ()),
    spots=(StudySpot(spot=Spot(name="p1"), measured={}, mesh=None),),
    threshold_MPa=None,
)
WAYS = {"three": False, "three for the tool": True}
"""Whether presses are chosen for the tool."""


class Spots(strips.Layered):
    """Strips that follow the path of the protocol; a spot's name begins with that of its place."""

    name, summary = "spots", "strips of tissue at several spots"

    def simulate(self, job: Job, limb: object) -> Simulation:
        path = job.protocol.path
        is_twisted = bool(path[:, 1].any())
        angles = _along(path[1:, 1]) if is_twisted else np.array([0.0, 1.0])
        strips.pressed.ANGLES, kept = angles, strips.pressed.ANGLES
        compressed = strips.pressed.COMPRESSED
        strips.pressed.COMPRESSED = compressed * THICKNESS.get(job.spot[:2], UNDER_TOOL)
        try:
            found = super().simulate(job, None)
        finally:
            strips.pressed.ANGLES, strips.pressed.COMPRESSED = kept, compressed
        curves = {k: c for k, c in found.response.curves.items() if k == "force" or is_twisted}
        return replace(found, response=Response(curves=curves))


class OnMesh(Spots):
    """Strips whose curves have the error of a mesh."""

    name, summary = "on_mesh", "strips of tissue at several spots, on meshes"
    provides = replace(Spots.provides, body="mesh")


def _along(rotations: np.ndarray) -> np.ndarray:
    """Points along rotations, a quarter of a degree to two degrees apart."""
    parts = [np.linspace(a, b, 16)[1:] for a, b in pairwise(rotations)]
    return np.concatenate([rotations[:1], *parts]) if parts else rotations


class World:
    """What is true in one session, and the presses that it allows."""

    candidates, tool = CANDIDATES, TOOL

    def __init__(self, seed: int, mesh: float = 0.0) -> None:
        self.rng, self.mesh, self.numbers = np.random.default_rng(seed), mesh, {}
        self.study = strips.study_of("yeoh", OnMesh() if mesh else Spots())
        if mesh:
            self.study = replace(self.study, budget=self.study.budget.model_copy(update={"mesh": {"": mesh}}))
        self.study = replace(self.study, protocol=protocol_of(10.0, TWISTS_DEG[1]))
        (self.row,) = strips.pressed.truths(self.study, 1, seed)
        budget, rng = self.study.budget, self.rng
        self.gain = {name: 1.0 + budget.gain * rng.normal() for name in ("force", "torque")}
        self.friction = 1.0 + ASSUMED.relative * rng.normal()
        self.kappa = 1.0 + ASSUMED.relative * rng.normal()
        self.shapes = {}

    def press(self, spot: str, protocol: Indentation) -> Response:
        """Measure a press."""
        onset = ASSUMED.onset_mm * self.rng.normal()
        path = protocol.path.copy()
        path[path[:, 0] > 0.0, 0] += onset
        thetas = self.study.space.thetas(self.row)
        (region,) = self.study.space.regions
        factors = [self.kappa if p.name == "kappa" else 1.0 for p in region.material.parameters]
        job = Job(
            spot=spot,
            set_id=0,
            materials={region.region: region.material},
            thetas={region.region: thetas[region.region] * factors},
            protocol=replace(protocol, path=path, friction=self.friction),
        )
        curves = self.study.solver.simulate(job, None).response.curves
        for name, curve in curves.items() if self.mesh else ():
            path = path_of(curve.abscissa)
            parts = independent_parts(self.mesh * curve.ordinate, path / path[-1])
            numbers = np.sqrt(ASSUMED.mesh_shared) * self._numbers(name, len(parts))
            numbers += np.sqrt(1.0 - ASSUMED.mesh_shared) * self._numbers(
                (spot, protocol.path.tobytes(), name), len(parts)
            )
            curves = {**curves, name: replace(curve, ordinate=curve.ordinate + numbers @ parts)}
        return Response(curves={name: self._measured(spot, c, onset) for name, c in curves.items()})

    def _numbers(self, key: object, n: int) -> np.ndarray:
        """Random numbers (n,) of one error of the mesh, drawn once."""
        return self.numbers.setdefault(key, self.rng.normal(size=n))

    def _measured(self, spot: str, curve: Curve, onset: float) -> Curve:
        x, y = curve.abscissa, curve.ordinate
        if curve.channel == "force":
            x = np.linspace(0.5, x.max() - onset, 40)
            y = np.interp(x + onset, curve.abscissa, curve.ordinate)
        path = path_of(x)
        size = np.abs(y).max()
        shape = np.sqrt(COMMON) * self._shape("", curve.channel, path)
        shape += np.sqrt(1.0 - COMMON) * self._shape(spot, curve.channel, path)
        left = self.study.budget.discrepancy_of(curve.channel) * shape * np.maximum.accumulate(np.abs(y))
        noise = strips.NOISE * size * self.rng.normal(size=x.size)
        y = y * self.gain[curve.channel] + left + noise
        return Curve(channel=curve.channel, abscissa=x, ordinate=y)

    def _shape(self, spot: str, channel: str, path: np.ndarray) -> np.ndarray:
        """What the model leaves out along a path, the same at each press of a spot."""
        grid = np.linspace(0.0, 8.0, 161)
        if (spot, channel) not in self.shapes:
            along = np.exp(-0.5 * ((grid[:, None] - grid) / 0.4) ** 2) + 1e-8 * np.eye(grid.size)
            self.shapes[spot, channel] = np.linalg.cholesky(along) @ self.rng.normal(size=grid.size)
        return np.interp(path, grid, self.shapes[spot, channel])

    def simulations(self) -> strips.Here:
        """What answers jobs."""
        return strips.Here(self.study.solver, {})

    def spot(self, name: str, protocol: Indentation) -> StudySpot:
        """A press as a spot of a study; a mesh that no solver reads says at which place."""
        return StudySpot(spot=Spot(name=name), measured={}, mesh=Path(name[:2]), protocol=protocol)

    def fitted(self, presses: dict[str, tuple[Indentation, Response]]) -> PlanningStage:
        """Fit presses by name, and what can be planned from there."""
        spots = tuple(self.spot(name, protocol) for name, (protocol, _) in presses.items())
        study = replace(self.study, spots=spots)
        measured = {name: response for name, (_, response) in presses.items()}
        parameters = study.space.parameters
        stage = FitStage(
            study=study,
            design=Design(parameters=parameters, values=np.zeros((0, len(self.row))), seed=1, n_drawn=0),
            measured=measured,
            scores=pl.DataFrame(),
            simulations=self.simulations(),
            abscissae={"force": "depth_mm", "torque": "rotation_deg"},
        )
        case, *others = stage.run()
        certainty = Assessment(study=study, measured=measured)
        columns, failures = certainty.columns(case)
        unpressed = [self.spot(name, study.protocol) for name in THICKNESS if name not in presses]
        return PlanningStage(
            study=replace(study, spots=(*spots, *unpressed)),
            measured=measured,
            assessed=certainty.assess(case, columns, failures, cases=others),
            columns=columns,
            meshes={},
        )

    def tool_force(self, row: np.ndarray) -> float:
        """Force of the tool on a material (n_searched,)."""
        materials = {region.region: region.material for region in self.study.space.regions}
        thetas = self.study.space.thetas(row)
        job = Job(spot="tool", set_id=0, materials=materials, thetas=thetas, protocol=TOOL.protocol)
        return float(self.study.solver.simulate(job, None).response.curves["force"].ordinate[-1])


def widths_of(world: World, stage: PlanningStage) -> tuple[np.ndarray, np.ndarray]:
    """Widths of the intervals as shares of the ranges, and of the tool's force relative to it; which hold."""
    assessed = stage.assessed
    box = assessed.end.problem.box
    truth = (world.row - box.lower) / (box.upper - box.lower)
    density = assessed.density
    low, high = density.interval(assessed.point)
    forces = [world.tool_force(box.lower + (box.upper - box.lower) * draw) for draw in density.draws(N_DRAWS)]
    ends, force = np.quantile(forces, [0.025, 0.975]), world.tool_force(world.row)
    widths = np.append(high - low, (ends[1] - ends[0]) / force)
    return widths, np.append((low <= truth) & (truth <= high), ends[0] <= force <= ends[1])


def chosen(world: World, first: tuple, *, for_tool: bool) -> dict:
    """The first press and those that are chosen after it."""
    options = PlanOptions(n_points=N_POINTS, tool=world.tool if for_tool else None)
    made = {"p1": first}
    stage = world.fitted(made)
    widths, expected, names = [widths_of(world, stage)[0]], [], []
    for _ in range(N_CHOSEN):
        best = stage.run(world.candidates, options, {}).steps[0].chosen
        press = best.press.press
        names.append(press.name)
        made[f"{press.name}#{len(made)}"] = (press.protocol, world.press(press.spot, press.protocol))
        stage = world.fitted(made)
        after, holds = widths_of(world, stage)
        expected.append(best.widths / (after / widths[-1])[: len(NAMES)])
        widths.append(after)
    return {"widths": widths[-1], "first": widths[0], "holds": holds, "expected": expected, "presses": names}


def session(seed: int, ways: list[str], mesh: float) -> dict:
    """Some ways in the world of a seed."""
    return compared(World(seed, mesh), ways)


def compared(world: World, ways: list[str]) -> dict:
    """Some ways in one world, the same first press in each."""
    usual = {press.name: press.protocol for press in world.candidates}
    alike = {
        spot: (usual[f"{spot}-10-22.5"], world.press(spot, usual[f"{spot}-10-22.5"])) for spot in THICKNESS
    }
    widths, holds = widths_of(world, world.fitted(alike))
    found = {"four alike": {"widths": widths, "holds": holds}}
    for way in ways:
        found[way] = chosen(world, alike["p1"], for_tool=WAYS[way])
    return found


def table(found: list[dict]) -> None:
    """Print every way relative to four alike."""
    of = [each["four alike"]["widths"] for each in found]
    say("| presses | " + " | ".join(f"{n}: width, wider by 10 %, holds" for n in (*NAMES, "tool")) + " |")
    say("|---|---|---|---|---|")
    for way in found[0]:
        ratios = np.array([each[way]["widths"] / alike for each, alike in zip(found, of, strict=True)])
        holds = np.array([each[way]["holds"] for each in found])
        cells = [
            f"{r.mean():.2f}, {np.mean(r > 1.1):.0%}, {h.mean():.0%}"
            for r, h in zip(ratios.T, holds.T, strict=True)
        ]
        say(f"| {way} | {' | '.join(cells)} |")


def expectations(way: str, found: list[dict]) -> None:
    """Print the expected over the realised width of each chosen press, and which were chosen most."""
    for k in range(N_CHOSEN):
        at = np.array([each[way]["expected"][k] for each in found])
        within = np.mean(np.abs(at - 1.0) <= 0.25)
        say(f"{way}, press {k + 2}: median {np.median(at):.2f}, within 25 %: {within:.0%}")
    counts = Counter(name for each in found for name in each[way]["presses"])
    say("chosen most: " + ", ".join(f"{name} ({n})" for name, n in counts.most_common(5)))
    over = np.median([each[way]["widths"][-1] / each[way]["first"][-1] for each in found])
    say(f"band of the tool over that of the first press: median {over:.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=50, help="sessions")
    parser.add_argument("--workers", type=int, help="processes; default: all cores")
    parser.add_argument("--ways", nargs="*", choices=WAYS, default=list(WAYS), help="how presses are chosen")
    parser.add_argument("--mesh", type=float, default=0.0, help="relative error of each curve by its mesh")
    asked = parser.parse_args()
    found = []
    with ProcessPoolExecutor(asked.workers) as pool:
        for each in pool.map(session, range(asked.n), repeat(asked.ways), repeat(asked.mesh)):
            found.append(each)
            say(f"{len(found)}: " + "; ".join(f"{way} {np.round(e['widths'], 4)}" for way, e in each.items()))
            if len(found) % 4 == 0:
                table(found)
    table(found)
    for way in asked.ways:
        expectations(way, found)


def say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
