"""A comparison of solvers: quantities, differences and the verdict."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np

from palpate.api import (
    PRESS_AND_TWIST,
    Channel,
    Curve,
    FloatArray,
    Indentation,
    Job,
    Limb,
    Material,
    PalpateError,
    Simulation,
    Solver,
    SolverError,
    Sphere,
    Status,
)
from palpate.api.executors import simulate_alone
from palpate.api.runs import answering_for

RECORDED = "FEBio 4.11, recorded"

ENERGIES = "palpate"
"""Name in place of a solver where the stress of a material is compared."""

COUPLED = frozenset({"neo_hookean"})
"""Materials whose hex8 and tet10 are displacement elements in FEBio."""

Contender = Callable[[bool | tuple[str, ...]], Solver]
"""Makes a solver for a case, given which regions have one volume change per element."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One comparison.

    ``difference`` is relative to the peak of the reference; None without a result, with the
    reason in ``note``. ``refused`` is a problem that the solver does not support.
    """

    problem: str
    material: str
    quantity: str
    solver: str
    against: str
    difference: float | None
    tolerance: float
    note: str = ""
    refused: bool = False

    @property
    def verdict(self) -> str:
        """``agrees``, ``differs``, ``failed`` without a result, or ``open`` without a solver."""
        if self.difference is None:
            return "open" if self.refused else "failed"
        return "agrees" if self.difference <= self.tolerance else "differs"


@dataclass(frozen=True, slots=True, kw_only=True)
class SolverComparison:
    """Every comparison, the solvers with their versions, and what could not be run.

    ``judged`` names the solvers of the verdict, all if it is empty; the others
    are references.
    """

    rows: tuple[Row, ...]
    solvers: Mapping[str, str]
    missing: tuple[str, ...]
    judged: frozenset[str] = frozenset()

    @property
    def passed(self) -> bool:
        """True if something was compared, and no judged solver differs or failed."""
        return self._sound([row for row in self.rows if self.counts(row.solver)])

    def counts(self, solver: str) -> bool:
        """True if the verdict includes this solver."""
        return not self.judged or solver in self.judged or solver == ENERGIES

    @property
    def by_solver(self) -> dict[str, bool]:
        """Agreement of each solver, by the same rule."""
        names = dict.fromkeys(row.solver for row in self.rows)
        return {name: self._sound([row for row in self.rows if row.solver == name]) for name in names}

    @staticmethod
    def _sound(rows: Sequence[Row]) -> bool:
        verdicts = {row.verdict for row in rows}
        return "agrees" in verdicts and verdicts <= {"agrees", "open"}

    def as_json(self) -> dict[str, Any]:
        """Plain values for a script."""
        return {
            "passed": self.passed,
            "by_solver": self.by_solver,
            "judged": sorted(self.judged),
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
        Of the problem, and of its material.
    materials, thetas : mapping
        By region; textbook values (n_parameters,).
    path : (n, 2) array
        Depth [mm] and rotation [degrees], from rest.
    mean_dilatation : bool or tuple of regions
        As FEBio's element: true for hex8 and tet10 of uncoupled materials.
    channels : tuple of Channel
        What to observe of equilibrium states.
    """

    problem: str
    name: str
    limb: Limb
    materials: Mapping[str, Material]
    thetas: Mapping[str, FloatArray]
    path: FloatArray
    friction: float
    mean_dilatation: bool | tuple[str, ...]
    channels: tuple[Channel, ...] = PRESS_AND_TWIST

    @classmethod
    def of_one_material(
        cls, problem: str, limb: Limb, material: Material, theta: FloatArray, path: FloatArray
    ) -> Self:
        """A limb whose regions all have one material, with friction 1."""
        return cls(
            problem=problem,
            name=material.name,
            limb=limb,
            materials=dict.fromkeys(limb.mesh.regions, material),
            thetas=dict.fromkeys(limb.mesh.regions, theta),
            path=path,
            friction=1.0,
            mean_dilatation=material.name not in COUPLED,
        )

    @property
    def protocol(self) -> Indentation:
        """Path of a sphere."""
        return Indentation(indenter=Sphere(radius_mm=7.5), path=self.path, friction=self.friction)

    def job(self) -> Job:
        """Simulation of the case."""
        return Job(
            spot=self.limb.spot.name,
            set_id=0,
            materials=self.materials,
            thetas=self.thetas,
            protocol=self.protocol,
            channels=self.channels,
        )

    def row(self, **figures: Any) -> Row:
        """Row of this problem and material."""
        return Row(problem=self.problem, material=self.name, **figures)

    def run(self, solver: Solver) -> Simulation:
        """The case by one solver; an unsupported one has crashed with the diagnostic ``refused``."""
        job = self.job()
        try:
            with answering_for(solver, f"the comparison's {self.problem}"):
                if lacks := solver.provides.lacks(job):
                    raise SolverError(f"it does not provide {', '.join(lacks)}")
                solver.check(job, self.limb)
        except PalpateError as error:
            refused = {"refused": True}
            return Simulation(
                job=job, status=Status.CRASHED, response=None, message=str(error), diagnostics=refused
            )
        return simulate_alone(solver, job, self.limb)


def at(curve: Curve, wanted: Sequence[float]) -> FloatArray:
    """Ordinates where the path reaches each of these abscissae in turn; NaN where it does not."""
    found, start = [], 0
    for value in wanted:
        near = np.flatnonzero(np.abs(curve.abscissa[start:] - value) < 1e-6)
        found.append(curve.ordinate[start + near[0]] if near.size else np.nan)
        start += int(near[0]) if near.size else 0
    return np.array(found)


def answer(simulation: Simulation, channel: str, wanted: Sequence[float]) -> tuple[FloatArray | None, str]:
    """Ordinates at these abscissae, or None and the reason."""
    if simulation.status is not Status.OK or simulation.response is None:
        return None, simulation.message or simulation.status.value
    if channel not in simulation.response:
        return None, f"no channel '{channel}' in its result"
    values = at(simulation.response[channel], wanted)
    if not np.isfinite(values).all():
        return None, f"its {channel} does not reach {wanted[int(np.argmin(np.isfinite(values)))]:g}"
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
        solver = make(case.mean_dilatation)
        simulation = case.run(solver)
        computed = {channel.name for channel in case.channels if solver.provides.computes(channel)}
        for channel, (wanted, expected, peak) in references.items():
            values, why = answer(simulation, channel, wanted)
            if channel not in computed:
                why = f"it does not provide channel '{channel}'"
            difference = None if values is None else float(np.abs(values - expected).max() / peak)
            yield case.row(
                quantity=channel,
                solver=name,
                against=RECORDED,
                difference=difference,
                tolerance=tolerance,
                note=why or note,
                refused="refused" in simulation.diagnostics or channel not in computed,
            )
