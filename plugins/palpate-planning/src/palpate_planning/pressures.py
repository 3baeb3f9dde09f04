"""Largest pressures of candidates, which may be limited."""

from collections.abc import Sequence
from dataclasses import replace

from palpate.api import FORCE, FloatArray, Simulation, Status
from palpate_planning.candidates import PRESSURE
from palpate_planning.presses import DesignProblem, SimulatedPress, bare_problem, job_of
from palpate_prediction.api import contact_of


def with_pressures(
    design: DesignProblem, presses: Sequence[SimulatedPress], point: FloatArray
) -> list[SimulatedPress]:
    """Add the largest pressure [MPa] to the peaks of presses.

    It is solved at the first point (n_parameters,) of the box; at the others it changes like the force, as
    `palpate predict` takes it.
    """
    possible = [press for press in presses if press.at]
    jobs = [job_of(design, bare_problem(design, each.press), point) for each in possible]
    ended = design.problem.simulate([replace(job, slopes=False, surface=True) for job in jobs])
    simulated = dict(zip(possible, ended, strict=True))
    return [_added(each, simulated[each]) if each in simulated else each for each in presses]


def _added(press: SimulatedPress, simulation: Simulation) -> SimulatedPress:
    if simulation.surface is None or simulation.status is not Status.OK:
        why = simulation.message or simulation.status.remedy
        return replace(press, at=(), failure=f"its pressure is not known: {why}")
    largest = float(contact_of(simulation.surface, None).peak_MPa.max(initial=0.0))
    forces = [each.peaks.get(FORCE.name, 0.0) for each in press.at]
    if not all(forces):
        return replace(press, at=(), failure="its force is not known, which the pressure changes like")
    return replace(
        press,
        at=tuple(
            replace(each, peaks={**each.peaks, PRESSURE: largest * force / forces[0]})
            for each, force in zip(press.at, forces, strict=True)
        ),
    )
