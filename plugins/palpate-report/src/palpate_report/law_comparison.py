"""Material laws fitted to the curves of one study, ranked by AICc and by the error of held-out curves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from palpate.api import PalpateError, Progress, StudyError, about
from palpate.api.cli import Session, newest_run, run_folder
from palpate.api.executors import StoppedError
from palpate.api.fit import Adequacy, channel_of, initial_moduli, names_of_moduli
from palpate.api.runs import (
    Ledger,
    RunDirectory,
    Study,
    check_study,
    parts_of,
    read_run,
    run_stage,
    run_study,
)
from palpate_report import comparison, from_run, law_studies
from palpate_report.answer.model_verdict import model_verdict
from palpate_report.data.display_units import in_display_units
from palpate_report.data.report_data import ReportData
from palpate_report.law_studies import VALIDATE, Stiffness

FITTED = "fitted"
"""Status of a law that has a result."""

VERBS = {
    Adequacy.DESCRIBES: "describes",
    Adequacy.APPROXIMATES: "approximates",
    Adequacy.FAILS: "comes closest to",
}
"""What a law that is the best of several does to the curves."""


@dataclass(slots=True, kw_only=True)
class LawFits:
    """Laws of a comparison: results of each that could be fitted, its run, and what is said of the others.

    Attributes
    ----------
    held_out : mapping of law to float
        Root mean square over held-out curves of their differences from the prediction, over their peaks.
    status : mapping of law to str
        Of each law, in the order of the comparison.
    """

    data: dict[str, ReportData] = field(default_factory=dict)
    folders: dict[str, Path] = field(default_factory=dict)
    held_out: dict[str, float] = field(default_factory=dict)
    status: dict[str, str] = field(default_factory=dict)


def compare_laws(
    session: Session, path: Path, words: str, region: str | None, into: Path, progress: Progress
) -> dict[str, Any]:
    """Fit laws to the curves of a study; return tables, notes and files as `write_comparison` does.

    The study itself is fitted first: the moduli that it finds set the ranges of the other laws.

    Raises
    ------
    StudyError
        The study cannot be fitted, or no law can.
    """
    base = session.study(path)
    laws = law_studies.laws_of(words, session.plugins)
    chosen = law_studies.region_of(base, region)
    folder = newest_run(path) or run_folder(base, None)
    first = fitted(session, base, folder, progress)
    fits, studies = LawFits(), {}
    known = stiffness(first, chosen.region)
    n_others = len(base.space.parameters) - len(base.space.columns_of(chosen.region))
    for law in laws:
        too_many = _too_many(first, law_studies.n_searched(law, known) + n_others)
        fits.status[law.title] = too_many or FITTED
        if law.material == chosen.material:
            studies[law.title], fits.status[law.title] = (base, folder), FITTED
        elif not too_many:
            study = session.study(law_studies.write_law_study(base, chosen, law, known))
            studies[law.title] = study, run_folder(study, None)
    session.note(_cost(session, [study for study, _ in studies.values() if study is not base], folder))
    for name, (study, run) in studies.items():
        try:
            data = first if study is base else fitted(session, study, run, progress)
            if not data.fit.table.is_empty() and data.fit.ends.is_empty():
                raise StudyError("left out: its fit has no result; see the warnings of its run")
            fits.data[name], fits.folders[name] = in_display_units(data), run
            fits.held_out[name] = held_out_error(session, study, run, progress)
        except StoppedError:
            raise
        except PalpateError as error:
            if name not in fits.data:
                fits.status[name] = str(error).splitlines()[0]
    if not fits.data:
        raise StudyError(f"{path}: no law could be fitted: {'; '.join(fits.status.values())}")
    table = ranked(fits, comparison.comparison_tables(fits.data).get("criteria", pl.DataFrame()))
    return comparison.write_comparison(fits.data, into, {"laws": table}, conclusion(table))


def fitted(session: Session, study: Study, folder: Path, progress: Progress) -> ReportData:
    """Results of a study whose stages up to the intervals are run, or continued; without pictures."""
    pictures = ("contours", "identifiability", "surface", "report")  # they decide nothing of a comparison
    run_study(study, folder, session.plugins, progress, without=pictures)
    return from_run.read_results(study, folder, session.plugins, progress)


def held_out_error(session: Session, study: Study, folder: Path, progress: Progress) -> float:
    """Root mean square error of the curves held out in turn, over their peaks; a PalpateError without any."""
    run = read_run(study, RunDirectory(folder), session.plugins, is_copy=False)
    table = run.current("held_out")
    if table.is_empty():
        table = run_stage(VALIDATE, study, folder, session.plugins, progress).table("held_out", VALIDATE)
    if table.is_empty():
        raise StudyError(f"{folder}: one curve alone cannot be held out")
    return float(np.sqrt(np.mean(table["difference"].to_numpy() ** 2)))


def stiffness(data: ReportData, region: str) -> Stiffness:
    """Initial moduli that a run has found for a region, with its largest measured invariant.

    A StudyError where it has found none.
    """
    space, row = data.study.space, {e.name: e.value for e in data.lead.values} if data.lead else {}
    moduli = dict(initial_moduli(space, row, data.factors, "MPa")) if row else {}
    names = names_of_moduli(space, region)
    if names[0] not in moduli:
        raise StudyError(
            f"{data.study.file}: no initial moduli of '{region}' were found; fit an isotropic law"
        )
    shear, young = (moduli[name] for name in names)
    modes: dict[str, Any] = {}
    for spot in data.spots if data.study.protocol is None else ():
        for name, curve in data.measured[spot].curves.items():
            modes[name] = [*modes.get(name, ()), *curve.abscissa]
    return Stiffness(
        shear_MPa=shear,
        bulk_MPa=shear * young / (3.0 * (3.0 * shear - young)),
        invariant=law_studies.largest_invariant(modes),
    )


def _too_many(data: ReportData, n_searched: int) -> str:
    """Reason why the curves hold too few points for so many parameters; empty where they do not."""
    channels = set(map(channel_of, data.generalising.weighed))
    curves = (data.measured[spot].curves.items() for spot in data.spots)
    points = sum(curve.ordinate.size for each in curves for name, curve in each if name in channels)
    needed = comparison.FEWEST_POINTS * n_searched
    if points >= needed:
        return ""
    return f"left out: {n_searched} parameters need {needed} points, and the curves have {points}"


def _cost(session: Session, studies: Sequence[Study], timed: Path) -> str:
    """Sentence on the simulations to come, by the time of a run that has ended."""
    n = sum(
        part.n
        for study in studies
        for part in parts_of(study, check_study(study, session.plugins), session.plugins)
    )
    with Ledger(timed) as ledger:
        seconds = ledger.frame()["seconds"].mean()
    each = float(seconds) if isinstance(seconds, (int, float)) else 0.0
    return f"{len(studies)} laws, about {n} simulations: {about(n * each)} on one core"


# ------------------------------------------------------------------------- ranking


def ranked(fits: LawFits, criteria: pl.DataFrame) -> pl.DataFrame:
    """One row for each law, the least AICc first: its criteria, its error of held-out curves, its verdict."""
    of_run = {row["run"]: row for row in criteria.iter_rows(named=True)}
    rows = []
    for law, status in fits.status.items():
        data = fits.data.get(law)
        found = of_run.get(law, dict[str, Any]())
        rows.append(
            {
                "law": law,
                "n_parameters": found.get("n_parameters"),
                "difference_aicc": found.get("difference"),
                "meaning": found.get("meaning"),
                "held_out": fits.held_out.get(law),
                "model": str(model_verdict(data).verdict) if data else None,
                "run": str(fits.folders.get(law, "")),
                "status": status,
            }
        )
    frame = pl.DataFrame(rows, infer_schema_length=None)
    numbers, texts = ("difference_aicc", "held_out"), ("meaning", "model")
    frame = frame.with_columns(pl.col(numbers).cast(pl.Float64), pl.col(texts).cast(pl.String))
    return frame.sort("difference_aicc", "held_out", nulls_last=True, maintain_order=True)


def conclusion(table: pl.DataFrame) -> str:
    """Sentence on which law describes the curves best, by AICc and by held-out curves."""
    rows = [row for row in table.iter_rows(named=True) if row["status"] == FITTED]
    held = [row for row in rows if row["held_out"] is not None]
    by_held = min(held, key=lambda row: float(row["held_out"]), default=None)
    compared = [row for row in rows if row["difference_aicc"] is not None]
    enough = [row for row in compared if row["meaning"] != comparison.TOO_FEW]
    if len(rows) == 1:
        text = f"{rows[0]['law']} is the only law that could be fitted"
        best = rows[0]
    elif enough:
        best = enough[0]
        text = _by_criterion(enough)
    elif by_held is not None:
        best = by_held
        why = "the curves have too few independent points for AICc"
        text = f"{best['law']} predicts held-out curves best; {why}"
    else:
        return "No law can be chosen: the curves have too few independent points, and none can be held out."
    if best["held_out"] is not None:
        text += f", held-out error {_percent(best['held_out'])}"
    text += "."
    if by_held is not None and by_held is not best:
        text += f" {by_held['law']} predicts held-out curves best, to {_percent(by_held['held_out'])}."
    if enough and (lower := compared[: compared.index(best)]):
        why = "with too few independent points for so many parameters"
        text += f" {_names(lower)} would have a lower AICc, {why}."
    if best["model"] == Adequacy.FAILS:
        text += f" Even {best['law']} does not describe the curves."
    return text


def _by_criterion(rows: Sequence[Mapping[str, Any]]) -> str:
    first, *others = rows
    behind = [row["difference_aicc"] - first["difference_aicc"] for row in others]
    close = [row for row, by in zip(others, behind, strict=True) if by <= comparison.CLOSE]
    if close:
        return f"{_names([first, *close])} are equally good for these curves by AICc"
    best = "" if first["model"] == Adequacy.FAILS else " best"
    text = f"{first['law']} {VERBS[Adequacy(first['model'])]} these curves{best}"
    return f"{text}: AICc {behind[0]:.0f} lower than {others[0]['law']}" if others else text


def _names(rows: Sequence[Mapping[str, Any]]) -> str:
    *names, last = [str(row["law"]) for row in rows]
    return f"{', '.join(names)} and {last}" if names else last


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %"
