"""What a fit searches, and how: parametrisations and searches."""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.domain import (
        channel_of as channel_of,
    )
    from palpate.fit.fitted import (
        Fitted as Fitted,
        inputs_at as inputs_at,
        job_of as job_of,
    )
    from palpate.fit.parametrisation import (
        FRICTION as FRICTION,
    )
    from palpate.fit.problem import (
        Problem as Problem,
        Simulate as Simulate,
    )
    from palpate.fit.running import (
        Fit as Fit,
    )
    from palpate.fit.spot_term import (
        Correction as Correction,
        SpotTerm as SpotTerm,
        pieces as pieces,
        term_of as term_of,
    )
    from palpate.fit.tables import (
        ORDER as ORDER,
    )
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
    from palpate.run.result import (
        LEVEL as LEVEL,
        FitResult as FitResult,
        PosteriorResult as PosteriorResult,
    )

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__getattr__("__all__")})
