"""What force and torque tell together and alone, by what is known of friction: by finite elements.

Random materials of three laws on the demo's limbs, each at one of its four spots, with a friction coefficient
of 0.7. Finite elements give the curves of each with slopes; a world is linear in the parameters, the friction
and the depth from there on. So it has the true slopes, and intervals are exact but for the ranges. Errors and
their budget are those of ``bench_coverage.py --scenarios``, the mesh's being the least that finer meshes
leave, and what is printed is the same.

    python benchmarks/study_torque.py --n 20
"""

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from bench_coverage import (
    FRICTION,
    FRICTIONS,
    Layered,
    LayeredSettings,
    of_scenarios,
    pressed,
    say,
    study_of,
    table_of_scenarios,
)
from scipy.interpolate import CubicSpline

from palpate import Job, Limb, Plugins, Response, Solver, Status
from palpate.domain import Indentation
from palpate.limb.loading import load_limbs
from palpate.study.reading import Study, read_study

REGION, DEEPER_MM = "soft_tissue", 0.1
TURN = 10
"""Point of the twist at its first turn."""


class Linear(Layered):
    """Curves that are linear around those of one material, by finite elements."""

    name, summary = "linear", "curves linear in the parameters, the friction and the depth"

    def at(self, curves: Response, deeper: Response, names: Sequence[str], theta: np.ndarray) -> "Linear":
        """This solver, around the curves of ``theta``; those of a greater depth have no slopes."""
        self.theta = theta
        force, torque = curves["force"], curves["torque"]
        keys = [*names, "friction"]
        depths, once = np.unique(force.abscissa, return_index=True)
        values = np.stack([force.ordinate, *(force.slopes[key] for key in keys)])
        self.force = CubicSpline(depths, values[:, once], axis=1)
        self.depth = depths[-1]
        more = along(torque.abscissa, deeper["torque"].abscissa, deeper["torque"].ordinate)
        values = [
            torque.ordinate,
            *(torque.slopes[key] for key in keys),
            (more - torque.ordinate) / DEEPER_MM,
        ]
        self.torque = np.stack([along(pressed.ANGLES, torque.abscissa, each) for each in values])
        return self

    def _curves(self, job: Job, thetas: dict, depths: np.ndarray, friction: float) -> np.ndarray:
        (theta,) = thetas.values()
        changes = np.array([1.0, *(theta - self.theta), friction - FRICTION])
        deeper = depths[-1] - self.depth
        return np.concatenate([changes @ self.force(depths), np.append(changes, deeper) @ self.torque])


def along(angles: np.ndarray, given: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values at the angles of a path, from those at its points by length."""
    at, points = (np.concatenate([[0.0], np.cumsum(np.abs(np.diff(each)))]) for each in (angles, given))
    return np.interp(at, points, values)


def simulated(
    solver: Solver, study: Study, limb: Limb, row: np.ndarray, protocol: Indentation
) -> Linear | None:
    """The solver of a linear world around a material; None where finite elements do not finish."""
    (region,) = study.space.regions
    (theta,) = study.space.thetas(row).values()
    found = []
    for by_mm in (0.0, DEEPER_MM):
        path = protocol.path.copy()
        path[path[:, 0] > 0.0, 0] += by_mm
        job = Job(
            spot=limb.spot.name,
            set_id=-1,
            materials={REGION: region.material},
            thetas={REGION: theta},
            protocol=replace(protocol, path=path, friction=FRICTION),
            slopes=not by_mm,
        )
        found.append(solver.simulate(job, limb))
    if any(each.status is not Status.OK or each.response is None for each in found):
        return None
    curves, deeper = (each.response for each in found)
    if not curves["force"].slopes:
        return None
    names = [f"{REGION}.{parameter.name}" for parameter in region.material.parameters]
    return Linear(LayeredSettings()).at(curves, deeper, names, theta)


def worlds(
    name: str, n: int, solver: Solver, limbs: Mapping[str, Limb], protocol: Indentation
) -> list[tuple]:
    """Numbers, solvers and materials of the worlds whose finite elements finish."""
    study, found = study_of(name, Layered()), []
    started_s = time.monotonic()
    for seed in range(n):
        (row,) = pressed.truths(study, 1, seed)
        limb = limbs[sorted(limbs)[seed % len(limbs)]]
        if (linear := simulated(solver, study, limb, row, protocol)) is not None:
            found.append((seed, linear, row))
    say(f"\n{name}: {len(found)} of {n} simulated in {time.monotonic() - started_s:.0f} s")
    force = 100.0 * np.median([of_friction(each.force(each.depth)[[0, -1]]) for _, each, _ in found])
    torque = 100.0 * np.median([of_friction(each.torque[[0, -2], TURN]) for _, each, _ in found])
    say(f"friction + 10 %: {force:.1f} % of the force at its end, {torque:.1f} % of the torque at its turn")
    return found


def of_friction(ends: np.ndarray) -> float:
    """Relative change of an ordinate by a tenth of the friction, from it and its slope."""
    value, slope = ends
    return float(0.1 * FRICTION * slope / value)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=20, help="materials of each law")
    parser.add_argument("--studies", nargs="*", default=["ogden", "yeoh", "neo-Hookean"], help="which laws")
    parser.add_argument("--friction", nargs="*", choices=FRICTIONS, default=list(FRICTIONS))
    chosen = parser.parse_args()
    plugins = Plugins.load()
    demo = read_study(Path(plugins.studies["forearm-demo"].directory) / "study.toml", plugins)
    limbs = {name: limb for name, limb in load_limbs(demo).items() if name in demo.spot_names}
    for name in chosen.studies:
        found = worlds(name, chosen.n, demo.solver, limbs, demo.protocol)
        by_friction = {
            friction: [of_scenarios(name, friction, seed, linear, row) for seed, linear, row in found]
            for friction in chosen.friction
        }
        table_of_scenarios(name, by_friction)


if __name__ == "__main__":
    main()
