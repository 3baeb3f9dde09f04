"""Names for searches and parametrisations of a fit, and for its results."""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.domain import (
        channel_of as channel_of,
        weighed_phases as weighed_phases,
    )
    from palpate.fit.box import (
        Box as Box,
    )
    from palpate.fit.fitted import (
        Fitted as Fitted,
        inputs_at as inputs_at,
        job_of as job_of,
        relaxing_space as relaxing_space,
        relaxing_thetas as relaxing_thetas,
    )
    from palpate.fit.mesh_correction import (
        fine_run as fine_run,
    )
    from palpate.fit.parametrisation import (
        FRICTION as FRICTION,
        GAIN as GAIN,
        OFFSET as OFFSET,
        STIFFNESS as STIFFNESS,
        StandardParametrisation as StandardParametrisation,
        StandardSettings as StandardSettings,
    )
    from palpate.fit.problem import (
        Problem as Problem,
        Simulate as Simulate,
    )
    from palpate.fit.reported import (
        reported_fits as reported_fits,
    )
    from palpate.fit.running import (
        Fit as Fit,
    )
    from palpate.fit.searches import (
        BestSet as BestSet,
    )
    from palpate.fit.spot_term import (
        Correction as Correction,
        NotRankedError as NotRankedError,
        SpotTerm as SpotTerm,
        is_same_job as is_same_job,
        pieces as pieces,
        term_of as term_of,
    )
    from palpate.fit.stage import (
        Case as Case,
    )
    from palpate.limb.loading import (
        refinement as refinement,
    )
    from palpate.plugins.parametrisation import (
        Parametrisation as Parametrisation,
        SpotInputs as SpotInputs,
        at_spot as at_spot,
        for_each_spot as for_each_spot,
    )
    from palpate.plugins.search import (
        Evaluation as Evaluation,
        Search as Search,
        SearchSpace as SearchSpace,
        Trial as Trial,
        asking as asking,
    )
    from palpate.run.result import (
        ALL_SPOTS as ALL_SPOTS,
        DISAGREEMENTS as DISAGREEMENTS,
        IDENTIFIABILITY as IDENTIFIABILITY,
        INCLUDED as INCLUDED,
        LEVEL as LEVEL,
        RISE as RISE,
        UNSEEN as UNSEEN,
        UNSETTLED as UNSETTLED,
        CertaintyResult as CertaintyResult,
        FitResult as FitResult,
        IdentifiabilityResult as IdentifiabilityResult,
        PosteriorResult as PosteriorResult,
    )
    from palpate.stages.core_stages import (
        cases_of as cases_of,
    )
    from palpate.stages.identifiability import (
        UNCLEAR as UNCLEAR,
        WORDS as WORDS,
        Adequacy as Adequacy,
        share_of_range as share_of_range,
        word_of as word_of,
        worst_of as worst_of,
    )

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
    __dir__ = __getattr__("__dir__")
