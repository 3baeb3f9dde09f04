"""Coverage and adequacy by finite elements: ``make coverage-fe``.

Experiments on the demo's limbs, each with everything wrong that its budget has: noise, onset, tilt, friction,
gains, drift, a fixed modulus, and the mesh. The data are simulated on other, finer meshes. Sound ones have a
random Yeoh material that the study's ranges hold: counted are the 95 % intervals that hold it, next to
those of the noise alone. The others have what the study does not know of: an Ogden material, a skin, a spot
3 mm off, and little friction. Of all of them printed is what the checks say of the model.

    python benchmarks/bench_inadequate.py --sound 10 --into FOLDER    # keeps what it has simulated
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import polars as pl
from independent_meshes import true_limb

from palpate import Curve, Job, Limb, Material, Response
from palpate.answer.words import Adequacy
from palpate.domain import Design, Indentation
from palpate.executors import InProcess
from palpate.fit.stage import FitStage
from palpate.limb.loading import load_limbs
from palpate.mesh.spot_frame import in_spot_frame
from palpate.plugins.catalogue import Plugins
from palpate.sampling.drawing import accepted_by_all
from palpate.simulation.sweep import Simulations
from palpate.study.model import BudgetTable
from palpate.study.reading import Study, read_study
from palpate_certainty.assessment import Assessment
from palpate_certainty.mesh_error import SpotMesh
from palpate_certainty.tables import Assessed
from palpate_materials.neo_hookean import NeoHookean
from palpate_materials.uncoupled import Ogden

NOISE = 0.005
"""Noise over the largest ordinate."""
BUDGET = BudgetTable.model_validate(
    {"onset": "0.05 mm", "tilt": "1 deg", "zero": 0.003, "mesh": 0.03, "friction": 0.1}
)
"""The mesh's error as far as force goes: that of the torque is 5 to 10 % on these meshes. The rest as palpate
assumes."""
REGION, SOLVER = "soft_tissue", {"depth_steps": 8, "rotation_step_deg": 7.5}
POINTS = 4
"""Measured points for each simulated one."""
OFF_MM = 3.0


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What is measured: at each spot of the study a limb, and what its regions are made of."""

    title: str
    limbs: Mapping[str, str]
    materials: Mapping[str, Material]
    thetas: Mapping[str, np.ndarray]
    friction: float = 1.0
    row: np.ndarray | None = None


def say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def ready(name: str, plugins: Plugins) -> Study:
    """A ready study by the scenario that generalises alone, without its sweep and finer meshes."""
    study = read_study(Path(plugins.studies[name].directory) / "study.toml", plugins)
    main = tuple(s for s in study.scenarios if s.name == study.generalise_by)
    spots = tuple(replace(spot, fine_edge_mm=0.0) for spot in study.spots)
    solver = type(study.solver)(study.solver.settings.model_copy(update=SOLVER))
    return replace(
        study, n_sets=0, scenarios=main, spots=spots, solver=solver, executor=InProcess(), budget=BUDGET
    )


def moved(limb: Limb, by_mm: tuple[float, float]) -> Limb:
    """The limb with its spot elsewhere on the skin, and the normal there."""
    points = in_spot_frame(limb).points_mm[limb.mesh.node_sets["contact"]]
    x, y, z = points[np.linalg.norm(points - np.append(by_mm, 0.0), axis=1) < 8.0].T
    columns = [np.ones(x.size), x, y, x**2, x * y, y**2]
    c = np.linalg.lstsq(np.stack(columns, axis=1), z, rcond=None)[0]
    a, b = by_mm
    height = c @ [1.0, a, b, a**2, a * b, b**2]
    slope = np.array([c[1] + 2 * c[3] * a + c[4] * b, c[2] + c[4] * a + 2 * c[5] * b])
    spot = replace(limb.spot, position_mm=np.array([a, b, height]), normal=np.append(-slope, 1.0))
    return replace(limb, spot=spot)


def all_limbs(plugins: Plugins) -> dict[str, Limb]:
    """The demo's by their spots' names; those that make the data by other names."""
    limbs = load_limbs(ready("forearm-demo", plugins))
    limbs |= {f"{spot} true": true_limb(spot) for spot in limbs}
    limbs["p2 off"] = moved(limbs["p2 true"], (0.0, OFF_MM))
    limbs["p2 layered"] = load_limbs(ready("forearm-layered", plugins))["p2"]
    return limbs


