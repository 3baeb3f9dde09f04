"""How often 95 % intervals hold the truth, where errors are as large as the budget's.

Simulated experiments on strips of tissue in closed form. Each has random parameters, measured curves
with noise, an onset, gains, friction and mesh error drawn from the budget, and a discrepancy along the
path that no parameter explains. The fit knows none of them. Prints how many intervals of each parameter,
and joint regions, hold the truth; how many intervals are wider than 0.8 of the
range, which hold any truth and are not counted; how many experiments are called inadequate, and in how many
the joint region holds or that is said. ``bench_wrong.py`` has larger errors, and causes that no budget has.

    python benchmarks/bench_coverage.py --n 200 --studies yeoh
    python benchmarks/bench_coverage.py --n 40 --posterior    # of emulated posteriors too
    python benchmarks/bench_coverage.py --scenarios --studies ogden yeoh    # what force and torque tell alone

With ``--scenarios`` the same data are fitted by I (both), II (torque) and III (force). Printed are how many
intervals by I are narrower than that by II and by III, or at most 2 % wider; that of standard deviations, by
which no curve tells less than none; and the median ratio of the volumes by II and III and by I, before and
after the densities are cut at the ranges. ``--friction`` is what is known of its coefficient of 0.7: all
(``known``), to a tenth (``measured``), to 0.3 of it (``default``), or the prior of a search, 0.7 ± 0.3
(``searched``).
"""

import argparse
import functools
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import polars as pl
from pydantic import Field

from palpate import Curve, Job, Limb, Response, Settings, Simulation, Solver, Status
from palpate.answer.words import Adequacy
from palpate.api.fit import path_of
from palpate.domain import Design, ParameterSpace, Refinement, RegionMaterial, Scenario
from palpate.fit.parametrisation import StandardParametrisation, StandardSettings
from palpate.fit.stage import FitStage
from palpate.plugins.provides import Provides
from palpate.plugins.registry import load_file
from palpate_certainty.assessment import Assessment
from palpate_certainty.assumptions import ASSUMED
from palpate_certainty.held_out import held_out, is_apart
from palpate_certainty.mesh_error import SpotMesh, scattered_parts
from palpate_certainty.posterior_sampling import PosteriorSampling
from palpate_materials.neo_hookean import NeoHookean
from palpate_materials.uncoupled import Ogden, Yeoh

pressed = load_file(Path(__file__).parents[1] / "tests" / "data" / "plugins" / "pressed_tissue.py")

NOISE, MESH, RATIO = 0.005, 0.03, 4.0
"""Noise over the largest ordinate; error of the coarse mesh; that over the error of the fine one."""
MESHES = SpotMesh(refinement=Refinement(ratio=RATIO**0.5, at_rim=True))
LEAST_FRICTION = 0.1
AROUND = 0.8
"""Stiffness of the tissue around a neo-Hookean strip, over its shear modulus."""
WIDE = 0.8
"""Width of an interval over the range beyond which it holds a truth of the range by construction."""
STUDIES = {
    "ogden": {"tissue": (Ogden(), ("c1", "m1", "kappa"))},
    "yeoh": {"tissue": (Yeoh(), ("c1", "c2", "c3"))},
    "neo-Hookean": {"tissue": (NeoHookean(), ("E", "nu"))},
    "two layers": {"skin": (Ogden(), ("c1",)), "tissue": (Ogden(), ("c1", "m1"))},
}
VOLUMES = {"skin": pressed.VOLUMES_MM3 * [0.0, 0.0, 0.5, 2.0], "tissue": pressed.VOLUMES_MM3}


