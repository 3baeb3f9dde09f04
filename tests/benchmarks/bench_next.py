"""What chosen presses are worth: ``make bench-next``.

Simulated sessions on strips of tissue in closed form, at four spots of different thickness. Each has random
parameters; presses have noise and an onset of their own; gains, friction, the mesh's error and what the model
leaves out are drawn once, in part for each spot. One way presses four spots alike, as the paper; the other
presses the first spot so, and then twice where the next press is expected to narrow most. Prints how wide the
intervals are beside each other, how many hold the truth, and how the width that was expected compares with
that of the fit.

    python tests/benchmarks/bench_next.py --n 50
"""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import pairwise

import bench_coverage as strips
import numpy as np
import polars as pl

from palpate import Curve, Job, Response, Simulation
from palpate.certainty.causes import ONSET_MM, RELATIVE
from palpate.certainty.stage import CertaintyStage
from palpate.domain import Design, Indentation, Spot
from palpate.fit.stage import FitStage
from palpate.indenters import Sphere
from palpate.planning.options import PlanOptions
from palpate.planning.presses import Press
from palpate.planning.stage import PlanningStage
from palpate.study.reading import StudySpot

THICKNESS = {"p1": 1.0, "p2": 0.8, "p3": 1.25, "p4": 1.5}
"""Strain of the strips of each spot, over that of the first."""
DEPTHS_MM, TWISTS_DEG = (5.0, 7.5, 10.0), ((), (-22.5, 22.5, 0.0), (-45.0, 45.0, 0.0))
N_CHOSEN, COMMON = 2, 0.5
NAMES = ("c1", "c2", "c3")


def protocol_of(depth: float, twist: tuple[float, ...]) -> Indentation:
    path = [(0.0, 0.0), (depth, 0.0), *((depth, angle) for angle in twist)]
    return Indentation(indenter=Sphere(radius_mm=7.5), path=path, friction=1.0)


class Spots(strips.Layered):
    """Strips that follow the path of the protocol; a spot's name begins with that of its place."""

    name, summary = "spots", "strips of tissue at several spots"

    def simulate(self, job: Job, limb: object) -> Simulation:
        path = job.protocol.path
        is_twisted = bool(path[:, 1].any())
        angles = _along(path[1:, 1]) if is_twisted else np.array([0.0, 1.0])
        strips.pressed.ANGLES, kept = angles, strips.pressed.ANGLES
        compressed = strips.pressed.COMPRESSED
        strips.pressed.COMPRESSED = compressed * THICKNESS[job.spot[:2]]
        try:
            found = super().simulate(job, None)
        finally:
            strips.pressed.ANGLES, strips.pressed.COMPRESSED = kept, compressed
        curves = {k: c for k, c in found.response.curves.items() if k == "force" or is_twisted}
        return replace(found, response=Response(curves=curves))


def _along(rotations: np.ndarray) -> np.ndarray:
    """Points along rotations, a quarter of a degree to two degrees apart."""
    parts = [np.linspace(a, b, 16)[1:] for a, b in pairwise(rotations)]
    return np.concatenate([rotations[:1], *parts]) if parts else rotations