# ------------------------------------------------------------------------ experiments


def sound(study: Study, seed: int) -> tuple[Study, Truth]:
    """One spot of the limb, and a material that the ranges and the filters accept."""
    spot = study.spots[seed % len(study.spots)]
    rng = np.random.default_rng(seed)
    low, high = (np.array([getattr(p, end) for p in study.space.parameters]) for end in ("lower", "upper"))
    row = low + (high - low) * rng.uniform(0.1, 0.9, low.size)
    while not accepted_by_all(study.filters, study.space, row[None])[0]:
        row = low + (high - low) * rng.uniform(0.1, 0.9, low.size)
    name = spot.spot.name
    return replace(study, spots=(spot,)), Truth(
        title=f"sound, {name}",
        limbs={name: f"{name} true"},
        materials={REGION: study.space.regions[0].material},
        thetas=study.space.thetas(row),
        row=row,
    )


def unsound(study: Study) -> Iterator[tuple[Study, Truth]]:
    """What the study does not know of."""
    spots = {spot.spot.name: spot for spot in study.spots}
    yeoh = study.space.regions[0].material
    row = np.array([study.truth[name] for name in study.space.names])
    usual = {"materials": {REGION: yeoh}, "thetas": study.space.thetas(row)}
    one = replace(study, spots=(spots["p1"],))
    for exponent in (8.0, 4.0):
        ogden = {REGION: np.array([0.056, exponent, 0.8])}
        yield (
            one,
            Truth(
                title=f"Ogden, m1 = {exponent:g}",
                limbs={"p1": "p1 true"},
                materials={REGION: Ogden()},
                thetas=ogden,
            ),
        )
    layered = {"skin": np.array([0.15, 0.45]), REGION: study.space.thetas(0.65 * row)[REGION]}
    yield (
        replace(study, spots=(spots["p2"],)),
        Truth(
            title="2.5 mm of skin",
            limbs={"p2": "p2 layered"},
            materials={"skin": NeoHookean(), REGION: yeoh},
            thetas=layered,
        ),
    )
    yield one, Truth(title="friction 0.3", limbs={"p1": "p1 true"}, friction=0.3, **usual)
    yield (
        replace(study, spots=(spots["p1"], spots["p2"])),
        Truth(title=f"p2 {OFF_MM:g} mm off", limbs={"p1": "p1 true", "p2": "p2 off"}, **usual),
    )


def measured_of(
    study: Study, truth: Truth, simulations: Simulations, seed: int, times: float = 1.0
) -> dict[str, Response]:
    """What is measured, with everything wrong that the budget has, ``times`` as much but for the noise."""
    rng, budget = np.random.default_rng([seed, 1]), study.budget
    gains = {channel: 1.0 + times * budget.gain * rng.normal() for channel in ("force", "torque")}
    friction = truth.friction * (1.0 + times * budget.friction * rng.normal())
    bulk = 1.0 + times * 0.1 * rng.normal()
    thetas = {r: np.append(t[:-1], t[-1] * bulk) if r == REGION else t for r, t in truth.thetas.items()}
    found = {}
    for spot, limb in truth.limbs.items():
        onset, tilt_deg = times * budget.onset * rng.normal(), tuple(times * budget.tilt * rng.normal(size=2))
        protocol = study.protocol_at(spot)
        assert isinstance(protocol, Indentation)
        path = protocol.path.copy()
        path[path[:, 0] > 0.0, 0] += onset
        protocol = replace(protocol, path=path, friction=friction, tilt_deg=tilt_deg)
        job = Job(spot=limb, set_id=-1, materials=truth.materials, thetas=thetas, protocol=protocol)
        (simulation,) = simulations.of([job])
        if simulation.response is None or simulation.message:
            raise SystemExit(f"{truth.title}: {simulation.message}")
        curves = {}
        for channel, curve in simulation.response.curves.items():
            x, y = dense(curve.abscissa), dense(curve.ordinate)
            along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(x)))])
            peak = np.abs(y).max()
            y = gains[channel] * y + times * budget.zero * rng.normal() * peak * along / along[-1]
            y = y + NOISE * peak * rng.normal(size=x.size)
            x = x - onset if channel == "force" else x
            curves[channel] = Curve(channel=channel, abscissa=x, ordinate=y).cut(slice(1, None))
        found[spot] = Response(curves=curves)
    return found


