"""FEBio as a solver of palpate, decks as limbs, and a certificate that two solvers agree."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import palpate
from palpate.interfaces import LimbSource, Solver

if TYPE_CHECKING:
    import typer

__version__ = "0.1.0"


@palpate.hookimpl
def palpate_limb_sources() -> Iterable[type[LimbSource]]:
    """``febio_deck``."""
    from palpate_febio.limb_source import FebioDeckSource

    return [FebioDeckSource]


@palpate.hookimpl
def palpate_solvers() -> Iterable[type[Solver]]:
    """``febio``."""
    from palpate_febio.solver import FebioSolver

    return [FebioSolver]


@palpate.hookimpl
def palpate_commands(app: "typer.Typer") -> None:
    """``certify``, ``friction-memory``, ``febio-deck`` and ``febio-prove``."""
    from palpate_febio.certify import certify
    from palpate_febio.deck_command import febio_deck
    from palpate_febio.friction_command import friction_memory
    from palpate_febio.prove_command import febio_prove

    app.command()(certify)
    app.command(name="febio-deck")(febio_deck)
    app.command(name="friction-memory")(friction_memory)
    app.command(name="febio-prove")(febio_prove)
