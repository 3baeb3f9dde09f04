"""The solvers that come with palpate: embedded finite elements, and homogeneous tests."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from palpate.api import hookimpl

if TYPE_CHECKING:
    from palpate.api import Channel, Solver

__version__ = "0.1.0"


@hookimpl
def palpate_channels() -> "Iterable[Channel]":
    """Channels of the homogeneous tests; force and torque belong to the forearm study."""
    from palpate_jax.homogeneous import CHANNELS

    return CHANNELS


@hookimpl
def palpate_solvers() -> "Iterable[type[Solver]]":
    """``jax`` and ``homogeneous``."""
    from palpate_jax.homogeneous import HomogeneousSolver
    from palpate_jax.solver import JaxSolver

    return [JaxSolver, HomogeneousSolver]
