"""Coverage where spots differ, and where the law is another one than the tissue's.

``--spots``: worlds of Ogden's law at five spots, over tissue of four depths, whose searched values differ by
10 % (standard deviation) between the spots. Counted is how often the interval of the mean holds the value
that the spots are drawn around.

``--laws``: worlds of one law, fitted with another by two presses over tissue of other depths. Counted are
the verdicts, and how often each press's curves are inside of the bands that the other press predicts.

All by the closed form and the errors of ``bench_coverage.py``. With ``--tuned`` only even seeds count, which
choices may be made on; else the odd ones.

    python benchmarks/bench_laws.py --spots 200 --laws 20
"""

import argparse
from collections import Counter
from dataclasses import replace
from itertools import permutations

import numpy as np
from bench_coverage import (
    MESH,
    MESHES,
    RATIO,
    LayeredSettings,
    experiment,
    measured_at,
    pressed,
    say,
    stage_of,
    study_of,
)
from bench_wrong import TISSUE_MM, Places

from palpate_certainty.assessment import Assessment
from palpate_certainty.held_out import held_out

BETWEEN = 0.1
"""Standard deviation between spots, over the value."""
SPOTS = ("p1", "p2", "p3", "p4", "p5")
LAWS = ("ogden", "yeoh", "neo-Hookean")


class Spots(Places):
    """A fifth spot is as deep as the first."""

    name = "spots"

    def _slope(self, job, thetas, depth, rotation):
        named = job if job.spot in TISSUE_MM else replace(job, spot="p1")
        return super()._slope(named, thetas, depth, rotation)


def differing(study, row, rng, *, spot, shared):
    """Curves of a spot with values of its own."""
    own = row * (1.0 + BETWEEN * rng.normal(size=row.size))
    box = np.array([(p.physical_lower, p.physical_upper) for p in study.space.parameters])
    return measured_at(study, np.clip(own, *box.T), rng, spot=spot, shared=shared, true=Spots)


def of_spots(seeds) -> None:
    names = [p.name for p in study_of("ogden", Spots(LayeredSettings())).space.parameters]
    held = [
        experiment("ogden", seed, measure=differing, solver=Spots, spots=SPOTS)["all"][:-1] for seed in seeds
    ]
    shares = 100.0 * np.nanmean(held, axis=0)
    counted = np.isfinite(held).sum(axis=0)
    each = zip(names, shares, counted, strict=True)
    say("mean of five spots: " + ", ".join(f"{name} {share:.0f} % of {n}" for name, share, n in each))
    say(f"together: {100.0 * np.nanmean(held):.1f} % of {counted.sum()}")


def another_law(true: str, fitted: str, seed: int) -> tuple[str, list[bool]]:
    """Verdict on the fitted law, and whether the curves of each press are inside of their bands."""
    rng, spots = np.random.default_rng(seed), SPOTS[:2]
    coarse = MESH * rng.normal()
    solver = Spots(LayeredSettings(coarse=coarse, fine=coarse / RATIO))
    tissue, study = study_of(true, solver, spots), study_of(fitted, solver, spots)
    (row,) = pressed.truths(tissue, 1, seed)
    measured = {
        spot: measured_at(tissue, row, rng, spot=spot, shared=np.random.default_rng(1000 + seed), true=Spots)
        for spot in spots
    }
    case = stage_of(study, measured).run()[0]
    certainty = Assessment(study=study, measured=measured, meshes=dict.fromkeys(spots, MESHES))
    assessed = certainty.assess(case, *certainty.columns(case))
    table = held_out(assessed)
    return str(assessed.verdict), [bool(table.filter(spot=spot)["inside"].all()) for spot in spots]


def of_laws(seeds) -> None:
    pairs = list(permutations(LAWS, 2))
    worlds = zip(pairs * len(seeds), seeds, strict=False)
    found = [(pair, *another_law(*pair, seed)) for pair, seed in worlds]
    say(f"verdicts: {dict(Counter(verdict for _, verdict, _ in found))}")
    say(f"second press inside of its bands: {sum(inside[1] for *_, inside in found)} of {len(found)}")
    say(f"either press: {sum(sum(inside) for *_, inside in found)} of {2 * len(found)}")
    for pair in pairs:
        say(f"{' by '.join(pair)}: {[(verdict, inside) for of, verdict, inside in found if of == pair]}")


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--spots", type=int, default=0)
    arguments.add_argument("--laws", type=int, default=0)
    arguments.add_argument("--tuned", action="store_true")
    given = arguments.parse_args()
    first = 0 if given.tuned else 1
    if given.spots:
        of_spots(range(first, 2 * given.spots, 2))
    if given.laws:
        of_laws(range(first, 2 * given.laws, 2))


if __name__ == "__main__":
    main()
