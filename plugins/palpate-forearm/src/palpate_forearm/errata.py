"""Statements of the paper that contradict each other or cannot be repeated, and what was done about each."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl

from palpate.api.runs import RunResult
from palpate_forearm.paper_tables import GENERALISED_FOPT, SETS_KEPT

NOT_SHARED = (
    "the limb: neither its scan nor its meshes are published; here it is a simulated phantom of the same "
    "kind, whose four spots are not the paper's four points",
    "the sensor and the robot: their curves are not published; here the curves come from a finite element "
    "solver that is not palpate's, on finer meshes, free of noise, for one known Yeoh material",
    "the mesh: 45,184 tetrahedra and 3,429 hexahedra there; here 700 to 2,500 quadratic tetrahedra",
    "the draw: the same ranges, but other sets, as the seed is not published; the number of sets is yours",
)
"""What a reproduction cannot have in common with the paper."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Erratum:
    """One inconsistency or gap of the paper.

    Parameters
    ----------
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


STATEMENTS = (
    Erratum(
        where="isochoric deformation",
        paper="F̃ = J^(1/3) F",
        found="a misprint: its determinant is J², where it must be 1",
        here="F̃ = J^(−1/3) F",
    ),
    Erratum(
        where="Yeoh's energy",
        paper="Σ c_i (I_i − 3)^i",
        found="a misprint: Yeoh's law has the first invariant only, and (I3 − 3)^3 would be −8 at rest; "
        "the isochoric invariant is meant, and U(J) is left out",
        here="Σ c_i (Ĩ1 − 3)^i + κ/2 (ln J)²",
    ),
    Erratum(
        where="Yeoh's ranges",
        paper="c2 in [−4.14e-5, −3e-3] MPa; nothing for κ",
        found="printed from high to low; κ cannot be searched without a range",
        here="c2 from −3e-3 to −4.14e-5 MPa; κ is 0.8 MPa",
    ),
    Erratum(
        where="Yeoh's coefficients",
        paper="as FEBio 4.6 takes them",
        found="FEBio 4 leaves out the factor i of the derivative of the energy: its set (c1, c2, c3) is "
        "the set (c1, c2/2, c3/3) of the printed formula",
        here="searched and shown in FEBio 4's convention (febio4); simulated as what they mean",
    ),
    Erratum(
        where="table 2 and the text",
        paper="the Ogden model has the lowest errors for II (0.0037) and III (0.0274)",
        found="the table's lowest are 0.0031 for II (neo_hookean, point 1) and 0.0259 for III (yeoh, "
        "point 3)",
        here="the table is taken as right",
    ),
    Erratum(
        where="the text on the Yeoh model",
        paper="the least error in scenario I at point 2, the highest of the three models at the other points",
        found="at point 3 0.1101 is less than neo-Hookean's 0.1301",
        here="the table is taken as right",
    ),
    Erratum(
        where="table 1",
        paper="36 sets, one for each material, point and scenario",
        found="only 29 are different; 13 rows share a set with another row",
        here="as it must be: the same sets are simulated at every spot, and scenarios may agree",
    ),
    Erratum(
        where="curves that coincide",
        paper="I and II at point 1 for Ogden and neo-Hookean and at point 2 for Ogden; I and III at point 1 "
        "for Yeoh",
        found="by table 1 these are other sets; equal there are only neo_hookean at point 2 (I = II), "
        "neo_hookean at point 2 (I = III), ogden at point 2 (I = III), yeoh at point 2 (I = III)",
        here="the table is taken as right",
    ),
    Erratum(
        where="the generalised Yeoh set",
        paper=f"mean Fopt {GENERALISED_FOPT[0]} ± {GENERALISED_FOPT[1]}",
        found="possible: the points' own best sets average 0.1199, and no one set can have less; it is the "
        "set of point 1, II. Whether the deviation divides by n or n − 1 is open",
        here="the set with the least mean Fopt; the deviation divides by n − 1",
    ),
)
"""Of formulas, tables and text; tests find the figures in the printed tables."""

CONTACT = (
    Erratum(
        where="friction",
        paper="FEBio's sliding-elastic contact in its penalty form, coefficient 1",
        found="that form resets the sticking points at every step: its torque depends on the "
        "number of steps, which is not given",
        here="friction that keeps the sticking points; benchmarks/study_friction.py shows the difference",
    ),
    Erratum(
        where="contact stiffness",
        paper="penalty; the factor is not given",
        found="with FEBio's automatic penalty and factor 1 the sphere sinks about 1 mm into the tissue, "
        "which caps force and torque",
        here="a penalty in proportion to the tissue's stiffness that keeps it below 1 % of the depth",
    ),
    Erratum(
        where="elements",
        paper="45,184 tetrahedra; of how many nodes is not said",
        found="linear ones lock in nearly incompressible tissue: at κ/μ = 40 they gave 38 N on a limb, "
        "quadratic ones 23 N, which makes the identified material too soft",
        here="quadratic tetrahedra with mean dilatation",
    ),
)
"""Of what was simulated."""


def errata(results: Mapping[str, RunResult]) -> list[Erratum]:
    """Everything in the paper that a reader of the comparison must know."""
    return [*STATEMENTS, _kept_sets(results), _normaliser(results), *CONTACT, _law(results)]


def _kept_sets(results: Mapping[str, RunResult]) -> Erratum:
    kept = [
        f"{result.design.n_sets} of {result.design.n_drawn} {name}"
        for name, result in results.items()
        if SETS_KEPT[name] < 250
    ]
    return Erratum(
        where="Drucker's criterion",
        paper="leaves 140 of 250 Yeoh sets; for which strains and loads is not said",
        found="over 20 draws of 250 the printed formula leaves 149 ± 5, FEBio 4's stress 171 ± 4 (uniaxial, "
        "equibiaxial and planar, stretch 0.3 to 3)",
        here=f"kept: {', '.join(kept)}" if kept else "Yeoh was not run",
    )


def _normaliser(results: Mapping[str, RunResult]) -> Erratum:
    found = "an error of 10 % of a symmetric twist would score far more than one of 10 % of the force"
    if results:
        measured = next(iter(results.values())).measured
        factors = {
            spot: float(np.mean(np.abs(y)) / np.abs(np.mean(y))) ** 2
            for spot, y in ((s, r["torque"].ordinate) for s, r in measured.items())
        }
        found = (
            "the mean of a symmetric twist's torque is nearly zero: divided by it the torque NMSE here would "
            f"be {min(factors.values()):.3g} to {max(factors.values()):.3g} times as large"
        )
    return Erratum(
        where="NMSE",
        paper="divided by the squared mean of the measured values",
        found=f"{found}; the errors of table 2 are not of that size",
        here="divided by the squared mean of |measured| (mean_abs)",
    )


def _law(results: Mapping[str, RunResult]) -> Erratum:
    # A spot at which a scenario found nothing has a null, and is passed over.
    too_little = pl.col("I") < pl.col("II") + pl.col("III")
    broken = [
        f"{name} {spot}"
        for name, result in results.items()
        for spot in result.report.tables["table2_nmse"].filter(too_little)["spot"]
    ]
    return Erratum(
        where="a check that table 2 passes",
        paper="I is at least II and III together in 12 of 12 rows",
        found="it has to be: II and III are each the least error of one channel, I that of both at once",
        here="holds in every row" if not broken else f"BROKEN for {', '.join(broken)}",
    )
