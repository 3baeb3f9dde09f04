"""Reported values against true ones, and the verdict of the answer on each value of a table."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import polars as pl

from palpate.api import ParameterName
from palpate.api.fit import ALL_SPOTS, FIT, IN_FULL, REFUSED, TIED, UNCLEAR, Adequacy, mark_of, verdict_of
from palpate.api.report import rounded
from palpate_report.answer.model_verdict import model_verdict
from palpate_report.data.marks import Headline, with_unit
from palpate_report.data.report_data import ReportData


def missed_truth(data: ReportData, estimates: Sequence[Headline]) -> list[str]:
    """Each interval that does not hold the true value of simulated data, with that value."""
    return [
        f"{each.parameter}: true {with_unit(rounded(truth, each.lower, each.upper), each.unit)}, interval "
        f"{with_unit(each.interval, each.unit)}"
        for each in estimates
        if (truth := _truth(data, each)) is not None and each.interval and not _holds(each, truth)
    ]


def holds_truth(data: ReportData, estimates: Sequence[Headline]) -> bool:
    """True if every parameter has an interval and a true value, and the interval holds it."""
    known = [(each, _truth(data, each)) for each in estimates]
    return bool(known) and all(
        truth is not None and each.interval and _holds(each, truth) for each, truth in known
    )


def _truth(data: ReportData, value: Headline) -> float | None:
    return data.study.truth.get(ParameterName.parse(value.name).shared) if value.name else None


def _holds(value: Headline, truth: float) -> bool:
    assert value.lower is not None
    assert value.upper is not None
    return value.lower <= truth <= value.upper


def least_fopt(data: ReportData, estimates: Sequence[Headline]) -> str:
    """Sentence on the values of the least Fopt next to the reported ones; empty without 95 % intervals."""
    (row,) = data.leading_rows(data.fit.table).head(1).to_dicts() or [{}]
    texts = []
    for each in estimates:
        if each.level and row.get(each.name) is not None:
            least = replace(each, value=row[each.name])
            known = f"{each.text}, 95 % interval {each.interval}"
            inside = "" if least.is_in_interval else f", outside (reported {with_unit(known, each.unit)})"
            texts.append(f"{each.parameter} = {with_unit(least.text, each.unit)}{inside}")
    return f"The least Fopt, with the scenario's weights, is at {'; '.join(texts)}." if texts else ""


def between_spots(data: ReportData) -> str:
    """Sentence on spots that differ: spread and own values of each parameter; empty where none do."""
    rows = data.leading_rows(data.table("between_spots")).to_dicts()
    found = []
    for row in rows:
        unit, name = row["unit"], data.brief_name(row["parameter"])
        ends = {"lower": row["lower"], "upper": row["upper"]}
        text = str(Headline(parameter=name, unit=unit, value=row["sd"], **ends))
        same = data.fit.intervals.filter(scenario=row["scenario"], parameter=row["parameter"])
        own = sorted(same.filter(pl.col("fit") != row["fit"])["value"])
        found.append(text + (f", spots {with_unit(f'{own[0]:.3g} to {own[-1]:.3g}', unit)}" if own else ""))
    sd = "standard deviation between spots (95 % interval)"
    return f"they differ, {sd}: {'; '.join(found)}" if found else ""


# ----------------------------------------------------------------------- verdicts


class Verdicts:
    """Verdicts on each value of a run, of any fit and of the sweep.

    Attributes
    ----------
    model : ModelVerdict
        Of what is reported.
    found : mapping of (spot, scenario, whether it is a fit) to Best
    """

    def __init__(self, data: ReportData) -> None:
        self.data, self.model = data, model_verdict(data)
        self.found = {(b.spot, b.scenario, b.found == FIT): b for b in data.fits_and_sets}

    def at(self, spot: str, scenario: str, name: str, *, is_fit: bool, word: str | None = None) -> str:
        """Verdict on a parameter (full name) by what was found at a spot.

        Parameters
        ----------
        word : str, optional
            Its identifiability where the best sets do not have it.
        """
        best = self.found.get((spot, scenario, is_fit))
        model = self.model_at(spot, scenario, is_fit=is_fit)
        if model is Adequacy.FAILS:
            return REFUSED
        head = ParameterName.parse(name).shared
        if head in self.data.study.space.ties and head not in self.data.searched:
            return TIED
        value = next((each for each in best.values if each.name == head), None) if best else None
        if word is None:
            word = value.identifiability if value else UNCLEAR
        return verdict_of(word, at_bound=value is not None and value.at_bound, model=model)

    def model_at(self, spot: str, scenario: str, *, is_fit: bool) -> Adequacy:
        """Verdict on the model of what was found at a spot; one that is reported and fails takes all away."""
        best = self.found.get((spot, scenario, is_fit))
        if best is not None:
            return best.model
        return Adequacy.FAILS if self.model.failure else Adequacy.DESCRIBES


OF_FITS = ("table1_fit", "fit_mesh", "intervals", "between_spots", "posterior", "profile_ends", "fit")
"""Tables of parameters whose values are of fits."""

OF_SETS = ("table1_coefficients", "identifiability", "distance_to_truth", "generalised")
"""Those whose values are of the sweep, but for rows that state a fit as their ``search``."""


def with_verdicts(data: ReportData, tables: Mapping[str, pl.DataFrame]) -> dict[str, pl.DataFrame]:
    """Tables with a column ``verdict`` where they have values of parameters, and words in full."""
    verdicts = Verdicts(data)
    return {
        name: table.with_columns(IN_FULL)
        if name not in (*OF_FITS, *OF_SETS)
        else table.with_columns(
            IN_FULL,
            verdict=pl.Series(
                [_verdict(verdicts, name, row) for row in table.iter_rows(named=True)], dtype=pl.String
            ),
        )
        for name, table in tables.items()
    }


def _verdict(verdicts: Verdicts, table: str, row: Mapping[str, object]) -> str:
    """Verdict on the value of a row, or on each of its values that is no result."""
    data = verdicts.data
    is_fit = table in OF_FITS or row.get("search") in ("fit", "joint fit")
    spot = str(row.get("fit") or row.get("spot") or ALL_SPOTS)
    scenario = str(row.get("scenario") or data.generalising.name)
    if "parameter" in row:
        region = f"{row['region']}." if "region" in row else ""
        word = row.get("identifiability")
        return verdicts.at(
            spot,
            scenario,
            f"{region}{row['parameter']}",
            is_fit=is_fit,
            word=None if word is None else str(word),
        )
    if verdicts.model.failure:
        return REFUSED
    found = {p.name: verdicts.at(spot, scenario, name, is_fit=is_fit) for name, p in data.searched.items()}
    return "; ".join(f"{name} {verdict}" for name, verdict in found.items() if mark_of(verdict))


def draws_of(data: ReportData, scenario: str, most: int) -> pl.DataFrame:
    """Draws of the fit that leads, from its posterior or else from its normal density; else none."""
    for frame in (data.table("posterior_draws"), data.table("draws")):
        if not frame.is_empty():
            rows = frame.filter(pl.col("fit").is_in([data.together, ALL_SPOTS]), scenario=scenario)
            if not rows.is_empty():
                return rows.gather_every(-(-rows.height // most))
    return pl.DataFrame()
