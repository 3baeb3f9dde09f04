"""How often 95 % intervals hold the truth: ``make coverage``.

Simulated experiments on strips of tissue in closed form. Each has random parameters, measured curves
with noise, an onset, gains, friction and mesh error drawn from the budget, and a discrepancy along the
path that no parameter explains. The fit knows none of them. Prints how many intervals of each parameter,
and joint regions, hold the truth, and those of the noise alone; how many intervals are wider than 0.8 of the
range, which hold any truth; and how many experiments are called inadequate. ``--errors 2`` draws errors twice
as large as the budget has them, but for the noise, whose size a fit estimates.

    python benchmarks/bench_coverage.py --n 200 --studies yeoh --errors 2
    python benchmarks/bench_coverage.py --n 40 --posterior    # of emulated posteriors too
"""

import argparse
import functools
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl
from pydantic import Field

from palpate import Curve, Job, Limb, Response, Settings, Simulation, Solver, Status
from palpate.domain import Design, ParameterSpace, RegionMaterial
from palpate.fit.stage import FitStage
from palpate.plugins.provides import Provides
from palpate.plugins.registry import load_file
from palpate_certainty.assessment import Assessment
from palpate_certainty.error_sources import ONSET_MM, RELATIVE, SpotMesh
from palpate_certainty.posterior_sampling import PosteriorSampling
from palpate_materials.uncoupled import Ogden, Yeoh

pressed = load_file(Path(__file__).parents[1] / "tests" / "data" / "plugins" / "pressed_tissue.py")

NOISE, MESH, RATIO = 0.005, 0.03, 4.0
"""Noise over the largest ordinate; error of the coarse mesh; that over the error of the fine one."""
WIDE = 0.8
"""Width of an interval over the range beyond which it holds a truth of the range by construction."""
STUDIES = {
    "ogden": {"tissue": (Ogden(), ("c1", "m1", "kappa"))},
    "yeoh": {"tissue": (Yeoh(), ("c1", "c2", "c3"))},
    "two layers": {"skin": (Ogden(), ("c1",)), "tissue": (Ogden(), ("c1", "m1"))},
}
VOLUMES = {"skin": pressed.VOLUMES_MM3 * [0.0, 0.0, 0.5, 2.0], "tissue": pressed.VOLUMES_MM3}


class LayeredSettings(Settings):
    coarse: float = Field(default=0.0, description="Relative error of the coarse mesh.")
    fine: float = Field(default=0.0, description="Relative error of the fine mesh.")


