"""Coverage where errors are larger than the budget's, or of causes that no budget has: ``make coverage``.

Experiments of ``bench_coverage.py`` whose errors are ``--errors`` times as large as the budget has them, but
for the noise, whose size a fit estimates; or as the budget has them, and one cause more, unknown to the fit:

- ``relaxation``: each increment relaxes by 10 % with 1 s; press of 5 s, rest of 1 s, twist of 24 s. The truth
  is the instantaneous material. The rest is measured, as from a robot's log.
- ``skin``: a layer of 1.5 mm over 18 mm of tissue, three times as stiff at small strains.
- ``bone``: 3 mm farther from the skin than the 18 mm of the model, or nearer, by chance.
- ``shape``: the mesh's error is a wave along the curves, which no finer mesh shows.

With ``--presses 4`` each experiment has four spots, over 18, 22.5, 14.4 and 12 mm of tissue. Prints how many
intervals that are not wide hold the truth, and joint regions; how many experiments a check calls inadequate;
and in how many the joint region holds or that is said. Then, for each cause, how often each check fails, of
all studies together; ``held out`` is no check of the fit: a press, of one press alone a channel, that
does not belong to the others.

    python benchmarks/bench_wrong.py --n 100 --causes skin bone --presses 1
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
from bench_coverage import STUDIES, VOLUMES, Layered, experiment, measured_at, pressed, say
from study_relaxation import REST_S, measured, relaxed

from palpate import Job, Limb, Response, Simulation
from palpate.domain import Relaxation
from palpate.study.reading import Study
from palpate_materials.neo_hookean import NeoHookean

TISSUE_MM = {"p1": 18.0, "p2": 22.5, "p3": 14.4, "p4": 12.0}
"""Depth of the tissue at each spot of the model; that of the first is that of the strips."""
OFF_MM = 3.0
SKIN_MM, STIFFER, SKIN_NU = 1.5, 3.0, 0.45
PRESS_S, TWIST_S = 5.0, 24.0
FALL_SD = 0.001
"""Standard deviation of a fall in a rest, over the peak, as robot logs have it."""
HEADS = ("study", "errors", "holds the truth", "joint region", "called inadequate", "holds or says so")
CHECKS = ("discrepancy", "ranges", "spots", "relaxation")


class Places(Layered):
    """Strips at several spots: over deeper tissue strains are smaller, in a larger volume."""

    name, summary = "places", "strips of tissue over bones at different depths"
    off_mm = 0.0

    def _slope(self, job: Job, thetas: dict, depth: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        deeper = (TISSUE_MM[job.spot] + self.off_mm) / TISSUE_MM["p1"]
        # Force and torque of the strips, by the chain rule.
        return super()._slope(job, thetas, depth / deeper, rotation / deeper) * deeper


class Farther(Places):
    """With the bones farther from the skin than the model has them."""

    off_mm = OFF_MM


class Nearer(Places):
    """With the bones nearer to the skin."""

    off_mm = -OFF_MM


class Covered(Places):
    """With a skin in place of a part of the strips that are strained most."""

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        """Simulate one job."""
        theta = job.thetas["tissue"]
        more = (STIFFER - 1.0) * shear_modulus(job.materials["tissue"], theta)
        cover = np.array([2.0 * (1.0 + SKIN_NU) * more, SKIN_NU])
        return super().simulate(
            replace(
                job,
                materials={**job.materials, "cover": NeoHookean()},
                thetas={**job.thetas, "cover": cover},
            ),
            limb,
        )


# A layer of such a share of the depth takes that share of all strips; most of it is under the sphere.
VOLUMES["cover"] = pressed.VOLUMES_MM3 * SKIN_MM / TISSUE_MM["p1"]


def shear_modulus(material: object, theta: np.ndarray) -> float:
    """Initial shear modulus, by the energy of a small simple shear."""
    shear = 1e-3
    long = 0.5 * (shear + np.sqrt(shear**2 + 4.0))
    return float(2.0 * material.energy(np.array([[long, 1.0 / long, 1.0]]), theta)[0] / shear**2)


def relaxing(study: Study, row: np.ndarray, rng: np.random.Generator, **where: object) -> Response:
    """Curves of a tissue that relaxes, with its fall in a rest after the press."""
    motion = {"by_time": False, "press_s": PRESS_S, "twist_s": TWIST_S, "is_long_term": False}
    found = measured(study, row, rng, **motion, **where)
    force, law = found["force"], {"by_time": False}
    times = PRESS_S * force.abscissa / force.abscissa.max()
    elastic = force.ordinate * force.ordinate[-1] / relaxed(times, force.ordinate, **law)[-1]
    held_s = np.append(times, PRESS_S + REST_S)
    *_, start, end = relaxed(held_s, np.append(elastic, elastic[-1]), **law)
    sd = FALL_SD * force.ordinate.max()
    rest = Relaxation(
        channel="force",
        phase="dwell_1",
        duration_s=REST_S,
        start_value=start,
        fall=start - end + sd * rng.normal(),
        fall_std=sd,
    )
    return replace(found, relaxations=(rest,))


def with_bone(study: Study, row: np.ndarray, rng: np.random.Generator, **where: object) -> Response:
    """Curves of tissue that is deeper than the model's or not so deep, alike at all spots."""
    chance = where.get("shared", rng)
    return measured_at(study, row, rng, true=Farther if chance.random() < 0.5 else Nearer, **where)