def flowing_energy(material, depth, rotation, theta, volumes) -> np.ndarray:
    """W of strips whose tissue flows sideways, held back by the tissue around it, to the least energy.

    Strips that lose a given share of their volume have a force that goes with the bulk modulus, thus with
    1/(1 - 2ν). In a limb tissue flows sideways: a press's force rises by 10 % from ν = 0.40 to 0.49 at one
    Young's modulus, nearly evenly in ν, and its torque falls by 4 %.
    """
    young, poisson = theta
    mu, lame = young / (2.0 * (1.0 + poisson)), young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    axial = -pressed.COMPRESSED * depth.real[:, None]
    # Where the energy is least; shear leaves volume and breadth as they are.
    lateral = -0.5 * axial
    for _ in range(20):
        stress = mu * (np.expm1(2.0 * lateral) + AROUND * lateral) + lame * (axial + 2.0 * lateral)
        lateral = lateral - stress / (mu * (2.0 * np.exp(2.0 * lateral) + AROUND) + 2.0 * lame)
    held_back = mu * AROUND * (volumes * lateral**2).sum(axis=-1)
    return held_back + pressed.energy(material, depth, rotation, theta, volumes, np.exp(lateral))


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
        error = self.settings.fine if job.mesh else self.settings.coarse
        size = np.concatenate([depths / 10.0, np.abs(angles) / 0.4])
        return np.concatenate([force, torque]) * (1.0 + error * (1.0 + size))

    def _slope(self, job: Job, thetas: dict, depth: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        total = 0.0
        for region, theta in thetas.items():
            energy = flowing_energy if isinstance(job.materials[region], NeoHookean) else pressed.energy
            total = total + energy(job.materials[region], depth, rotation, theta, VOLUMES[region])
        return total.imag / pressed.STEP.imag


@dataclass
class Here(pressed.Here):
    """Simulates in this process, each job once, by its protocol too."""

    def of(self, jobs: list[Job]) -> list[Simulation]:
        found = []
        for job in jobs:
            thetas = tuple(theta.tobytes() for theta in job.thetas.values())
            key = (job.spot, thetas, job.protocol.path.tobytes(), job.protocol.friction, job.slopes, job.mesh)
            if key not in self.known:
                self.known[key] = self.solver.simulate(job, None)
            found.append(replace(self.known[key], job=job))
        return found


def study_of(name: str, solver: Solver, spots: tuple[str, ...] = ("p1",)):
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
    base = pressed.study_of(Ogden(), ("c1",), solver=solver, spots=spots)
    filters = (pressed.Rising(),) if name == "yeoh" else ()
    return replace(base, space=ParameterSpace(regions=tuple(regions)), filters=filters)


def measured_at(
    study,
    row: np.ndarray,
    rng: np.random.Generator,
    *,
    spot: str = "p1",
    shared: np.random.Generator | None = None,
    times: float = 1.0,
    has_shape: bool = False,
    true: "Callable[[LayeredSettings], Layered]" = Layered,
    friction_sd: float = ASSUMED.relative,
) -> Response:
    """What is measured of a material, with everything wrong that the budget has, or ``times`` as much.

    With a shape the mesh's error is a wave along each curve, as large as that which the budget has.
    ``shared`` draws what is alike at all spots: friction, fixed values, gains, half of a discrepancy and most
    of a mesh's error.
    ``true`` makes the solver of the curves.
    """
    of_all = shared or rng
    budget = study.budget
    onset = times * rng.normal() * ASSUMED.onset_mm
    path = study.protocol.path.copy()
    path[path[:, 0] > 0.0, 0] += onset
    friction = max(study.protocol.friction + times * friction_sd * of_all.normal(), LEAST_FRICTION)
    protocol = replace(study.protocol, path=path, friction=friction)
    regions = study.space.regions
    thetas = {
        region: theta
        * [
            1.0
            if p.name in {s.name for s in r.searched}
            else 1.0 + times * ASSUMED.relative * of_all.normal()
            for p in r.material.parameters
        ]
        for r, (region, theta) in zip(regions, study.space.thetas(row).items(), strict=True)
    }
    materials = {r.region: r.material for r in regions}
    job = Job(spot=spot, set_id=0, materials=materials, thetas=thetas, protocol=protocol)
    coarse, fine = study.solver.settings.coarse, study.solver.settings.fine
    response = true(LayeredSettings()).simulate(job, None).response
    extrapolated, curves = of_all.normal(), {}
    for name, x in (("force", pressed.DEPTHS), ("torque", pressed.ANGLES)):
        curve = response.curves[name]
        # Depths count from where contact is taken to begin.
        y = np.interp(x + onset, curve.abscissa, curve.ordinate) if name == "force" else curve.ordinate
        path = path_of(x)
        # A mesh without error, as both meshes show it, and what that may be wrong by.
        size = 1.0 + np.abs(x) / (10.0 if name == "force" else np.degrees(0.4))
        mesh = study.mesh_convergence(name)
        added = (1.0 + MESHES.refinement.left_over(mesh)) * (fine - coarse) * size * y
        y = (1.0 + coarse * size) * y + added
        rest, scatter = MESHES.of_extrapolation(mesh, added), mesh.scatter * np.maximum.accumulate(np.abs(y))
        if has_shape:
            error = np.hypot(rest, scatter)
            by_mesh = rng.normal() * error * np.sqrt(2.0) * np.sin(2.0 * np.pi * path + rng.uniform(0.0, 6.0))
        else:
            share = ASSUMED.mesh_shared
            by_mesh = extrapolated * rest + sum(
                (np.sqrt(share) * of_all.normal() + np.sqrt(1.0 - share) * rng.normal()) * part
                for part in scattered_parts(scatter, path / path[-1])
            )
        along = np.exp(-0.5 * ((path[:, None] - path) / 0.4) ** 2) + 1e-9 * np.eye(x.size)
        drawn = rng.normal(size=x.size)
        drawn = drawn if shared is None else np.sqrt(0.5) * (drawn + of_all.normal(size=x.size))
        shape = np.linalg.cholesky(along) @ drawn
        left = times * budget.discrepancy_of(name) * shape * np.maximum.accumulate(np.abs(y))
        noise = NOISE * np.abs(y).max() * rng.normal(size=x.size)
        y = y * (1.0 + times * budget.gain * of_all.normal()) + times * by_mesh + left + noise
        curves[name] = Curve(channel=name, abscissa=x, ordinate=y)
    return Response(curves=curves)


def stage_of(study, measured: dict[str, Response]) -> FitStage:
    """Fit of measured curves, without a sweep."""
    parameters = study.space.parameters
    return FitStage(
        study=study,
        design=Design(parameters=parameters, values=np.zeros((0, len(parameters))), seed=1, n_drawn=0),
        measured=measured,
        scores=pl.DataFrame(),
        simulations=Here(study.solver, {f"{spot}/fine": None for spot in measured}),
        abscissae={"force": "depth_mm", "torque": "rotation_deg", "force_over_time": "time_s"},
        refinement=dict.fromkeys(measured, MESHES.refinement),
    )


def experiment(
    name: str,
    seed: int,
    *,
    posterior: bool = False,
    measure: Callable[..., Response] = measured_at,
    solver: type[Layered] = Layered,
    spots: tuple[str, ...] = ("p1",),
    also: Mapping[str, float] = MappingProxyType({}),
    predicts: bool = True,
    **changes: object,
) -> dict:
    """One experiment: which intervals hold the truth, which checks have failed, and all that were made.

    ``changes`` are of the study, ``also`` true values of what it then searches besides the materials. Each
    press is held out only where the experiment ``predicts``.
    """
    rng = np.random.default_rng(seed)
    coarse = MESH * rng.normal()
    study = study_of(name, solver(LayeredSettings(coarse=coarse, fine=coarse / RATIO)), spots)
    study = replace(study, **changes)
    (row,) = pressed.truths(study, 1, seed)
    if len(spots) == 1:
        measured = {spots[0]: measure(study, row, rng)}
    else:
        measured = {
            spot: measure(study, row, rng, spot=spot, shared=np.random.default_rng(1000 + seed))
            for spot in spots
        }
    stage = stage_of(study, measured)
    case, *others = stage.run()
    meshes = dict.fromkeys(spots, MESHES)
    certainty = Assessment(study=study, measured=measured, meshes=meshes)
    assessed = certainty.assess(case, *certainty.columns(case), cases=others)
    box = assessed.end.problem.box
    truth = (np.append(row, list(also.values())) - box.lower) / (box.upper - box.lower)
    found = {"failed": [check.name for check in assessed.checks if check.verdict is not Adequacy.DESCRIBES]}
    found["apart"] = predicts and is_apart(held_out(assessed))
    found["checks"] = {check.name for check in assessed.checks}
    wide = np.append(np.subtract(*reversed(assessed.density.interval(assessed.point))) > WIDE, False)
    low, high = assessed.density.interval(assessed.point)
    holds = np.append((low <= truth) & (truth <= high), assessed.density.holds(truth))
    found["all"] = np.where(wide, np.nan, holds)
    found["all wide"] = wide
    if posterior:
        sampling = PosteriorSampling(study=study, design=stage.design, swept=())
        (drawn,) = sampling.run([case], [assessed]).posteriors
        low, high = np.quantile(drawn.values, [0.025, 0.975], axis=0)
        found["posterior"] = np.append((low <= row) & (row <= high), np.nan)
    return found


ALONE = {"I": {"force": 1.0, "torque": 1.0}, "II": {"torque": 1.0}, "III": {"force": 1.0}}
"""Weights of the channels by scenario."""
FRICTION = 0.7
FRICTIONS = {"known": 0.0, "measured": 0.1 * FRICTION, "default": 0.3 * FRICTION, "searched": 0.3}
"""Coefficient of the scenarios' worlds, and its standard deviation by what is known of it."""
SEARCHED = StandardSettings.model_validate(
    {
        "friction": {
            "lower": LEAST_FRICTION,
            "upper": 1.5,
            "prior": {"value": FRICTION, "sd": FRICTIONS["searched"]},
        }
    }
)
"""As ``palpate init --measured`` has it."""


def of_scenarios(
    name: str, friction: str, seed: int, solver: Layered | None = None, row: np.ndarray | None = None
) -> dict[str, dict[str, np.ndarray]]:
    """Standard deviations, widths of intervals and volumes of the materials' parameters, by scenario.

    One experiment: on a closed-form world, or on that of ``solver``, with the true values ``row``.
    """
    rng = np.random.default_rng(seed)
    coarse = MESH * rng.normal()
    scenarios = tuple(Scenario(name=each, weights=weights) for each, weights in ALONE.items())
    study = study_of(name, solver or Layered(LayeredSettings(coarse=coarse, fine=coarse / RATIO)))
    sd = FRICTIONS[friction]
    study = replace(
        study,
        scenarios=scenarios,
        budget=study.budget.model_copy(update={"friction": sd}),
        protocol=replace(study.protocol, friction=FRICTION),
        parametrisation=StandardParametrisation(SEARCHED if friction == "searched" else StandardSettings()),
    )
    if row is None:
        (row,) = pressed.truths(study, 1, seed)
    true = Layered if solver is None else lambda _: solver
    measured = {"p1": measured_at(study, row, rng, true=true, friction_sd=sd)}
    meshes = {"p1": MESHES}
    cases = stage_of(study, measured).run()
    found = {}
    for each in Assessment(study=study, measured=measured, meshes=meshes).assessed(cases):
        # Volumes and regions are of the material, whatever the friction is.
        material = each.density.of(range(row.size))
        covariance = each.laplace.covariance[: row.size, : row.size]
        box = each.end.problem.box
        truth = ((np.resize(row, box.lower.size) - box.lower) / (box.upper - box.lower))[: row.size]
        cut = np.cov(material.draws(1000), rowvar=False)
        found[each.case.scenario.name] = {
            "sd": np.sqrt(np.diag(covariance)),
            "interval": np.subtract(*reversed(material.interval(each.point[: row.size]))),
            "volumes": np.sqrt([np.linalg.det(covariance), np.linalg.det(cut)]),
            "holds": material.holds(truth),
        }
    return found


def table_of_scenarios(name: str, by_friction: Mapping[str, Sequence[dict]]) -> None:
    """Print what the scenarios tell of the same data, by what is known of the friction."""
    known = next(iter(by_friction.values()))
    for friction, found in by_friction.items():
        whole = [each for each in found if each.keys() == ALONE.keys()]
        say(f"\n{name}, friction {friction}: {len(found)} experiments, {len(whole)} with all scenarios")
        for key in ("sd", "interval"):
            for other in ("II", "III"):
                ratios = np.concatenate([each["I"][key] / each[other][key] for each in whole])
                narrow = f"at most 1.02 in {100.0 * np.mean(ratios <= 1.02):.1f} % of {ratios.size}"
                spread = f"median {np.median(ratios):.2f}, largest {ratios.max():.2f}"
                say(f"{key} by I over that by {other}: {narrow}, {spread}")
        for other in ("II", "III"):
            volumes = np.array([each[other]["volumes"] / each["I"]["volumes"] for each in whole])
            middle = np.median(volumes, axis=0)
            low, high = np.quantile(volumes[:, 0], [0.1, 0.9])
            say(
                f"volume by {other} over that by I: {middle[0]:.2g} ({low:.2g} to {high:.2g} in 80 %), "
                f"cut at the ranges {middle[1]:.2g}"
            )
        for each in ALONE:
            held = 100.0 * np.mean([one[each]["holds"] for one in whole])
            both = [(a[each], b[each]) for a, b in zip(found, known, strict=True) if each in a and each in b]
            wider = np.median([a["volumes"][0] / b["volumes"][0] for a, b in both])
            say(f"{each}: joint region holds in {held:.0f} %, volume over that of the first row {wider:.2g}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=200, help="experiments of each study")
    parser.add_argument("--studies", nargs="*", default=list(STUDIES), help="which studies")
    parser.add_argument("--posterior", action="store_true", help="draw posteriors too, seconds each")
    parser.add_argument("--scenarios", action="store_true", help="force and torque alone, instead")
    parser.add_argument(
        "--friction", nargs="*", choices=FRICTIONS, default=["measured"], help="what is known, by --scenarios"
    )
    parser.add_argument("--workers", type=int, help="processes; default: all cores")
    chosen = parser.parse_args()
    with ProcessPoolExecutor(chosen.workers) as pool:
        for name in chosen.studies if chosen.scenarios else ():
            of_name = [functools.partial(of_scenarios, name, friction) for friction in chosen.friction]
            found = [list(pool.map(each, range(chosen.n), chunksize=5)) for each in of_name]
            table_of_scenarios(name, dict(zip(chosen.friction, found, strict=True)))
        for name in () if chosen.scenarios else chosen.studies:
            of_name = functools.partial(experiment, name, posterior=chosen.posterior)
            table(name, list(pool.map(of_name, range(chosen.n), chunksize=5)))


def table(name: str, found: list[dict]) -> None:
    """Print how many hold the truth, of those that are not wide."""
    failed = np.array([bool(each["failed"]) for each in found])
    either = failed | np.array([each["all"][-1] == 1.0 for each in found])
    say(
        f"\n{name}: {len(found)} experiments, {failed.sum()} called inadequate; the joint region holds, or "
        f"that is said, in {100.0 * either.mean():.1f} %"
    )
    heads = {"all": "holds the truth", "all wide": "is wide"}
    if "posterior" in found[0]:
        heads["posterior"] = "that of the posterior"
    say(f"| 95 % interval of | {' | '.join(heads.values())} |\n|{'---|' * (len(heads) + 1)}")
    names = [*(p.name for p in study_of(name, Layered()).space.parameters), "joint region"]
    for i, key in enumerate(names):
        values = [np.array([each[of][i] for each in found], dtype=float) for of in heads]
        held = [f"{100.0 * np.nanmean(v):.1f} %" if np.isfinite(v).any() else "" for v in values]
        say(f"| {key} | {' | '.join(held)} |")


def say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