class Layered(Solver[LayeredSettings]):
    """Strips of one or two tissues, by the depth and the friction of the protocol."""

    name, summary = "layered", "strips of tissue"
    provides = Provides(body="layers", slopes=True)

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        depth, friction = job.protocol.path[:, 0].max(), job.protocol.friction
        depths = np.linspace(0.0, depth, 41)
        curves = self._curves(job, job.thetas, depths, friction)
        slopes = {"friction": self._difference(job, depths, friction)} if job.slopes else {}
        for region, theta in job.thetas.items() if job.slopes else ():
            for k, parameter in enumerate(job.materials[region].parameters):
                step = np.eye(theta.size)[k] * 1e-5 * theta[k]
                ends = [
                    self._curves(job, {**job.thetas, region: theta + s * step}, depths, friction)
                    for s in (1, -1)
                ]
                slopes[f"{region}.{parameter.name}"] = (ends[0] - ends[1]) / (2.0 * step[k])
        parts = {"force": (depths, slice(0, 41)), "torque": (pressed.ANGLES, slice(41, None))}
        found = {
            name: Curve(
                channel=name,
                abscissa=x,
                ordinate=curves[at],
                slopes={key: slope[at] for key, slope in slopes.items()},
            )
            for name, (x, at) in parts.items()
        }
        return Simulation(job=job, status=Status.OK, response=Response(curves=found), seconds=1e-3)

    def _difference(self, job: Job, depths: np.ndarray, friction: float) -> np.ndarray:
        ends = [self._curves(job, job.thetas, depths, friction + s) for s in (1e-5, -1e-5)]
        return (ends[0] - ends[1]) / 2e-5

    def _curves(self, job: Job, thetas: dict, depths: np.ndarray, friction: float) -> np.ndarray:
        """Force and torque in one array; torque is lost to slip as the friction falls."""
        deepest, angles = np.full(pressed.ANGLES.size, depths[-1]), np.radians(pressed.ANGLES)
        force = self._slope(job, thetas, depths + pressed.STEP, 0.0 * depths)
        torque = self._slope(job, thetas, deepest, angles + pressed.STEP)
        torque *= 1.0 - 0.2 * np.exp(-2.0 * friction) * (1.0 + np.abs(angles) / 0.4)
        error = self.settings.fine if job.fine else self.settings.coarse
        size = np.concatenate([depths / 10.0, np.abs(angles) / 0.4])
        return np.concatenate([force, torque]) * (1.0 + error * (1.0 + size))

    def _slope(self, job: Job, thetas: dict, depth: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        total = 0.0
        for region, theta in thetas.items():
            total = total + pressed.energy(job.materials[region], depth, rotation, theta, VOLUMES[region])
        return total.imag / pressed.STEP.imag


@dataclass
class Here(pressed.Here):
    """Simulates in this process, each job once, by its protocol too."""

    def of(self, jobs: list[Job]) -> list[Simulation]:
        found = []
        for job in jobs:
            thetas = tuple(theta.tobytes() for theta in job.thetas.values())
            key = (job.spot, thetas, job.protocol.path.tobytes(), job.protocol.friction, job.slopes, job.fine)
            if key not in self.known:
                self.known[key] = self.solver.simulate(job, None)
            found.append(replace(self.known[key], job=job))
        return found


def study_of(name: str, solver: Solver):
    regions = [
        RegionMaterial(
            region=region,
            material=material,
            searched=tuple(p for p in material.parameters if p.name in searched),
            fixed={
                p.name: 1.0 if p.name == "kappa" else (p.lower + p.upper) / 2.0
                for p in material.parameters
                if p.name not in searched
            },
        )
        for region, (material, searched) in STUDIES[name].items()
    ]
    base = pressed.study_of(Ogden(), ("c1",), solver=solver)
    filters = (pressed.Rising(),) if name == "yeoh" else ()
    return replace(base, space=ParameterSpace(regions=tuple(regions)), filters=filters)


def measured_at(study, row: np.ndarray, rng: np.random.Generator, *, times: float = 1.0) -> Response:
    """What is measured of a material, with everything wrong that the budget has, or ``times`` as much."""
    budget = study.budget
    onset = times * rng.normal() * ONSET_MM
    path = study.protocol.path.copy()
    path[path[:, 0] > 0.0, 0] += onset
    friction = 1.0 + times * RELATIVE * rng.normal()
    protocol = replace(study.protocol, path=path, friction=friction)
    regions = study.space.regions
    thetas = {
        region: theta
        * [
            1.0 if p.name in {s.name for s in r.searched} else 1.0 + times * RELATIVE * rng.normal()
            for p in r.material.parameters
        ]
        for r, (region, theta) in zip(regions, study.space.thetas(row).items(), strict=True)
    }
    materials = {r.region: r.material for r in regions}
    job = Job(spot="p1", set_id=0, materials=materials, thetas=thetas, protocol=protocol)
    # What finer meshes than these would change is as uncertain as the change between these two.
    fine, left = study.solver.settings.fine, times * rng.normal() / (RATIO - 1.0)
    true = LayeredSettings(coarse=fine + left * (fine - study.solver.settings.coarse))
    response = Layered(true).simulate(job, None).response
    curves = {}
    for name, x in (("force", pressed.DEPTHS), ("torque", pressed.ANGLES)):
        curve = response.curves[name]
        # Depths count from where contact is taken to begin.
        y = np.interp(x + onset, curve.abscissa, curve.ordinate) if name == "force" else curve.ordinate
        path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(x)))]) / np.ptp(x)
        along = np.exp(-0.5 * ((path[:, None] - path) / 0.4) ** 2) + 1e-9 * np.eye(x.size)
        shape = np.linalg.cholesky(along) @ rng.normal(size=x.size)
        left = times * budget.discrepancy * shape * np.maximum.accumulate(np.abs(y))
        noise = NOISE * np.abs(y).max() * rng.normal(size=x.size)
        y = y * (1.0 + times * budget.gain * rng.normal()) + left + noise
        curves[name] = Curve(channel=name, abscissa=x, ordinate=y)
    return Response(curves=curves)


