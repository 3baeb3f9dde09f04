"""What relaxation does to 95 % intervals that do not know of it, in closed form.

Experiments of ``bench_coverage.py`` with Yeoh's material, whose curves relax by 10 % with a time constant
of 1 s: pressed, rested for 1 s, twisted. Prints how often the intervals and the joint region hold the
parameters of a fast press (instantaneous) and those of a slow one (long-term, 0.9 times as large).
"""

import argparse
import sys
from dataclasses import replace
from functools import partial

import numpy as np
from bench_coverage import experiment, measured_at

from palpate.domain import FloatArray, Response
from palpate.study.reading import Study

SHARE, TAU_S, REST_S = 0.1, 1.0, 1.0
N_STEPS = 8000

CASES = {
    "all values fall with time; press 1 s, twist 3 s": (True, 1.0, 3.0),
    "each increment relaxes; press 1 s, twist 3 s": (False, 1.0, 3.0),
    "each increment relaxes; press 5 s, twist 24 s": (False, 5.0, 24.0),
    "each increment relaxes; press 20 s, twist 96 s": (False, 20.0, 96.0),
}
"""Whether relaxation starts at first contact for all, and durations of press and twist [s]."""


def relaxed(time_s: FloatArray, values: FloatArray, *, by_time: bool) -> FloatArray:
    """Values (n,) of a tissue that relaxes, of the elastic ones at increasing times (n,)."""
    if by_time:
        found: FloatArray = values * (1.0 - SHARE * (1.0 - np.exp(-time_s / TAU_S)))
        return found
    fine = np.linspace(time_s[0], time_s[-1], N_STEPS)
    elastic = np.interp(fine, time_s, values)
    step = float(np.exp(-(fine[1] - fine[0]) / TAU_S))
    left, young = 0.0, np.empty_like(elastic)
    for row, change in enumerate(np.diff(elastic, prepend=elastic[0])):
        left = young[row] = step * left + np.sqrt(step) * change
    return np.interp(time_s, fine, (1.0 - SHARE) * elastic + SHARE * young)


def measured(
    study: Study,
    row: FloatArray,
    rng: np.random.Generator,
    *,
    by_time: bool,
    press_s: float,
    twist_s: float,
    is_long_term: bool,
) -> Response:
    """Curves of a tissue that relaxes; ``is_long_term`` has it end at the parameters, else begin there."""
    elastic = measured_at(study, row, rng)
    force, torque = elastic["force"], elastic["torque"]
    turned = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(torque.abscissa)))])
    # Values that all fall with time do so during the motion alone.
    begun = press_s + (0.0 if by_time else REST_S)
    times = {
        "force": press_s * force.abscissa / force.abscissa.max(),
        "torque": begun + twist_s * turned / turned[-1],
    }
    scale = 1.0 / (1.0 - SHARE) if is_long_term else 1.0
    return Response(
        curves={
            name: replace(curve, ordinate=scale * relaxed(times[name], curve.ordinate, by_time=by_time))
            for name, curve in elastic.curves.items()
        }
    )


def main() -> None:
    """Print a row for each case and kind of parameters."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=40, help="experiments of each case")
    n = parser.parse_args().n
    for what, (by_time, press_s, twist_s) in CASES.items():
        for is_long_term in (False, True):
            motion = {"by_time": by_time, "press_s": press_s, "twist_s": twist_s}
            measure = partial(measured, **motion, is_long_term=is_long_term)
            found = [experiment("yeoh", seed, measure=measure) for seed in range(n)]
            *each, joint = 100.0 * np.mean([one["all"] for one in found], axis=0)
            failed = sum(bool(one["failed"]) for one in found)
            of = "long-term" if is_long_term else "instantaneous"
            held = ", ".join(f"{share:.0f}" for share in each)
            sys.stdout.write(f"{what}: {of} {held} %, joint {joint:.0f} %; {failed} of {n} inadequate\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
