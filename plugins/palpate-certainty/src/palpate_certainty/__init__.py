"""How certain identified parameters are: intervals, their causes, posteriors, and what a sweep allows."""

from typing import TYPE_CHECKING

from palpate.api import hookimpl

if TYPE_CHECKING:
    from palpate.api import Stage

__version__ = "0.1.0"


@hookimpl
def palpate_stages() -> "list[type[Stage]]":
    """``intervals``, ``certainty`` and ``identifiability``."""
    from palpate_certainty.stages import Identifiability, Intervals, Posteriors

    return [Intervals, Posteriors, Identifiability]
