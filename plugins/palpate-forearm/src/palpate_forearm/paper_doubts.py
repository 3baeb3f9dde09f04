"""What in the paper contradicts itself or cannot be repeated, and what was done about each."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl

from palpate.pipeline import RunResult
from palpate_forearm.paper_tables import GENERALISED, GENERALISED_FOPT, SETS_KEPT, table1, table2

NOT_SHARED = (
    "the limb: neither its scan nor its meshes are published; here it is a simulated phantom of the same "
    "kind, whose four spots are not the paper's four points",
    "the sensor and the robot: their curves are not published; here the curves come from another finite "
    "element solver (FEBio, on finer meshes), free of noise, for one known Yeoh material",
    "the mesh: 45,184 linear tetrahedra and 3,429 hexahedra there; here quadratic tetrahedra, far fewer",
    "the draw: the same ranges and numbers of sets, but other sets, as the seed is not published",
)
"""What a reproduction cannot have in common with the paper."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Doubt:
    """One inconsistency or gap of the paper.

    Parameters
    ----------
    where : str
    paper : str
        What it says.
    found : str
        What does not fit, with the figures that show it.
    here : str
        What palpate does.
    """

    where: str
    paper: str
    found: str
    here: str


def doubts(results: Mapping[str, RunResult]) -> list[Doubt]:
    """Everything in the paper that a reader of the comparison must know."""
    return [
        *_formulas(),
        _lowest_errors(),
        _recurring_sets(),
        _generalised_set(),
        _kept_sets(results),
        _normaliser(results),
        *_contact(),
        _law(results),
    ]


def _formulas() -> list[Doubt]:
    return [
        Doubt(
            where="isochoric deformation",
            paper="F̃ = J^(1/3) F",
            found="a misprint: that doubles the change of volume instead of taking it out",
            here="F̃ = J^(−1/3) F",
        ),
        Doubt(
            where="Yeoh's energy",
            paper="Σ c_i (I_i − 3)^i",
            found="a misprint: only the first invariant makes each term a power that is zero at rest",
            here="Σ c_i (Ĩ1 − 3)^i",
        ),
        Doubt(
            where="Yeoh's ranges",
            paper="c2 in [−4.14e-5, −3e-3] MPa; nothing for κ",
            found="printed from high to low; κ cannot be searched without a range",
            here="c2 from −3e-3 to −4.14e-5 MPa; κ is 0.8 MPa",
        ),
        Doubt(
            where="Yeoh's coefficients",
            paper="as FEBio 4.6 takes them",
            found="FEBio 4 leaves out the factor i of the derivative of the energy: its set (c1, c2, c3) is "
            "the set (c1, c2/2, c3/3) of the printed formula",
            here="searched and shown in FEBio 4's convention (febio4); simulated as what they mean",
        ),
    ]


def _lowest_errors() -> Doubt:
    errors = table2()
    least = {
        scenario: errors.filter(pl.col("scenario") == scenario).sort("nmse").row(0, named=True)
        for scenario in ("II", "III")
    }
    told = " and ".join(
        f"{row['nmse']:g} for {name} ({row['material']}, point {row['point']})" for name, row in least.items()
    )
    return Doubt(
        where="table 2 and the text",
        paper="the Ogden model has the lowest errors for II (0.0037) and III (0.0274)",
        found=f"the table's lowest are {told}",
        here="the table is taken as right",
    )


def _recurring_sets() -> Doubt:
    sets = table1().pivot("parameter", index=["material", "point", "scenario"], values="value")
    seen = Counter(
        (
            row["material"],
            *(row[name] for name in sorted(row) if name not in ("material", "point", "scenario")),
        )
        for row in sets.iter_rows(named=True)
    )
    recurring = sum(count for count in seen.values() if count > 1)
    return Doubt(
        where="table 1",
        paper="36 sets, one for each material, point and scenario",
        found=f"only {len(seen)} are different; {recurring} rows share a set with another row",
        here="as it must be: the same sets are simulated at every spot, and scenarios may agree",
    )


