"""Dask as a place where simulations run."""

from collections.abc import Iterable

import palpate
from palpate.interfaces import Executor

__version__ = "0.1.0"


@palpate.hookimpl
def palpate_executors() -> Iterable[type[Executor]]:
    """``dask``."""
    from palpate_dask.executor import DaskExecutor

    return [DaskExecutor]
