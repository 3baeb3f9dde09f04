"""Laws of solvers."""

# ruff: noqa: D102 - the name of a test says what must hold

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from palpate.domain import Curve, FloatArray, HomogeneousTests, Job, Limb, Simulation, Status, moving_span
from palpate.interfaces import Component, Solver
from palpate.testing.components import ComponentContract, missing

DEPTH, ROTATION = 0, 1
"""Columns of an indentation's path."""


class SolverContract(ComponentContract):
    """Laws of a solver; override ``solver``, ``job`` and, where it needs one, ``limb``.

    Override ``hopeless`` and ``finer`` too: a solver that says `ok` without having converged
    shows itself there alone.
    """

    scaling_tolerance = 1e-6
    """Largest relative deviation from: all moduli times s, then all ordinates times s."""

    convergence_tolerance = 0.02
    """Largest relative difference between an answer and that of ``finer``."""

    path_channels: Mapping[str, int] = MappingProxyType({"force": DEPTH, "torque": ROTATION})
    """Channels whose abscissa is a column of an indentation's path; others are not held against it."""

    @pytest.fixture
    def solver(self) -> Solver:
        """Provide the solver under test."""
        missing("solver", type(self).__name__)

    @pytest.fixture
    def job(self) -> Job:
        """Provide a job that the solver can do, with materials whose moduli may be scaled."""
        missing("job", type(self).__name__)

    @pytest.fixture
    def limb(self) -> Limb | None:
        """Provide the limb of the job."""
        return None

    @pytest.fixture
    def hopeless(self) -> Job | None:
        """Provide a job of the same limb that has no answer, or that this solver cannot find."""
        return None

    @pytest.fixture
    def finer(self) -> Solver | None:
        """Provide the solver with smaller steps or tighter tolerances, where it has such settings."""
        return None

    @pytest.fixture
    def component(self, solver: Solver) -> Component:
        """Provide the solver."""
        return solver

    def test_version_is_constant(self, solver: Solver) -> None:
        assert solver.version().strip(), "a version is part of each simulation's key: it cannot be empty"
        assert solver.version() == solver.version(), "the version changes from call to call"

    def test_simulates_the_whole_protocol(self, solver: Solver, job: Job, limb: Limb | None) -> None:
        solver.check(job, limb)
        simulation = solver.simulate(job, limb)
        assert simulation.job is job, "the simulation is of another job"
        assert simulation.status is Status.OK, simulation.message
        assert simulation.response is not None, "status ok without a response"
        assert list(simulation.response), "status ok without a curve"
        assert simulation.seconds >= 0.0, f"{simulation.seconds} seconds"
        for channel in simulation.response:
            self.assert_follows(simulation.response[channel], job)

    def test_a_hopeless_job_is_no_success(
        self, solver: Solver, hopeless: Job | None, limb: Limb | None
    ) -> None:
        if hopeless is None:
            pytest.skip("no `hopeless` job is given: nothing shows that a failure is told")
        simulation = solver.simulate(hopeless, limb)
        assert simulation.status is not Status.OK, "status ok for a job that has no answer"
        assert simulation.message.strip(), f"status {simulation.status.value} without a message"

    def test_finer_settings_change_little(
        self, solver: Solver, finer: Solver | None, job: Job, limb: Limb | None
    ) -> None:
        if finer is None:
            pytest.skip("no `finer` solver is given: nothing shows that answers have converged")
        found, reference = (each.simulate(job, limb).response for each in (solver, finer))
        assert found is not None
        assert reference is not None
        for channel in reference:
            largest = float(np.abs(reference[channel].ordinate).max())
            off = np.abs(_at(found[channel], reference[channel]) - reference[channel].ordinate).max()
            assert off <= self.convergence_tolerance * largest, (
                f"channel '{channel}': finer settings change the answer by {off / largest:.2g} of its "
                f"largest value, more than {self.convergence_tolerance:g}: `ok` is said too early"
            )

    def test_many_jobs_come_back_in_order(self, solver: Solver, job: Job, limb: Limb | None) -> None:
        jobs = [self.scaled(job, factor, set_id) for set_id, factor in enumerate((1.0, 1.5))]
        many = list(solver.simulate_many(iter(jobs), limb))
        assert [s.job.set_id for s in many] == [0, 1], "simulate_many answers in another order"
        for simulation, alone in zip(many, (solver.simulate(j, limb) for j in jobs), strict=True):
            self.assert_scaled(simulation, alone, 1.0)

    def test_moduli_scale_the_response(self, solver: Solver, job: Job, limb: Limb | None) -> None:
        simulation = solver.simulate(job, limb)
        self.assert_scaled(solver.simulate(self.scaled(job, 2.0, job.set_id), limb), simulation, 2.0)

    def scaled(self, job: Job, factor: float, set_id: int) -> Job:
        """Build the job with every modulus times ``factor``."""
        thetas = {
            region: theta
            * np.array([factor if p.kind == "modulus" else 1.0 for p in job.materials[region].parameters])
            for region, theta in job.thetas.items()
        }
        return replace(job, thetas=thetas, set_id=set_id)

    def assert_scaled(self, simulation: Simulation, reference: Simulation, factor: float) -> None:
        """Assert that every ordinate is ``factor`` times the reference's."""
        assert simulation.response is not None, simulation.message
        assert reference.response is not None, reference.message
        assert set(simulation.response) == set(reference.response), "channels come and go with the moduli"
        for channel in reference.response:
            expected = factor * reference.response[channel].ordinate
            tolerance = self.scaling_tolerance * float(np.abs(expected).max())
            np.testing.assert_allclose(
                simulation.response[channel].ordinate,
                expected,
                atol=tolerance,
                err_msg=f"channel '{channel}': moduli times {factor:g} is not the curve times {factor:g}",
            )

    def assert_follows(self, curve: Curve, job: Job) -> None:
        """Assert that a curve goes where the protocol goes, to its end, and turns where it turns."""
        asked = self._asked(curve.channel, job)
        if asked is None:
            return
        reach = 0.02 * float(np.ptp(asked))
        expected, found = turning_points(asked), turning_points(curve.abscissa)
        alike = len(found) == len(expected) and np.abs(found - expected).max() <= reach
        assert alike, (
            f"channel '{curve.channel}': status ok, but the abscissa runs {_route(found)} where the protocol "
            f"runs {_route(expected)}; give every point in the order travelled, or another status"
        )

    def _asked(self, channel: str, job: Job) -> FloatArray | None:
        if isinstance(job.protocol, HomogeneousTests):
            return job.protocol.paths.get(channel)
        if channel not in self.path_channels:
            return None
        return job.protocol.path[:, self.path_channels[channel]]


def turning_points(abscissa: FloatArray) -> FloatArray:
    """Where a path begins, turns and ends: one more than it has branches."""
    curve = Curve(channel="", abscissa=abscissa, ordinate=np.zeros(len(abscissa)))
    moving = curve.cut(moving_span(curve.abscissa))
    starts = [start for start, _ in moving.branches]
    points: FloatArray = moving.abscissa[[*starts, -1]]
    return points


def _route(points: FloatArray) -> str:
    return " → ".join(f"{x:g}" for x in points)


def _at(curve: Curve, reference: Curve) -> FloatArray:
    """Ordinates along the reference, by the share of the way that both have travelled."""
    way, asked = (np.concatenate([[0.0], np.abs(np.diff(c.abscissa)).cumsum()]) for c in (curve, reference))
    ordinates: FloatArray = np.interp(asked, way, curve.ordinate)
    return ordinates