CAUSES = {
    "relaxation": partial(relaxing, true=Places),
    "skin": partial(measured_at, true=Covered),
    "bone": with_bone,
    "shape": partial(measured_at, true=Places, has_shape=True),
}


def row_of(name: str, cause: str, found: list[dict], n_presses: int) -> str:
    """One line of the table of coverage."""
    *each, joint = np.array([one["all"] for one in found], dtype=float).T
    shares = [f"{100.0 * np.nanmean(held):.0f}" if np.isfinite(held).any() else "wide" for held in each]
    flagged = np.array([is_flagged(one, n_presses) for one in found])
    either = flagged | np.array([one["all"][-1] == 1.0 for one in found])
    cells = [
        name,
        cause,
        ", ".join(shares),
        *(f"{100.0 * x:.0f}" for x in (joint.mean(), flagged.mean(), either.mean())),
    ]
    return f"| {' | '.join(cells)} |"


def is_flagged(one: dict, n_presses: int) -> bool:
    """Whether a run says that something is wrong: it holds presses out by itself from three on."""
    return bool(one["failed"]) or (n_presses > 2 and one["apart"])


def power_of(cause: str, found: list[dict]) -> str:
    """One line of the table of the checks."""
    cells = []
    for check in CHECKS:
        made = [check in one["failed"] for one in found if check in one["checks"]]
        cells.append(f"{100.0 * np.mean(made):.0f}" if made else "–")
    cells.append(f"{100.0 * np.mean([one['apart'] for one in found]):.0f}")
    return f"| {cause} | {len(found)} | {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=100, help="experiments of each study and cause")
    parser.add_argument("--studies", nargs="*", default=list(STUDIES), help="which studies")
    parser.add_argument(
        "--errors", type=float, nargs="*", default=[0.5, 1.0, 2.0, 3.0], help="true errors over the budget's"
    )
    parser.add_argument("--causes", nargs="*", choices=CAUSES, default=list(CAUSES), help="which causes")
    parser.add_argument("--presses", type=int, default=1, help="spots of each experiment, up to 4")
    parser.add_argument("--workers", type=int, help="processes; default: all cores")
    chosen = parser.parse_args()
    spots = tuple(TISSUE_MM)[: chosen.presses]
    measures = {
        f"{times:g} x budget": partial(measured_at, true=Places, times=times) for times in chosen.errors
    }
    measures |= {cause: CAUSES[cause] for cause in chosen.causes}
    of_cause = {cause: [] for cause in measures}
    say(f"{chosen.n} experiments of each study and cause, {chosen.presses} presses each; all in %\n")
    say(f"| {' | '.join(HEADS)} |\n|{'---|' * len(HEADS)}")
    with ProcessPoolExecutor(chosen.workers) as pool:
        for name, cause in product(chosen.studies, measures):
            of = partial(experiment, name, measure=measures[cause], solver=Places, spots=spots)
            found = list(pool.map(of, range(chosen.n), chunksize=5))
            of_cause[cause] += found
            say(row_of(name, cause, found, chosen.presses))
    say(f"\n| cause | experiments | {' | '.join(CHECKS)} | held out |\n|{'---|' * (len(CHECKS) + 3)}")
    for cause, found in of_cause.items():
        say(power_of(cause, found))


if __name__ == "__main__":
    main()
