"""The design of a study, new or from the folder of an earlier run."""

from dataclasses import replace

import polars as pl

from palpate.domain import Design, FloatArray
from palpate.errors import PalpateError, StudyError
from palpate.run.directory import RunDirectory
from palpate.run.ledger import Ledger
from palpate.sampling.drawing import draw_design, kept_sets
from palpate.study.reading import Study


def draw_study(study: Study, earlier: RunDirectory | None = None) -> Design:
    """Draw the parameter sets of a study.

    Parameters
    ----------
    earlier : RunDirectory, optional
        If its ranges were wider, its finished sets are the first of the design.

    Raises
    ------
    SamplingError
    StudyError
        The study has no sets, and its search needs a sweep.
    """
    if study.search.name == "sweep" and not (study.n_sets or study.n_total):
        raise StudyError(
            f"{study.place('sampling', 'n_sets')}: no set to choose from with fit.search = 'sweep'; give "
            "sets here or with --sets, or another search"
        )
    kept, first = _kept(study, earlier) if earlier else (None, None)
    design = draw_design(
        study.space,
        study.sampler,
        study.n_sets,
        study.seed,
        study.filters,
        max_draws=study.max_draws,
        n_total=study.n_total,
        kept=kept,
    )
    return replace(design, earlier_first=first) if design.n_kept else design


def _kept(study: Study, earlier: RunDirectory) -> tuple[FloatArray | None, FloatArray | None]:
    """Sets of an earlier design that this one begins with, and those that it was first drawn with."""
    try:
        design = earlier.design()
    except PalpateError:  # none yet, or corrupt: all sets are drawn as in a new folder
        return None, None
    with Ledger(earlier.folder) as ledger:
        sweep = ledger.sweep()
    finished = set(sweep["set_id"]) - set(sweep.filter(pl.col("state").is_null())["set_id"])
    kept = kept_sets(study.space, study.seed, design, finished)
    # First sets of an earlier design that are remembered: more than any solver has warm starts.
    return kept, design.first_values[:1024]
