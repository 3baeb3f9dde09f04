"""Names that other plugins may import of palpate-febio; each is imported when it is first used."""

from typing import TYPE_CHECKING

from palpate.api import deferred

if TYPE_CHECKING:
    from palpate_febio.conventions import (
        COMPONENTS as COMPONENTS,
        TOLERANCE as TOLERANCE,
        probe_theta as probe_theta,
    )
    from palpate_febio.solver import FebioSolver as FebioSolver

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
