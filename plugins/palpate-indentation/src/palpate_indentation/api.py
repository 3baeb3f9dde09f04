"""Names that other plugins may import of palpate-indentation; each is imported when it is first used."""

from typing import TYPE_CHECKING

from palpate.api import deferred

if TYPE_CHECKING:
    from palpate_indentation.csv_loader import (
        FOREARM as FOREARM,
        HOMOGENEOUS as HOMOGENEOUS,
        CsvLoader as CsvLoader,
        CsvSettings as CsvSettings,
        CurveSettings as CurveSettings,
        read_curves as read_curves,
        units_of as units_of,
    )
    from palpate_indentation.measures import problem_of as problem_of

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
