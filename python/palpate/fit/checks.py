"""Checks of a fit before its first simulation: whether its plugins answer at the start."""

from collections.abc import Mapping

from palpate.domain import Response
from palpate.errors import PalpateError, StudyError
from palpate.fit.problem import Problem
from palpate.fit.running import Fit, first_asked
from palpate.fit.spot_term import term_of
from palpate.study.reading import Study


def check_fit(study: Study, measured: Mapping[str, Response], abscissae: Mapping[str, str]) -> None:
    """Ask the parametrisation for its inputs at a start, and the search for its first trials.

    Raises
    ------
    StudyError
        One of them raises, or answers what is not to be used.
    """
    terms = [term_of(study, spot, study.generalising, measured[spot], abscissae) for spot in study.spot_names]
    key = "parametrisation"
    try:
        problem = Problem(study, terms, lambda jobs: [], study.parametrisation, noise=study.noise)
        fit = Fit(problem, problem.point_of({}))
        for term in terms:
            problem.inputs(term.spot, fit.start)
        key = "search"
        first_asked(study.search, fit, study.seed)
    except PalpateError as error:
        raise StudyError(f"{study.place('fit', key)}: {error}") from error
