"""A certificate that solvers agree: what was compared, how much it differs, and the verdict."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from palpate.domain import Curve, FloatArray, Indentation, Job, Limb, Simulation, Sphere, Status
from palpate.interfaces import Material, Solver

RECORDED = "FEBio 4.11, recorded"

Contender = Callable[[bool | tuple[str, ...]], Solver]
"""Makes a solver for a case, given which regions have one volume change per element."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One comparison.

    ``difference`` is relative to the peak of what it is compared with; None where
    there was no answer, or nothing to compare with: ``note`` says why.
    """

    problem: str
    material: str
    quantity: str
    solver: str
    against: str
    difference: float | None
    tolerance: float
    note: str = ""

    @property
    def verdict(self) -> str:
        """``agrees``, ``differs``, or ``open`` where there is no figure."""
        if self.difference is None:
            return "open"
        return "agrees" if self.difference <= self.tolerance else "differs"


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """Every comparison, the solvers with their versions, and what could not be run."""

    rows: tuple[Row, ...]
    solvers: Mapping[str, str]
    missing: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether something was compared and nothing differs."""
        verdicts = [row.verdict for row in self.rows]
        return "agrees" in verdicts and "differs" not in verdicts

    def as_json(self) -> dict[str, Any]:
        """Plain values for a script."""
        return {
            "passed": self.passed,
            "solvers": dict(self.solvers),
            "missing": list(self.missing),
            "rows": [{**asdict(row), "verdict": row.verdict} for row in self.rows],
        }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Case:
    """A problem for every solver.

    Parameters
    ----------
    problem, name : str
        What it is, and of which material.
    limb : Limb
    materials, thetas : mapping by region
    path : (n, 2) array
        Depth [mm] and rotation [degrees], from rest.
    friction : float
    mean_dilatation : bool or tuple of regions
        Where FEBio's element has one volume change: hex8 of uncoupled materials.
    """

    problem: str
    name: str
    limb: Limb
    materials: Mapping[str, Material]
    thetas: Mapping[str, FloatArray]
    path: FloatArray
    friction: float
    mean_dilatation: bool | tuple[str, ...]

    def run(self, solver: Solver) -> Simulation:
        """The case by one solver."""
        protocol = Indentation(indenter=Sphere(radius_mm=7.5), path=self.path, friction=self.friction)
        job = Job(
            spot=self.limb.spot.name,
            set_id=0,
            materials=self.materials,
            thetas=self.thetas,
            protocol=protocol,
        )
        solver.check(job, self.limb)
        return solver.simulate(job, self.limb)


def at(curve: Curve, wanted: Sequence[float]) -> FloatArray:
    """Ordinates where the path comes to each of these abscissae in turn; NaN where it does not."""
    found, start = [], 0
    for value in wanted:
        near = np.flatnonzero(np.abs(curve.abscissa[start:] - value) < 1e-6)
        found.append(curve.ordinate[start + near[0]] if near.size else np.nan)
        start += int(near[0]) if near.size else 0
    return np.array(found)


def answer(simulation: Simulation, channel: str, wanted: Sequence[float]) -> tuple[FloatArray | None, str]:
    """Ordinates at these abscissae, or None and why not."""
    if simulation.status is not Status.OK or simulation.response is None:
        return None, simulation.message or simulation.status.value
    if channel not in simulation.response:
        return None, f"no channel '{channel}' in its answer"
    values = at(simulation.response[channel], wanted)
    if not np.isfinite(values).all():
        return None, f"its {channel} does not come to {wanted[int(np.argmin(np.isfinite(values)))]:g}"
    return values, ""


def compared(
    case: Case,
    contenders: Mapping[str, Contender],
    references: Mapping[str, tuple[Sequence[float], FloatArray, float]],
    tolerance: float,
    note: str = "",
) -> Iterator[Row]:
    """Every solver against recorded ordinates by channel: (abscissae, ordinates, peak)."""
    for name, make in contenders.items():
        simulation = case.run(make(case.mean_dilatation))
        for channel, (wanted, expected, peak) in references.items():
            values, why = answer(simulation, channel, wanted)
            difference = None if values is None else float(np.abs(values - expected).max() / peak)
            yield Row(
                problem=case.problem,
                material=case.name,
                quantity=channel,
                solver=name,
                against=RECORDED,
                difference=difference,
                tolerance=tolerance,
                note=why or note,
            )
