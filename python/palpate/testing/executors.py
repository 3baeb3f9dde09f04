"""Laws of executors, with a solver whose answers are known."""

import contextlib
import os
from collections.abc import Iterator

import numpy as np
import pytest

from palpate.domain import Curve, HomogeneousTests, Job, Limb, Parameter, Response, Simulation, Status
from palpate.domain.component import Array
from palpate.domain.material import IsotropicMaterial
from palpate.plugins.execution import Batch, Executor, Limits
from palpate.plugins.interfaces import Solver
from palpate.plugins.provides import Provides
from palpate.testing.components import ComponentContract, overridden

FAILING = 2
"""Number of the set whose simulation raises."""


class LinearMaterial(IsotropicMaterial):
    """Ψ = E/2 Σ (λ − 1)²: no tissue, but quick."""

    name = "linear"
    summary = "stress in proportion to each stretch, for tests of executors"
    parameters = (
        Parameter(name="e", unit="MPa", lower=0.1, upper=1.0, kind="modulus", description="stiffness"),
    )

    def energy(self, stretches: Array, theta: Array) -> Array:
        """Strain energy per reference volume [MPa], (..., 3) → (...,)."""
        return theta[0] / 2 * ((stretches - 1.0) ** 2).sum(axis=-1)


class LinearSolver(Solver):
    """Stress E (t − 1); the set of number ``FAILING`` raises."""

    name = "linear"
    summary = "closed form, for tests of executors"
    provides = Provides(body="specimen", max_regions=1, channels=("uniaxial",), slopes=True)

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        """Simulate one job."""
        if job.set_id == FAILING:
            raise ZeroDivisionError("a stretch of zero")
        assert isinstance(job.protocol, HomogeneousTests)
        ((region, theta),), path = job.thetas.items(), job.protocol.paths["uniaxial"]
        slopes = {f"{region}.e": path - 1.0} if job.slopes else {}
        curve = Curve(channel="uniaxial", abscissa=path, ordinate=theta[0] * (path - 1.0), slopes=slopes)
        return Simulation(
            job=job,
            status=Status.OK,
            response=Response(curves={"uniaxial": curve}),
            diagnostics={"process": os.getpid()},
        )


class ExecutorContract(ComponentContract):
    """Laws of an executor; override ``executor``."""

    n_sets = 6
    """Sets at each of two spots."""

    time_s = 60.0
    """Longest time for one job."""

    executor = overridden("the executor under test")

    @pytest.fixture(autouse=True)
    def _closed(self, executor: Executor) -> Iterator[None]:
        yield
        executor.close()

    component = pytest.fixture(lambda self, executor: executor)

    @pytest.fixture
    def jobs(self) -> list[Job]:
        """Provide jobs at two spots, one of which fails at each."""
        protocol = HomogeneousTests(paths={"uniaxial": np.linspace(1.0, 1.5, 6)})
        return [
            Job(
                spot=spot,
                set_id=set_id,
                materials={"tissue": LinearMaterial()},
                thetas={"tissue": np.array([0.1 * (1 + set_id)])},
                protocol=protocol,
                slopes=True,
            )
            for spot in ("p1", "p2")
            for set_id in range(self.n_sets)
        ]

    def batch(self, jobs: list[Job], n_before_stop: int | None = None) -> Batch:
        """Build a batch of these jobs; it stops when asked for the n-th time."""
        asked = iter(range(10**9))

        def should_continue() -> bool:
            return n_before_stop is None or next(asked) < n_before_stop

        solver, limits = LinearSolver(), Limits(time_s=self.time_s)
        return Batch(
            solver=solver, jobs=jobs, limbs={}, limits=limits, n_workers=2, should_continue=should_continue
        )

    def test_every_job_has_one_result(self, executor: Executor, jobs: list[Job]) -> None:
        found = list(executor.results(self.batch(jobs)))
        missed = sorted(set(range(len(jobs))) - {index for index, _ in found})
        assert not missed, f"no result for the jobs at {missed}: a failed job has one too"
        assert len(found) == len(jobs), f"{len(found)} results for {len(jobs)} jobs: exactly one for each"

    def test_results_are_those_of_their_jobs(self, executor: Executor, jobs: list[Job]) -> None:
        for index, result in executor.results(self.batch(jobs)):
            job = jobs[index]
            if job.set_id == FAILING:
                self.assert_failed(result)
                continue
            assert result.status is Status.OK, result.message
            assert result.response is not None, "status ok without a response"
            stress = result.response["uniaxial"].ordinate
            expected = job.thetas["tissue"][0] * np.linspace(0.0, 0.5, 6)
            message = f"result {index} holds the answer of another job"
            np.testing.assert_allclose(stress, expected, rtol=1e-12, atol=1e-15, err_msg=message)
            slopes = result.response["uniaxial"].slopes
            lost = "the slopes of the curves are lost on the way"
            assert slopes.keys() == {"tissue.e"}, lost
            np.testing.assert_allclose(slopes["tissue.e"], np.linspace(0.0, 0.5, 6), atol=1e-15, err_msg=lost)
            here = result.diagnostics.get("process") == os.getpid()
            assert not (here and executor.holds_limits), (
                "jobs run in palpate's own process, which no memory limit can end: set holds_limits = False"
            )

    def assert_failed(self, result: Simulation) -> None:
        """Assert that a job whose simulation raised has that in its message."""
        assert result.status is Status.CRASHED, f"a simulation that raises is '{result.status.value}'"
        assert "a stretch of zero" in result.message, f"why it failed is lost: {result.message!r}"

    def test_starts_nothing_when_asked_to_stop(self, executor: Executor, jobs: list[Job]) -> None:
        found = [index for index, _ in executor.results(self.batch(jobs, n_before_stop=1))]
        assert len(found) == len(set(found)), "two results of one job"
        assert len(found) < len(jobs), "goes on although `should_continue` returned False"

    def test_no_jobs_are_done_at_once(self, executor: Executor) -> None:
        assert list(executor.results(self.batch([]))) == []

    def test_one_batch_may_follow_another(self, executor: Executor, jobs: list[Job]) -> None:
        for some in (jobs, jobs[:1], jobs[-2:]):
            self.test_results_are_those_of_their_jobs(executor, some)

    def test_a_caller_may_leave_early_and_close_it_twice(self, executor: Executor, jobs: list[Job]) -> None:
        results = executor.results(self.batch(jobs))
        with contextlib.closing(results) as open_ones:  # type: ignore[type-var]
            next(open_ones)
        executor.close()
        executor.close()
        self.test_every_job_has_one_result(executor, jobs[:1])
