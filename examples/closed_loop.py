"""A simulated robot that measures, fits, asks for the next press and measures it, until it is sure enough.

    python examples/closed_loop.py STUDY --until 0.2 --presses 4

STUDY has simulated data with a [truth], a protocol and a loader that writes curves, such as csv; its
measured curves exist (`palpate synthesise` makes them). The robot presses the truth by the study's own
solver, on the finer mesh where a spot has one, and adds noise. Each press makes a study next to STUDY and
a run in FOLDER. With a real robot, `press_of` sends next.json and waits for the curves.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import polars as pl

from palpate.api import Curve, Job, PalpateError, Protocol, Response, Status
from palpate.api.fit import ALL_SPOTS
from palpate.api.runs import Plugins, Study, load_limbs, read_study, run_study
from palpate_planning.candidates import extended_study
from palpate_planning.propose import PlanOptions, propose


def loop(
    study_file: Path, folder: Path, plugins: Plugins, *, until: float, most_presses: int, noise: float
) -> list[float]:
    """Press until every interval is at most ``until`` of its value; the widest one after each press."""
    study, robot = read_study(study_file, plugins), np.random.default_rng(1)
    run, widest = folder / "press-0", []
    run_study(study, run, plugins)
    for number in range(1, most_presses + 1):
        widest.append(widest_interval(run))
        say(f"{study.name}: {len(study.spots)} presses, the widest interval is {widest[-1]:.0%} of its value")
        if widest[-1] <= until:
            break
        press = propose(study, run, plugins, options=PlanOptions(goal="worst")).steps[0].chosen.press.press
        file = folder / f"press-{number}.csv"
        study.loader.save(file, press_of(study, press.spot, press.protocol, noise, robot))  # type: ignore[attr-defined]
        name, written = extended_study(run, study.file, press.name, file)
        say(f"press {number}: {name}, {press.keys}")
        before, run, study = run, folder / f"press-{number}", read_study(written, plugins)
        run_study(study, run, plugins, forked_from=before, adopt=True)
    return widest


def press_of(
    study: Study, spot: str, protocol: Protocol, noise: float, robot: np.random.Generator
) -> Response:
    """Curves that the robot measures: the truth, with noise relative to the largest ordinate."""
    row = np.array([study.truth[parameter.name] for parameter in study.space.parameters])
    limbs = load_limbs(study)
    job = Job(
        spot=spot,
        set_id=0,
        materials={region.region: region.material for region in study.space.regions},
        thetas=study.space.thetas(row),
        protocol=protocol,
        mesh="fine" if f"{spot}/fine" in limbs else "",
    )
    simulation = study.solver.simulate(job, limbs.get(job.limb_name))
    if simulation.status is not Status.OK or simulation.response is None:
        raise PalpateError(f"the robot's press at {spot} failed: {simulation.message}")
    curves = {
        name: Curve(
            channel=name,
            abscissa=curve.abscissa,
            ordinate=curve.ordinate
            + noise * np.abs(curve.ordinate).max() * robot.normal(size=curve.ordinate.size),
        )
        for name, curve in simulation.response.curves.items()
    }
    return Response(curves=curves)


def widest_interval(run: Path) -> float:
    """Widest 95 % interval of the joint fit, over the parameter's value."""
    rows = pl.read_parquet(run / "intervals.parquet")
    joint = rows.filter(pl.col("fit") == ALL_SPOTS) if ALL_SPOTS in rows["fit"] else rows
    return float(((joint["upper"] - joint["lower"]) / joint["value"].abs()).max())  # type: ignore[arg-type]


def main() -> None:
    """Read the command line and press."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("study", type=Path)
    parser.add_argument("--folder", type=Path, default=Path("runs/closed-loop"))
    parser.add_argument("--until", type=float, default=0.2, help="widest interval, over the value")
    parser.add_argument("--presses", type=int, default=4, help="most presses")
    parser.add_argument("--noise", type=float, default=0.005, help="over the largest ordinate")
    given = parser.parse_args()
    loop(
        given.study,
        given.folder,
        Plugins.load(),
        until=given.until,
        most_presses=given.presses,
        noise=given.noise,
    )


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
