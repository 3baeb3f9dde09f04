"""How often held-out presses raise an alarm: ``python benchmarks/bench_held_out.py --n 40``.

Four presses of strips of tissue in closed form, as in bench_coverage.py. Where they are sound, everything
that the budget has is wrong by as much as it states; where not, one press has another error that no budget
has. Prints how many held-out curves are inside their 90 % bands, and how many studies are said to
hold a press that does not belong to the others.
"""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import product

import numpy as np
import polars as pl
from bench_coverage import (
    MESH,
    MESHES,
    RATIO,
    Layered,
    LayeredSettings,
    measured_at,
    pressed,
    stage_of,
    study_of,
)

from palpate import Response
from palpate_certainty.assessment import Assessment
from palpate_certainty.held_out import held_out, is_apart

SPOTS = ("p1", "p2", "p3", "p4")


def _stiffer(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 1.25 * y


def _larger(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 1.1 * y


def _late(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.interp(x - 0.7, x, y)


def _relaxed(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return y * (1.0 - 0.1 * x / x.max())


FAULTS = {
    "sound": {},
    "tissue a quarter stiffer": {"force": _stiffer, "torque": _stiffer},
    "torque a tenth too large": {"torque": _larger},
    "onset off by 0.7 mm": {"force": _late},
    "a tenth of the force relaxed": {"force": _relaxed},
}
"""What is wrong at one press, by channel."""


def table_of(name: str, fault: str, seed: int) -> pl.DataFrame | None:
    """Held-out curves of one study; None where it is refused an interval."""
    rng = np.random.default_rng(seed)
    coarse = MESH * rng.normal()
    study = study_of(name, Layered(LayeredSettings(coarse=coarse, fine=coarse / RATIO)), spots=SPOTS)
    (row,) = pressed.truths(study, 1, seed)
    measured = {
        spot: measured_at(study, row, rng, shared=np.random.default_rng(1000 + seed)) for spot in SPOTS
    }
    spot = SPOTS[seed % len(SPOTS)]
    curves = dict(measured[spot].curves)
    for channel, change in FAULTS[fault].items():
        curve = curves[channel]
        curves[channel] = replace(curve, ordinate=change(curve.abscissa, curve.ordinate))
    measured[spot] = Response(curves=curves)
    stage = stage_of(study, measured)
    case = next(case for case in stage.run() if len(case.spots) > 1)
    assessment = Assessment(study=study, measured=measured, meshes=dict.fromkeys(SPOTS, MESHES))
    found = assessment.assessed([case], joint_only=True)
    return held_out(found[0]) if found else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=40, help="studies of each kind")
    parser.add_argument("--studies", nargs="*", default=["yeoh", "ogden"], help="which studies")
    parser.add_argument("--workers", type=int, help="processes; default: all cores")
    chosen = parser.parse_args()
    sys.stdout.write(
        f"| tissue | press | curves inside their bands | studies with an alarm | refused |\n|{'---|' * 5}\n"
    )
    with ProcessPoolExecutor(chosen.workers) as pool:
        for name, fault in product(chosen.studies, FAULTS):
            n = chosen.n if fault == "sound" else chosen.n // 2
            made = list(pool.map(table_of, [name] * n, [fault] * n, range(n)))
            found = [table for table in made if table is not None]
            inside = [is_inside for table in found for is_inside in table["inside"]]
            alarms = sum(map(is_apart, found))
            cells = [name, fault, f"{sum(inside)} of {len(inside)}", f"{alarms} of {n}", str(n - len(found))]
            sys.stdout.write(f"| {' | '.join(cells)} |\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
