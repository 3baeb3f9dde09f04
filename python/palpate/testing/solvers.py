"""Laws of solvers."""

# ruff: noqa: D102 - the name of a test says what must hold

from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import (
    Job,
    Limb,
    Simulation,
    Status,
)
from palpate.interfaces import (
    Component,
    Solver,
)
from palpate.testing.components import ComponentContract, missing


class SolverContract(ComponentContract):
    """Laws of a solver; override ``solver``, ``job`` and, where it needs one, ``limb``."""

    scaling_tolerance = 1e-6
    """Largest relative deviation from: all moduli times s, then all ordinates times s."""

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
    def component(self, solver: Solver) -> Component:
        """Provide the solver."""
        return solver

    def test_version_is_constant(self, solver: Solver) -> None:
        assert solver.version().strip()
        assert solver.version() == solver.version()

    def test_simulates(self, solver: Solver, job: Job, limb: Limb | None) -> None:
        solver.check(job, limb)
        simulation = solver.simulate(job, limb)
        assert simulation.job is job
        assert simulation.status is Status.OK, simulation.message
        assert simulation.response is not None
        assert list(simulation.response)
        assert simulation.seconds >= 0.0

    def test_many_jobs_come_back_in_order(self, solver: Solver, job: Job, limb: Limb | None) -> None:
        jobs = [self.scaled(job, factor, set_id) for set_id, factor in enumerate((1.0, 1.5))]
        many = list(solver.simulate_many(iter(jobs), limb))
        assert [s.job.set_id for s in many] == [0, 1]
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
        assert simulation.response is not None
        assert reference.response is not None
        assert set(simulation.response) == set(reference.response)
        for channel in reference.response:
            expected = factor * reference.response[channel].ordinate
            tolerance = self.scaling_tolerance * float(np.abs(expected).max())
            np.testing.assert_allclose(simulation.response[channel].ordinate, expected, atol=tolerance)
