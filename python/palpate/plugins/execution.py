"""Executors: what one is handed, and what it hands back for each job."""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from palpate.domain import Job, Limb, Response, Simulation, Status
from palpate.plugins.interfaces import Component, Solver


@dataclass(frozen=True, slots=True, kw_only=True)
class JobResult:
    """What became of the job at ``index``; a :class:`Simulation` that can leave its process.

    Parameters
    ----------
    quarantined : bool
        The job ended its worker as often as it may; it is not to be tried again by itself.
    """

    index: int
    status: Status
    response: Response | None = None
    message: str = ""
    seconds: float = 0.0
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    quarantined: bool = False

    def simulation(self, job: Job) -> Simulation:
        """Put the result together with its job."""
        return Simulation(
            job=job,
            status=self.status,
            response=self.response,
            message=self.message,
            seconds=self.seconds,
            diagnostics=self.diagnostics,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What one job may take; an executor in this very process cannot hold it to that.

    Parameters
    ----------
    time_s : float
        A job that takes longer is stopped.
    memory_MB : float
        Most memory that a job may take beside what its worker holds already; 0: no limit.
    n_attempts : int
        How often a job may end its worker before it is quarantined.
    """

    time_s: float
    memory_MB: float = 0.0
    n_attempts: int = 2


def _always() -> bool:
    return True


def _ignored(n_running: int) -> None:
    """Nobody wants to know."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """Jobs to be done.

    Parameters
    ----------
    limbs : mapping of spot name to Limb
        Empty for a solver that needs none.
    n_workers : int
        0 means one per core.
    plugin_files : sequence of Path
        One-file plugins that each worker loads before anything else.
    should_continue : callable
        Asked before a job is begun; where it says no, those begun are finished and the rest left.
    running : callable
        Told how many jobs are running, as far as the executor knows, whenever that changes.
    """

    solver: Solver
    jobs: Sequence[Job]
    limbs: Mapping[str, Limb]
    limits: Limits
    n_workers: int = 0
    plugin_files: Sequence[Path] = ()
    should_continue: Callable[[], bool] = _always
    running: Callable[[int], None] = _ignored


class Executor(Component):
    """Runs jobs somewhere, and hands every result back to this process, which alone keeps them."""

    holds_limits: ClassVar[bool] = True
    """False where a job cannot be held to a memory limit; a study that asks for one is refused."""

    @abstractmethod
    def results(self, batch: Batch) -> Iterator[JobResult]:
        """Yield the result of each job as it comes, exactly one for each.

        A job that fails, hangs or ends its worker has a result too. When ``batch.should_continue()``
        turns false no further job is begun, and those begun are finished.

        Raises
        ------
        ExecutorError
            There is nowhere to run them.
        """
