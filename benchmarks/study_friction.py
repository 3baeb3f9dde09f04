"""Error of a torque without friction history: ``python benchmarks/study_friction.py --steps 5 10``.

The sticking point of a contact must be stored from step to step. FEBio's penalty form of ``sliding-elastic``
resets it in every step, so its torque falls with the number of steps, and a stiffness identified by torque
rises as much. Its augmented form keeps what the augmentation has converged. The embedded solver keeps the
sticking points and is the reference.

With prescribed motion every force and torque is proportional to the moduli, so the multiple s of the true
material that fits a form's curves f to the reference curves e best is

    s = Σ_k w_k ⟨f_k, e_k⟩ / n_k²  /  Σ_k w_k ⟨f_k, f_k⟩ / n_k²

over the channels k with the scenario's weights w and normalisers n = mean |e|.
"""

import argparse
import csv
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from palpate import Plugins, read_study
from palpate.api import (
    Curve,
    FloatArray,
    Indentation,
    Job,
    Limb,
    PalpateError,
    Response,
    Solver,
    Sphere,
    Status,
)
from palpate_febio.settings import FebioSettings
from palpate_febio.solver import FebioSolver

RECORDED = Path(__file__).parent / "data" / "friction_recorded.csv"
SCENARIOS = {"I": ("force", "torque"), "II": ("torque",), "III": ("force",)}
TWIST_DEG = 22.5
YEOH = np.array([0.0129, -1.008e-3, 9.2077e-5, 0.6])
"""The paper's generalised set, textbook; the paper gives no κ."""

Make = Callable[[float], Solver]
"""Makes a solver whose steps of rotation are at most this many degrees."""
Row = tuple[str, str, int, float, float, dict[str, float]]
"""Problem, form of contact, steps, torque [N·mm], torque over the right one, and stiffness by scenario."""


def recorded() -> Iterator[Row]:
    """Results of FEBio 4.11; where only a torque was recorded the stiffness is that of scenario II."""
    rows = list(csv.DictReader(RECORDED.read_text().splitlines()))
    right: dict[str, float] = {}
    for form in ("embedded", "augmented"):
        for row in rows:
            if row["form"].startswith(form):
                right.setdefault(row["problem"], float(row["torque_Nmm"]))
    for row in rows:
        problem, torque = f"{row['problem']} (recorded)", float(row["torque_Nmm"])
        ratio = torque / right[row["problem"]]
        stiffness = {name: float(row[name]) for name in SCENARIOS if row[name]} or {"II": 1.0 / ratio}
        yield problem, row["form"], int(row["n_steps"]), torque, ratio, stiffness


def best_multiple(found: Response, right: Response, channels: tuple[str, ...]) -> float:
    """Multiple of the true moduli at which these curves fit the reference best."""
    above = below = 0.0
    for channel in channels:
        e = right[channel].ordinate
        f = resampled(found[channel], right[channel])
        share = 1.0 / float(np.abs(e).mean()) ** 2
        above, below = above + share * float(f @ e), below + share * float(f @ f)
    return above / below


def resampled(curve: Curve, onto: Curve) -> FloatArray:
    """Ordinates of a path at the points of another division of the same path, by arc length."""
    ours, theirs = (np.concatenate([[0.0], np.abs(np.diff(c.abscissa)).cumsum()]) for c in (curve, onto))
    return np.asarray(np.interp(theirs, ours, curve.ordinate))


def simulated(plugins: Plugins, depth_mm: float, numbers: list[int]) -> Iterator[Row]:
    """Every form that is installed with every number of steps, on the forearm of the demo."""
    study = read_study(Path(plugins.studies["forearm-demo"].directory), plugins, need_measured=False)
    spot = next(each for each in study.spots if each.mesh is not None)
    assert study.limb_source is not None
    assert spot.mesh is not None
    limb = study.limb_source.load(spot.mesh, spot.spot)
    jax, febio = plugins.solvers["jax"], FebioSettings()
    forms: dict[str, Make] = {
        "embedded": lambda step: jax(jax.Settings(rotation_step_deg=step, mean_dilatation=False))
    }
    try:
        FebioSolver().binary()
        for form, contact in (("augmented", "right"), ("penalty", "paper")):
            forms[form] = lambda step, contact=contact: FebioSolver(
                febio.model_copy(update={"rotation_step_deg": step, "contact": contact})
            )
    except PalpateError as error:
        sys.stdout.write(f"without FEBio's forms on the demo's forearm: {error}\n")
    right: Response | None = None
    for n in sorted(numbers, reverse=True):
        for form, make in forms.items():
            found = run(plugins, limb, depth_mm, make(TWIST_DEG / n))
            right = right or found
            torque, right_torque = at_first_turn(found["torque"]), at_first_turn(right["torque"])
            stiffness = {name: best_multiple(found, right, of) for name, of in SCENARIOS.items()}
            yield "the demo's forearm", form, n, torque, torque / right_torque, stiffness


def at_first_turn(curve: Curve) -> float:
    """Ordinate where the path first turns back."""
    return float(curve.ordinate[curve.branches[0][1] - 1])


def run(plugins: Plugins, limb: Limb, depth_mm: float, solver: Solver) -> Response:
    """Curves of a press and twist."""
    path = [(0.0, 0.0), (depth_mm, 0.0), (depth_mm, -TWIST_DEG), (depth_mm, TWIST_DEG), (depth_mm, 0.0)]
    job = Job(
        spot=limb.spot.name,
        set_id=0,
        materials=dict.fromkeys(limb.mesh.regions, plugins.materials["yeoh"]()),
        thetas=dict.fromkeys(limb.mesh.regions, YEOH),
        protocol=Indentation(indenter=Sphere(radius_mm=7.5), path=np.array(path), friction=1.0),
    )
    solver.check(job, limb)
    simulation = solver.simulate(job, limb)
    if simulation.status is not Status.OK or simulation.response is None:
        raise SystemExit(f"{solver.name}: {simulation.message}")
    return simulation.response


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument(
        "--steps", type=int, nargs="*", default=[5, 10], help="steps of a quarter of the twist"
    )
    parser.add_argument("--depth-mm", type=float, default=3.0, help="how deep to press")
    asked = parser.parse_args()
    sys.stdout.write("problem, contact, steps, torque [N·mm], of the right one, stiffness found / true\n")
    for rows in (recorded(), simulated(Plugins.load(), asked.depth_mm, asked.steps)):
        for problem, form, n, torque, ratio, stiffness in rows:
            found = ", ".join(f"{name} {value:.3f}" for name, value in stiffness.items())
            sys.stdout.write(f"{problem}: {form}, {n} steps, {torque:.4g}, {ratio:.0%}, {found}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
