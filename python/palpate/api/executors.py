"""Executors of simulations, their pools of processes, and one attempt at a job."""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.errors import ExecutorError as ExecutorError, StoppedError as StoppedError
    from palpate.executors import (
        Batch as Batch,
        Limits as Limits,
        Pool as Pool,
        attempt as attempt,
        n_cores as n_cores,
    )
    from palpate.executors.attempts import simulate_alone as simulate_alone
    from palpate.executors.pool import packed_or_refused as packed_or_refused
    from palpate.executors.worker import packed as packed
    from palpate.plugins.execution import Executor as Executor

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
    __dir__ = __getattr__("__dir__")