def dense(values: np.ndarray) -> np.ndarray:
    """Points between the simulated ones, on straight lines as palpate reads them."""
    at = np.linspace(0.0, values.size - 1.0, POINTS * (values.size - 1) + 1)
    return np.interp(at, np.arange(values.size), values)


def assessed(
    study: Study,
    truth: Truth,
    simulations: Simulations,
    seed: int,
    *,
    times: float = 1.0,
    meshes: Mapping[str, SpotMesh] = MappingProxyType({}),
) -> Assessed:
    """Measure, with errors ``times`` as large as the budget's, fit, and assess the joint fit."""
    return fitted(study, measured_of(study, truth, simulations, seed, times), simulations, meshes)


def fitted(
    study: Study,
    measured: Mapping[str, Response],
    simulations: Simulations,
    meshes: Mapping[str, SpotMesh],
    start: Mapping[str, float] = MappingProxyType({}),
) -> Assessed:
    """Fit, and assess the joint fit."""
    none = np.zeros((0, len(study.space.parameters)))
    stage = FitStage(
        study=study,
        design=Design(parameters=study.space.parameters, values=none, seed=1, n_drawn=0),
        measured=measured,
        scores=pl.DataFrame(),
        simulations=simulations,
        abscissae={"force": "depth_mm", "torque": "rotation_deg"},
        refinement={spot: mesh.refinement for spot, mesh in meshes.items()},
        first_start=start,
    )
    case, *others = stage.run()
    certainty = Assessment(study=study, measured=measured, meshes=meshes)
    return certainty.assess(case, *certainty.columns(case), cases=others)


# ------------------------------------------------------------------------------ table


def row_of(truth: Truth, found: Assessed) -> str:
    """One line of the table."""
    sizes = [f"{100.0 * m.share:.1f}, {100.0 * m.unexplained:.1f}" for m in found.misfits.values()]
    by_name = {check.name: check.probability for check in found.checks if check.channel < 0}
    failed = dict.fromkeys(check.name for check in found.checks if check.verdict is not Adequacy.DESCRIBES)
    others = [f"{name} {p:.1g}" for name, p in by_name.items()]
    cells = [truth.title, *sizes, ", ".join(others), ", ".join(failed) or "–"]
    if truth.row is not None:
        box = found.end.problem.box
        low, high = found.density.interval(found.point)
        at = (truth.row - box.lower) / (box.upper - box.lower)
        errors = (found.point - at) / found.laplace.sd
        cells.append(", ".join(f"{e:+.1f}" for e in errors))
        cells.append(f"{int(((low <= at) & (at <= high)).sum())} of {at.size}")
    return f"| {' | '.join(cells)} |"


def held(row: np.ndarray, found: Assessed) -> np.ndarray:
    """Which intervals, and the joint region, hold the truth."""
    box = found.end.problem.box
    at = (row - box.lower) / (box.upper - box.lower)
    low, high = found.density.interval(found.point)
    return np.append((low <= at) & (at <= high), found.density.holds(at))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sound", type=int, default=10, help="sound experiments")
    parser.add_argument("--first", type=int, default=0, help="number of the first of them")
    parser.add_argument("--no-unsound", action="store_true", help="sound ones alone")
    parser.add_argument("--into", type=Path, help="folder that keeps the simulations")
    chosen = parser.parse_args()
    plugins = Plugins.load()
    study = ready("forearm-demo", plugins)
    with (
        tempfile.TemporaryDirectory() as folder,
        Simulations(study, chosen.into or Path(folder), all_limbs(plugins)) as simulations,
    ):
        say("| experiment | force %, unexplained | torque %, unexplained | p | failed | errors [sd] | held |")
        say(f"|{'---|' * 7}")
        for seed, (of, truth) in enumerate([] if chosen.no_unsound else list(unsound(study)), start=1000):
            say(row_of(truth, assessed(of, truth, simulations, seed)))
        counts = []
        for seed in range(chosen.first, chosen.first + chosen.sound):
            of, truth = sound(study, seed)
            found = assessed(of, truth, simulations, seed)
            say(row_of(truth, found))
            counts.append(held(truth.row, found))
    if counts:
        total = np.sum(counts, axis=0)
        say(f"\n| 95 % interval of | holds the truth, of {len(counts)} |\n|---|---|")
        for name, of_all in zip([*study.space.names, "joint region"], total.tolist(), strict=True):
            say(f"| {name} | {of_all} |")


if __name__ == "__main__":
    main()
