"""Components of the core, provided through the same hooks as those of plugins."""

from typing import TYPE_CHECKING

from palpate import hookimpl

if TYPE_CHECKING:
    from palpate.plugins.execution import Executor
    from palpate.plugins.interfaces import Sampler


@hookimpl
def palpate_samplers() -> "list[type[Sampler]]":
    """Provide the sampler of the paper and those that cover its box more evenly."""
    from palpate.stages.samplers import LatinHypercube, OptimisedLatinHypercube, Sobol

    return [LatinHypercube, OptimisedLatinHypercube, Sobol]


@hookimpl
def palpate_executors() -> "list[type[Executor]]":
    """Provide the executors of this machine."""
    from palpate.executors import InProcess, Processes

    return [InProcess, Processes]
