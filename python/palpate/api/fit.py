"""What a fit searches, and how: parametrisations and searches."""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.plugins.parametrisation import (
        Parametrisation as Parametrisation,
        SpotInputs as SpotInputs,
        at_spot as at_spot,
        for_each_spot as for_each_spot,
    )
    from palpate.plugins.search import (
        Asking as Asking,
        Evaluation as Evaluation,
        Search as Search,
        SearchSpace as SearchSpace,
        Trial as Trial,
    )

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__getattr__("__all__")})
