"""Executors: the batch that one takes, and the simulations that it returns."""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from palpate.domain import Job, Limb, Simulation
from palpate.domain.component import Component, SettingsT
from palpate.plugins.interfaces import Solver


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits of one job; an executor in this process cannot enforce them.

    Parameters
    ----------
    time_s : float
        Processor time after which a job is stopped, for each thread of its worker; ten times as long by the
        clock, for one that hangs without using any.
    memory_MB : float
        Most memory that a job may allocate on top of its worker; 0: no limit.
    n_attempts : int
        Worker crashes tolerated per job; after that it is given up, with ``n_crashes``.
    """

    time_s: float
    memory_MB: float = 0.0
    n_attempts: int = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """Jobs that run together, with what they share.

    Parameters
    ----------
    limbs : mapping of limb name to Limb
        By :attr:`Job.limb_name`; empty for a solver that needs none.
    n_workers : int
        0 means one per core.
    plugin_files : sequence of Path
        One-file plugins that each worker loads before anything else.
    should_continue : callable
        Called before a job starts; if False, running jobs finish and no other starts.
    running : callable
        Called with the places of the jobs that are running whenever one starts.
    """

    solver: Solver
    jobs: Sequence[Job]
    limbs: Mapping[str, Limb]
    limits: Limits
    n_workers: int = 0
    plugin_files: Sequence[Path] = ()
    should_continue: Callable[[], bool] = lambda: True
    running: Callable[[Sequence[int]], None] = lambda indices: None


class Executor(Component[SettingsT]):
    """Runs jobs somewhere, and hands every result back to this process, which alone keeps them."""

    holds_limits: ClassVar[bool] = True
    """False where a job cannot be held to a memory limit; a study that asks for one is refused."""

    @abstractmethod
    def results(self, batch: Batch) -> Iterator[tuple[int, Simulation]]:
        """Yield the place and the simulation of each job as it comes, exactly one for each.

        A job that fails, hangs or ends its worker has a result too. When ``batch.should_continue()``
        turns false no further job is started, and those started are finished.

        Raises
        ------
        ExecutorError
            There is nowhere to run them.
        """

    def close(self) -> None:
        """End resources that batches share, such as worker processes.

        Called once a command ends, also by an error; a later batch starts it again.
        """
