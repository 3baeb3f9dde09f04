"""Dask as a place where simulations run."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from palpate.api import hookimpl

if TYPE_CHECKING:
    from palpate.api.executors import Executor

__version__ = "0.1.0"


@hookimpl
def palpate_executors() -> "Iterable[type[Executor]]":
    """``dask``."""
    from palpate_dask.executor import DaskExecutor

    return [DaskExecutor]