def experiment(
    name: str, seed: int, *, posterior: bool = False, measure: Callable[..., Response] = measured_at
) -> dict:
    """One experiment: which intervals hold the truth, and why the model was called inadequate."""
    rng = np.random.default_rng(seed)
    coarse = MESH * rng.normal()
    study = study_of(name, Layered(LayeredSettings(coarse=coarse, fine=coarse / RATIO)))
    (row,) = pressed.truths(study, 1, seed)
    measured = {"p1": measure(study, row, rng)}
    none = np.zeros((0, len(row)))
    stage = FitStage(
        study=study,
        design=Design(parameters=study.space.parameters, values=none, seed=1, n_drawn=0),
        measured=measured,
        scores=pl.DataFrame(),
        simulations=Here(study.solver, {"p1/fine": None}),
        abscissae={"force": "depth_mm", "torque": "rotation_deg"},
    )
    (case,) = stage.run()
    certainty = Assessment(study=study, measured=measured, meshes={"p1": SpotMesh(refinement=RATIO**0.5)})
    assessed = certainty.assess(case, *certainty.columns(case))
    box = assessed.end.problem.box
    truth = (row - box.lower) / (box.upper - box.lower)
    found = {"failed": [check.name for check in assessed.checks if check.is_failed]}
    for key, density in (("all", assessed.density), ("noise", assessed.noise_only.within())):
        low, high = density.interval(assessed.point)
        found[key] = np.append((low <= truth) & (truth <= high), density.holds(truth))
        found[f"{key} wide"] = np.append(high - low > WIDE, np.nan)
    if posterior:
        sampling = PosteriorSampling(study=study, design=stage.design, swept=())
        (drawn,) = sampling.run([case], [assessed]).posteriors
        low, high = np.quantile(drawn.values, [0.025, 0.975], axis=0)
        found["posterior"] = np.append((low <= row) & (row <= high), np.nan)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=200, help="experiments of each study")
    parser.add_argument("--studies", nargs="*", default=list(STUDIES), help="which studies")
    parser.add_argument("--errors", type=float, default=1.0, help="true errors over the budget's")
    parser.add_argument("--posterior", action="store_true", help="draw posteriors too, seconds each")
    chosen = parser.parse_args()
    with ProcessPoolExecutor() as pool:
        for name in chosen.studies:
            measure = functools.partial(measured_at, times=chosen.errors)
            of_name = functools.partial(experiment, name, posterior=chosen.posterior, measure=measure)
            found = list(pool.map(of_name, range(chosen.n), chunksize=5))
            names = [*(p.name for p in study_of(name, Layered()).space.parameters), "joint region"]
            failed = sum(bool(each["failed"]) for each in found)
            say(f"\n{name}: {chosen.n} experiments, {failed} called inadequate")
            heads = ["holds the truth", "is wide", "that of the noise alone", "that of the posterior"]
            kinds = ["all", "all wide", "noise", "posterior"][: 3 + chosen.posterior]
            say(f"| 95 % interval of | {' | '.join(heads[: len(kinds)])} |\n|{'---|' * (len(kinds) + 1)}")
            for i, key in enumerate(names):
                held = [f"{100.0 * np.mean([each[of][i] for each in found]):.1f} %" for of in kinds]
                if key == "joint region":  # has no width, and of posteriors there is none
                    held = [held[0], "", held[2], *("" for _ in held[3:])]
                say(f"| {key} | {' | '.join(held)} |")


def say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