class World:
    """What is true in one session."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.study = strips.study_of("yeoh", Spots())
        self.study = replace(self.study, protocol=protocol_of(10.0, TWISTS_DEG[1]))
        (self.row,) = strips.pressed.truths(self.study, 1, seed)
        budget, rng = self.study.budget, self.rng
        self.gain = {name: 1.0 + budget.gain * rng.normal() for name in ("force", "torque")}
        self.mesh = {name: 1.0 + budget.mesh * rng.normal() for name in ("force", "torque")}
        self.friction = 1.0 + RELATIVE * rng.normal()
        self.kappa = 1.0 + RELATIVE * rng.normal()
        self.shapes = {}

    def press(self, spot: str, protocol: Indentation) -> Response:
        """Measure a press."""
        onset = ONSET_MM * self.rng.normal()
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
        return Response(curves={name: self._measured(spot, c, onset) for name, c in curves.items()})

    def _measured(self, spot: str, curve: Curve, onset: float) -> Curve:
        x, y = curve.abscissa, curve.ordinate
        if curve.channel == "force":
            x = np.linspace(0.5, x.max() - onset, 40)
            y = np.interp(x + onset, curve.abscissa, curve.ordinate)
        path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(x)))]) / np.ptp(x)
        size = np.abs(y).max()
        shape = np.sqrt(COMMON) * self._shape("", curve.channel, path)
        shape += np.sqrt(1.0 - COMMON) * self._shape(spot, curve.channel, path)
        left = self.study.budget.discrepancy * shape * np.maximum.accumulate(np.abs(y))
        noise = strips.NOISE * size * self.rng.normal(size=x.size)
        y = y * self.gain[curve.channel] * self.mesh[curve.channel] + left + noise
        return Curve(channel=curve.channel, abscissa=x, ordinate=y)

    def _shape(self, spot: str, channel: str, path: np.ndarray) -> np.ndarray:
        """What the model leaves out along a path, the same at each press of a spot."""
        grid = np.linspace(0.0, 8.0, 161)
        if (spot, channel) not in self.shapes:
            along = np.exp(-0.5 * ((grid[:, None] - grid) / 0.4) ** 2) + 1e-8 * np.eye(grid.size)
            self.shapes[spot, channel] = np.linalg.cholesky(along) @ self.rng.normal(size=grid.size)
        return np.interp(path, grid, self.shapes[spot, channel])

    def fitted(self, presses: dict[str, tuple[Indentation, Response]]) -> tuple:
        """Fit presses by name; the case, its certainty, and the stage."""
        spots = tuple(
            StudySpot(spot=Spot(name=name), measured={}, mesh=None, protocol=protocol)
            for name, (protocol, _) in presses.items()
        )
        study = replace(self.study, spots=spots)
        measured = {name: response for name, (_, response) in presses.items()}
        parameters = study.space.parameters
        stage = FitStage(
            study=study,
            design=Design(parameters=parameters, values=np.zeros((0, len(self.row))), seed=1, n_drawn=0),
            measured=measured,
            scores=pl.DataFrame(),
            simulations=strips.Here(study.solver, {}),
            abscissae={"force": "depth_mm", "torque": "rotation_deg"},
        )
        case = stage.run()[0]
        certainty = CertaintyStage(study=study, measured=measured)
        columns = certainty.columns(case)
        return study, measured, certainty.assess(case, columns), columns


def widths_of(world: World, assessed: object) -> tuple[np.ndarray, np.ndarray]:
    """Widths of the intervals as shares of the ranges, and which hold the truth."""
    box = assessed.end.problem.box
    truth = (world.row - box.lower) / (box.upper - box.lower)
    low, high = assessed.density.interval(assessed.point)
    return high - low, (low <= truth) & (truth <= high)


def session(seed: int) -> dict:
    """Both ways in one world."""
    world = World(seed)
    first = protocol_of(10.0, TWISTS_DEG[1])
    alike = {spot: (first, world.press(spot, first)) for spot in THICKNESS}
    _, _, assessed, _ = world.fitted(alike)
    found = {"alike": widths_of(world, assessed)}
    made = {"p1": alike["p1"]}
    candidates = [
        Press(
            name=f"{spot}-{depth:g}-{max(twist, default=0):g}", spot=spot, protocol=protocol_of(depth, twist)
        )
        for spot in THICKNESS
        for depth in DEPTHS_MM
        for twist in TWISTS_DEG
    ]
    study, measured, assessed, columns = world.fitted(made)
    before = widths_of(world, assessed)[0]
    expected, chosen = [], []
    for _ in range(N_CHOSEN):
        stage = PlanningStage(
            study=study, measured=measured, assessed=assessed, columns=columns, refinement={}
        )
        best = stage.run(candidates, PlanOptions(n_points=4), {}).steps[0].chosen
        name = f"{best.press.press.name}#{len(made)}"
        protocol = best.press.press.protocol
        made[name] = (protocol, world.press(best.press.press.spot, protocol))
        study, measured, assessed, columns = world.fitted(made)
        after = widths_of(world, assessed)[0]
        expected.append(best.widths / (after / before))
        before = after
        chosen.append(name)
    found["chosen"] = widths_of(world, assessed)
    return found | {"expected": np.array(expected), "presses": chosen}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=50, help="sessions")
    chosen = parser.parse_args()
    with ProcessPoolExecutor() as pool:
        found = list(pool.map(session, range(chosen.n)))
    say(f"{chosen.n} sessions: four presses alike, and three of which two are chosen")
    say(
        "| 95 % interval of | width, chosen over alike | wider by more than 10 % | alike hold | chosen hold |"
    )
    say("|---|---|---|---|---|")
    ratios = np.array([each["chosen"][0] / each["alike"][0] for each in found])
    for i, name in enumerate(NAMES):
        held = [
            f"{100.0 * np.mean([each[way][1][i] for each in found]):.0f} %" for way in ("alike", "chosen")
        ]
        ratio = ratios[:, i]
        say(f"| {name} | {ratio.mean():.2f} | {np.mean(ratio > 1.1):.0%} | {' | '.join(held)} |")
    expected = np.array([each["expected"] for each in found])
    say("\nwidth that was expected over that of the fit, of each chosen press:")
    for k in range(N_CHOSEN):
        at = expected[:, k]
        within = np.mean(np.abs(at - 1.0) <= 0.25)
        say(f"press {k + 2}: median {np.median(at):.2f}, within 25 %: {within:.0%}")
    names = [name for each in found for name in each["presses"]]
    counts = {name: sum(n.startswith(name) for n in names) for name in {n.partition("#")[0] for n in names}}
    most = sorted(counts.items(), key=lambda item: -item[1])[:6]
    say("chosen most: " + ", ".join(f"{name} ({count})" for name, count in most))


def say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
