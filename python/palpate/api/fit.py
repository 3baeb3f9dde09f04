"""Names for searches and parametrisations of a fit, and for its results."""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.answer.moduli import (
        MODULI as MODULI,
        every_value as every_value,
        initial_moduli as initial_moduli,
        names_of_moduli as names_of_moduli,
    )
    from palpate.answer.table import (
        FIT as FIT,
        IN_FULL as IN_FULL,
        MODULUS as MODULUS,
        PARAMETER as PARAMETER,
        Results as Results,
        answer_table as answer_table,
        searched_parameters as searched_parameters,
    )
    from palpate.answer.words import (
        EFFECTIVE as EFFECTIVE,
        OTHER_RATE as OTHER_RATE,
        REFUSED as REFUSED,
        TIED as TIED,
        UNCLEAR as UNCLEAR,
        WORDS as WORDS,
        Adequacy as Adequacy,
        explained as explained,
        mark_of as mark_of,
        share_of_range as share_of_range,
        verdict_of as verdict_of,
        word_of as word_of,
        worst_of as worst_of,
    )
    from palpate.domain import channel_of as channel_of, weighed_phases as weighed_phases
    from palpate.domain.thresholds import THRESHOLDS as THRESHOLDS
    from palpate.fit.alike import (
        changed_like as changed_like,
        correction_like as correction_like,
        path_of as path_of,
    )
    from palpate.fit.bounded import linear_least as linear_least
    from palpate.fit.box import Box as Box
    from palpate.fit.fitted import (
        Fitted as Fitted,
        inputs_at as inputs_at,
        job_of as job_of,
        relaxing_space as relaxing_space,
        relaxing_thetas as relaxing_thetas,
    )
    from palpate.fit.mesh_correction import MOVED_ERROR as MOVED_ERROR, fine_run as fine_run
    from palpate.fit.parametrisation import (
        GAIN as GAIN,
        OFFSET as OFFSET,
        STIFFNESS as STIFFNESS,
        StandardParametrisation as StandardParametrisation,
        StandardSettings as StandardSettings,
    )
    from palpate.fit.problem import Problem as Problem, Simulate as Simulate
    from palpate.fit.reported import reported_fits as reported_fits
    from palpate.fit.running import Fit as Fit
    from palpate.fit.searches import BestSet as BestSet
    from palpate.fit.spot_term import (
        Correction as Correction,
        NotRankedError as NotRankedError,
        SpotTerm as SpotTerm,
        is_same_job as is_same_job,
        pieces as pieces,
        term_of as term_of,
    )
    from palpate.fit.stage import Case as Case
    from palpate.limb.loading import refinement as refinement
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
        INCLUDED as INCLUDED,
        LEVEL as LEVEL,
        RISE as RISE,
        UNSEEN as UNSEEN,
        UNSETTLED as UNSETTLED,
        WIDENED as WIDENED,
        FitResult as FitResult,
    )
    from palpate.stages.core_stages import cases_of as cases_of

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
    __dir__ = __getattr__("__dir__")
