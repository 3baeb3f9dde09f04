"""Components of the core, provided through the same hooks as components of plugins."""

from typing import TYPE_CHECKING

from palpate import hookimpl

if TYPE_CHECKING:
    from palpate.domain.indenter import Indenter
    from palpate.plugins.execution import Executor
    from palpate.plugins.interfaces import Sampler
    from palpate.plugins.motion import Motion
    from palpate.plugins.parametrisation import Parametrisation
    from palpate.plugins.score import Score
    from palpate.plugins.search import Search
    from palpate.stages.stage import Stage


@hookimpl
def palpate_indenters() -> "list[type[Indenter]]":
    """Provide the indenter of the paper."""
    from palpate.domain.indenter import Sphere

    return [Sphere]


@hookimpl
def palpate_motions() -> "list[type[Motion]]":
    """Provide the motion of the paper."""
    from palpate.plugins.motion import PressAndTwist

    return [PressAndTwist]


@hookimpl
def palpate_samplers() -> "list[type[Sampler]]":
    """Provide the sampler of the paper and those that cover its box more evenly."""
    from palpate.sampling.samplers import LatinHypercube, OptimisedLatinHypercube, Sobol

    return [LatinHypercube, OptimisedLatinHypercube, Sobol]


@hookimpl
def palpate_scores() -> "list[type[Score]]":
    """Provide the score of the paper."""
    from palpate.plugins.score import Nmse

    return [Nmse]


@hookimpl
def palpate_executors() -> "list[type[Executor]]":
    """Provide the executors of this machine."""
    from palpate.executors import InProcess, Processes

    return [InProcess, Processes]


@hookimpl
def palpate_parametrisations() -> "list[type[Parametrisation]]":
    """Provide what a study searches by itself."""
    from palpate.fit.parametrisation import StandardParametrisation

    return [StandardParametrisation]


@hookimpl
def palpate_searches() -> "list[type[Search]]":
    """Provide least squares, a global search, and the paper's choice among the sets of the sweep."""
    from palpate.fit.least_squares import LeastSquares
    from palpate.fit.searches import BestSet, DifferentialEvolution

    return [LeastSquares, BestSet, DifferentialEvolution]


@hookimpl
def palpate_stages() -> "list[type[Stage]]":
    """Provide the stages of the paper."""
    from palpate.stages.core_stages import STAGES

    return list(STAGES)
