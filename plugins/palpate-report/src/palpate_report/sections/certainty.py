"""Sections on how sure the parameters are: by intervals of the fit, posteriors, and sets of the sweep."""

from collections.abc import Iterator
from dataclasses import replace

import polars as pl

from palpate.api.fit import verdict_of
from palpate.api.report import Block, Fold, Listing, Paragraph, Section, Table, heading
from palpate_report.answer.card import causes
from palpate_report.answer.result import Report
from palpate_report.data.report_data import ReportData
from palpate_report.data.tables import TITLES, printed
from palpate_report.sections.tables import picture, tables


class Certainty(Section):
    """Intervals of the fit and their causes."""

    name, title, entry = "certainty", "Sources of the intervals", "Certainty"
    summary = "causes of the 95 % intervals, and combinations of parameters that are known better"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show the causes of what leads, then every interval."""
        if "intervals" not in report.tables:
            return
        yield Paragraph(
            "If the error budget is right, 95 of 100 such intervals contain the true value. "
            "Contribution of each error source:"
        )
        yield from picture(
            report, "causes", "Error sources of each interval; the shares are in tables/budget.csv"
        )
        if "inadequate" in report.tables:
            failed = report.tables["inadequate"].drop(
                "probability", "verdict", "r2", "explained_by", "visible", strict=False
            )
            yield Table.of(TITLES["inadequate"], failed)
        yield from tables(report, "between_spots")
        yield Paragraph(
            "Intervals, better-known combinations of parameters, and error sources of every fit: "
            "tables/intervals.csv, tables/parameter_combinations.csv and tables/budget.csv."
        )
        if "posterior" in report.tables:
            found = tables(report, "posterior", "profile_ends", "volumes", "emulator")
            if not data.table("sobol_indices").is_empty():
                yield Paragraph(
                    "Which parameter controls which part of the curve: first-order Sobol index over the "
                    "search ranges, along the path."
                )
            yield from picture(report, "sobol_indices", "First-order Sobol indices along the path")
            label = "Profiles of the parameters; their ends are in the table of posteriors"
            yield Fold(
                "Posteriors of the joint fits, by an emulator of the curves",
                [*picture(report, "profiles", label), *found],
            )

    def result(self, data: ReportData, report: Report) -> str:
        """The widest interval and its largest causes."""
        return "" if report.conclusion.failure else causes(data)


class Identifiability(Section):
    """Section on the values that the sets of the sweep allow."""

    name, title, entry = "identifiability", "Identifiability by the sweep", "Identifiability"
    summary = "values with which sets of the sweep fit about as well as the best"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show the intervals of the scenario that generalises, then the intervals of the others."""
        if "identifiability" not in report.tables or not data.design.n_sets or data.widened:
            return  # the sweep knows nothing of the wider ranges
        yield Paragraph(
            "Interval: values for which, with the other parameters refitted, Fopt stays below twice its "
            "minimum. A larger limit applies if the measured scatter, or the error of the emulator, allows "
            "more. An emulator of the sweep's curves gives Fopt; its minimum is the fitted optimum."
        )
        is_sure = any(each.level for each in report.conclusion.estimates)
        if is_sure:
            yield Paragraph(
                "Judge a parameter by its 95 % interval of the fit, which has the whole error budget. These "
                "ranges do not have it."
            )
        else:
            yield Paragraph(
                "Words by interval over range: up to 10 % well, up to 30 % roughly, up to 80 % poorly, above "
                "not identified. Unclear: too few sets, or curves that the slopes do not predict."
            )
            yield Listing([("", sentence) for sentence in report.conclusion.identifiability])
        every = report.tables["identifiability"]
        hidden = WORDS if is_sure else ()
        shown = every.select(name for name in COLUMNS if name in every.columns and name not in hidden)
        main, is_main = data.generalising.name, pl.col("scenario") == data.generalising.name
        yield _table(f"Intervals in scenario {main}", shown.filter(is_main))
        others = shown.filter(~is_main)
        if others.height:
            yield Fold("The other scenarios", [_table("Intervals in the other scenarios", others)])


WORDS = ("identifiability", "verdict")
COLUMNS = (
    *("parameter", "spot", "scenario", "unit", "value", "optimum", "lower", "upper", "relative_width"),
    *(*WORDS, "most_correlated_with", "correlation", "n_as_good"),
)
"""Of the table of the sweep's intervals."""


HEADS = {"value": "best set", "optimum": "fitted optimum", "n_as_good": "sets as good"}


def _table(caption: str, frame: pl.DataFrame) -> Table:
    rows = printed("identifiability", frame)
    if "identifiability" in rows.columns:
        words = pl.col("identifiability").map_elements(verdict_of, return_dtype=pl.String)
        rows = rows.with_columns(words)
    return replace(Table.of(caption, rows), columns=[HEADS.get(name, heading(name)) for name in rows.columns])
