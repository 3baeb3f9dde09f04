"""Error of a stiffness identified by the torque of FEBio's penalty friction.

The sticking point of a contact must be stored from step to step. FEBio's penalty
form of ``sliding-elastic`` resets it in every step, so its traction is the
penalty times the slip of one step: with twice as many steps of the
twist the torque halves. The force hardly changes.

The error of the identified stiffness is exact. With prescribed motion every
force and torque is proportional to the moduli, so the best multiple s of the
true material for a form's curves f against the reference curves e is

    s = Σ_k w_k ⟨f_k, e_k⟩ / n_k²  /  Σ_k w_k ⟨f_k, f_k⟩ / n_k²

over the channels k with the scenario's weights w and normalisers n = mean |e|.
"""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files

import numpy as np

from palpate.api import Curve, FloatArray, Response

SCENARIOS: Mapping[str, Mapping[str, float]] = {
    "I": {"force": 1.0, "torque": 1.0},
    "II": {"torque": 1.0},
    "III": {"force": 1.0},
}


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionResult:
    """Result of one form of contact with a number of steps of the twist.

    ``stiffness`` is, by scenario, the identified stiffness relative to the true
    one; None if curves were not recorded.
    """

    problem: str
    form: str
    n_steps: int
    torque_Nmm: float | None
    relative: float | None
    stiffness: Mapping[str, float] | None
    note: str = ""


def best_multiple(found: Response, right: Response, weights: Mapping[str, float]) -> float:
    """Multiple of the true moduli at which these curves fit the reference best.

    Parameters
    ----------
    found, right : Response
        Curves over the same path.
    weights : mapping of channel to weight
    """
    above = below = 0.0
    for channel, weight in weights.items():
        e = right[channel].ordinate
        f = resampled(found[channel], right[channel])
        share = weight / float(np.abs(e).mean()) ** 2
        above += share * float(f @ e)
        below += share * float(f @ f)
    return above / below


def resampled(curve: Curve, onto: Curve) -> FloatArray:
    """Ordinates of a path at the points of another division of the same path, by arc length."""
    ours, theirs = (np.concatenate([[0.0], np.abs(np.diff(c.abscissa)).cumsum()]) for c in (curve, onto))
    if not np.isclose(ours[-1], theirs[-1], rtol=1e-6):
        raise ValueError(f"paths of {ours[-1]:g} and {theirs[-1]:g}: not the same protocol")
    return np.asarray(np.interp(theirs, ours, curve.ordinate))


def friction_results(
    problem: str, runs: Mapping[tuple[str, int], tuple[Response | None, str]], right: Response
) -> Iterator[FrictionResult]:
    """Compare every form and number of steps with the reference.

    Parameters
    ----------
    runs : mapping of (form, number of steps) to the curves, or None and the reason
    right : Response
        Of a solver that stores the sticking points, with small steps.
    """
    truth = right["torque"].first_turn
    for (form, n_steps), (response, why) in runs.items():
        torque = response["torque"].first_turn if response and "torque" in response else None
        yield FrictionResult(
            problem=problem,
            form=form,
            n_steps=n_steps,
            torque_Nmm=torque,
            relative=None if torque is None else torque / truth,
            stiffness=None
            if response is None or torque is None
            else {name: best_multiple(response, right, w) for name, w in SCENARIOS.items()},
            note=why if torque is None else "",
        )


def recorded() -> Sequence[FrictionResult]:
    """Recorded results of FEBio 4.11, relative to the embedded solver, or to the first augmented run.

    If only a torque was recorded there is only scenario II: the stiffness from this torque.
    """
    text = files("palpate_validation").joinpath("data/friction_recorded.csv").read_text()
    rows = list(csv.DictReader(text.splitlines()))
    right: dict[str, float] = {}
    for form in ("embedded", "augmented"):
        for row in rows:
            if row["form"].startswith(form):
                right.setdefault(row["problem"], float(row["torque_Nmm"]))
    return [
        FrictionResult(
            problem=row["problem"],
            form=row["form"],
            n_steps=int(row["n_steps"]),
            torque_Nmm=float(row["torque_Nmm"]),
            relative=float(row["torque_Nmm"]) / right[row["problem"]],
            stiffness={name: float(row[name]) for name in SCENARIOS if row[name]}
            or {"II": right[row["problem"]] / float(row["torque_Nmm"])},
            note="recorded" if row["form"] == "embedded" else "recorded with FEBio 4.11",
        )
        for row in rows
    ]
