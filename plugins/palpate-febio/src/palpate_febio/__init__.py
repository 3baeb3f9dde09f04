"""FEBio as a solver of palpate, and its decks as limbs."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from palpate.api import hookimpl

if TYPE_CHECKING:
    from palpate.api import LimbSource, Solver

__version__ = "0.1.0"


@hookimpl
def palpate_limb_sources() -> "Iterable[type[LimbSource]]":
    """``febio_deck``."""
    from palpate_febio.limb_source import FebioDeckSource

    return [FebioDeckSource]


@hookimpl
def palpate_solvers() -> "Iterable[type[Solver]]":
    """``febio``."""
    from palpate_febio.solver import FebioSolver

    return [FebioSolver]