def _generalised_set() -> Doubt:
    errors = table2().filter(pl.col("material") == "yeoh", pl.col("scenario") == "I")["nmse"]
    bound = float(np.mean(errors.to_numpy()))
    values = (
        table1()
        .filter(pl.col("material") == "yeoh")
        .pivot("parameter", index=["point", "scenario"], values="value")
    )
    near = [
        f"point {row['point']}, {row['scenario']}"
        for row in values.iter_rows(named=True)
        if all(np.isclose(row[name], value, rtol=2e-3) for name, value in GENERALISED.items())
    ]
    return Doubt(
        where="the generalised Yeoh set",
        paper=f"mean Fopt {GENERALISED_FOPT[0]} ± {GENERALISED_FOPT[1]}",
        found=f"possible: the least means of each point alone average {bound:.4f}; it is the set of "
        f"{' and '.join(near) or 'no row of table 1'}. Whether the deviation divides by n or n − 1 is open",
        here="the set with the least mean Fopt; the deviation divides by n − 1",
    )


def _kept_sets(results: Mapping[str, RunResult]) -> Doubt:
    kept = [
        f"{result.design.n_sets} of {result.design.n_drawn} {name}"
        for name, result in results.items()
        if SETS_KEPT[name] < 250
    ]
    return Doubt(
        where="Drucker's criterion",
        paper="leaves 140 of 250 Yeoh sets; for which strains and loads is not said",
        found="over 20 draws of 250 the printed formula leaves 149 ± 5, FEBio 4's stress 171 ± 4 (uniaxial, "
        "equibiaxial and planar, stretch 0.3 to 3)",
        here=f"kept: {', '.join(kept)}" if kept else "Yeoh was not run",
    )


def _normaliser(results: Mapping[str, RunResult]) -> Doubt:
    told = "an error of 10 % of a symmetric twist would score far more than one of 10 % of the force"
    if results:
        measured = next(iter(results.values())).measured
        factors = {
            spot: float(np.mean(np.abs(y)) / np.abs(np.mean(y))) ** 2
            for spot, y in ((s, r["torque"].ordinate) for s, r in measured.items())
        }
        told = (
            "the mean of a symmetric twist's torque is nearly zero: divided by it the torque NMSE here would "
            f"be {min(factors.values()):.3g} to {max(factors.values()):.3g} times as large"
        )
    return Doubt(
        where="NMSE",
        paper="divided by the squared mean of the measured values",
        found=f"{told}; the errors of table 2 are not of that size",
        here="divided by the squared mean of |measured| (mean_abs)",
    )


def _contact() -> list[Doubt]:
    return [
        Doubt(
            where="friction",
            paper="FEBio's sliding-elastic contact in its penalty form, coefficient 1",
            found="that form forgets where a point stuck at every step: its torque is a property of the "
            "number of steps, which is not given",
            here="friction that remembers; `palpate friction-memory` shows the difference",
        ),
        Doubt(
            where="contact stiffness",
            paper="penalty; the factor is not given",
            found="with FEBio's automatic penalty and factor 1 the sphere sinks about 1 mm into the tissue, "
            "which caps force and torque",
            here="a penalty in proportion to the tissue's stiffness that keeps it below 1 % of the depth",
        ),
    ]


def _law(results: Mapping[str, RunResult]) -> Doubt:
    broken = [
        f"{name} {row['spot']}"
        for name, result in results.items()
        for row in result.report.tables["table2_nmse"].iter_rows(named=True)
        if row["I"] < row["II"] + row["III"]
    ]
    printed = table2().pivot("scenario", index=["material", "point"], values="nmse")
    n_right = int((printed["I"] >= printed["II"] + printed["III"]).sum())
    return Doubt(
        where="a law of table 2",
        paper=f"I is at least II and III together; so it is in {n_right} of {printed.height} rows",
        found="nothing, were every row so: each of II and III is the least there is",
        here="holds in every row" if not broken else f"BROKEN for {', '.join(broken)}",
    )
