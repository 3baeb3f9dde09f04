"""Sections on the fits: curves, warnings, every value, and the ways of the searches."""

from collections.abc import Iterator, Sequence
from typing import Any

import polars as pl

from palpate.api.fit import ALL_SPOTS, initial_moduli
from palpate.api.report import (
    Block,
    Cell,
    Choice,
    Fold,
    Lines,
    Listing,
    Paragraph,
    ReportWarning,
    Section,
    Table,
    Word,
    rounded,
)
from palpate.api.runs import file_name
from palpate_report.answer.card import IN_THE_OPEN, quality
from palpate_report.answer.law import searched_laws
from palpate_report.answer.material import material_curves, rows_of
from palpate_report.answer.result import Report
from palpate_report.answer.warnings import kinds
from palpate_report.data.best import Best
from palpate_report.data.marks import Headline, in_words, with_unit
from palpate_report.data.report_data import ReportData
from palpate_report.data.tables import TITLES, printed
from palpate_report.sections.tables import picture


class Curves(Section):
    """Small multiples of all spots."""

    name, title, entry = "curves", "Measured and simulated curves", "Curves"
    summary = "measured and simulated curves of all spots, and the residuals"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show curves with what they miss below."""
        yield Paragraph(
            "Lower panels: residuals, simulated − measured. Shading, if any: ±1 standard deviation of "
            "repeated measurements."
        )
        label = "Measured and simulated curves at {}; the errors are under Values"
        every = {
            spot: list(picture(report, f"response_{file_name(spot)}", label.format(spot)))
            for spot in data.spots
        }
        if len(every) == 1 or not any(every.values()):
            yield from (block for blocks in every.values() for block in blocks)
            return
        of_all = list(picture(report, "generalised", label.format("every spot, with the joint fit")))
        options = {"all spots": of_all, **every}
        yield Choice("Spot", [Fold(spot, blocks) for spot, blocks in options.items() if blocks])

    def result(self, data: ReportData, report: Report) -> str:
        """R² of each fitted channel."""
        return quality(data)

    def is_open(self, data: ReportData, report: Report) -> bool:
        """Always."""
        return True


class Warnings(Section):
    """All that limits the result."""

    name, title = "warnings", "Warnings"
    summary = "limits of the result, the most severe first"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """List the warnings that the first screen has no room for, and the notes on other scenarios."""
        warnings, notes = report.conclusion.warnings, report.conclusion.notes
        if more := warnings[IN_THE_OPEN:]:
            yield _listing(more)
        if notes:
            yield Fold(f"Notes on scenarios that are not reported ({len(notes)})", [_listing(notes)])
        codes = dict.fromkeys(each.code for each in (*warnings, *notes) if each.code)
        if codes:
            explained = Listing([(f"{code}:", " ".join(kinds()[code].values())) for code in codes])
            yield Fold("Explanation of the codes", [explained])

    def result(self, data: ReportData, report: Report) -> str:
        """Number of warnings and of notes."""
        conclusion = report.conclusion
        counts = {"warning": len(conclusion.warnings), "note": len(conclusion.notes)}
        return ", ".join(f"{n} {word}{'s' if n > 1 else ''}" for word, n in counts.items() if n)


def _listing(warnings: Sequence[ReportWarning]) -> Listing:
    codes = (f" [{warning.code}]" if warning.code else "" for warning in warnings)
    return Listing(
        [(f"{each.what}.", f"{each.why}{code}") for each, code in zip(warnings, codes, strict=True)]
    )


class Values(Section):
    """The numbers behind the first picture."""

    name, title, entry = "values", "Values by spot and scenario", "Values"
    summary = "every value with its interval, by spot and scenario"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show what leads, then every best set."""
        conclusion = report.conclusion
        if conclusion.lead and not conclusion.failure:
            yield Paragraph(conclusion.lead)
        names = [data.generalising.name, *(s.name for s in data.study.scenarios)]
        every = {name: [best for best in conclusion.bests if best.scenario == name] for name in names}
        options = [
            Fold(f"{name}: {bests[0].fitted_to}", [_by_spot(data, bests)])
            for name, bests in every.items()
            if bests
        ]
        if len(options) == 1:
            yield from options[0].blocks
        elif options:
            yield Choice("Scenario", options)
        if "distance_to_truth" in report.tables:
            yield Paragraph("Distance of every fit to the true values: tables/distance_to_truth.csv.")

    def result(self, data: ReportData, report: Report) -> str:
        """Moduli of what leads."""
        return "; ".join(
            f"{each.parameter} {with_unit(each.text, each.unit)}" for each in report.conclusion.moduli
        )


class Fits(Section):
    """Effect of the meshes, and ends of the searches."""

    name, title, entry = "fit", "Search and mesh correction", "Fit"
    summary = "the values by coarse and by finer meshes, Fopt of each channel, and every fit"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show what the meshes do, and every fit."""
        if data.fit.table.is_empty():
            return
        if "fit_mesh" in report.tables:
            yield Paragraph(
                "Values of the least Fopt from the coarse meshes alone, and after correction by finer "
                "meshes, which extrapolate the curves to zero element size."
            )
            rows = report.tables["fit_mesh"].filter(scenario=data.generalising.name)
            rows = rows.with_columns(
                pl.col("parameter").map_elements(data.brief_name, return_dtype=pl.String)
            )
            yield Table.of(TITLES["fit_mesh"], printed("fit_mesh", rows))
        yield Paragraph(
            "Errors of each fit, and the reason for its end: tables/table2_fit.csv and tables/fit.csv."
        )

    def result(self, data: ReportData, report: Report) -> str:
        """Number of simulations."""
        return report.conclusion.spent.removesuffix(".")


class MaterialItself(Section):
    """Stress of the fits."""

    name, title, entry = "material", "Stress-strain curves", "Material"
    summary = "stress over stretch of the fitted material, with its 95 % band"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Draw the stress of each region, and list some of it."""
        if report.conclusion.failure:
            return
        curves = list(material_curves(data, data.generalising.name))
        if not curves:
            return
        yield Paragraph(
            "Nominal stress of the fitted law at constant volume. The band holds 95 % of the draws of the "
            "fit. Beyond the stretch reached in the experiment, the curve is an extrapolation by the law."
        )
        yield from picture(
            report, "stress_strain", "Stress over stretch of the fitted material, with its 95 % band"
        )
        rows = [row for each in curves for row in rows_of(each, data.together)]
        heads = ["region", "stress", "at", f"value ({data.modulus_unit})", "lower", "upper"]
        if len({region for region, *_ in rows}) == 1:
            heads, rows = heads[1:], [row[1:] for row in rows]
        numeric = frozenset(range(len(heads) - 3, len(heads)))
        yield Table(f"Nominal stress of the fit to {data.together}", heads, rows, numeric=numeric)

    def result(self, data: ReportData, report: Report) -> str:
        """Names of the searched laws."""
        return " and ".join(searched_laws(data.study.space))


# ------------------------------------------------------------------- values


def _cell(value: Headline) -> Lines:
    lines: list[Any] = [value.text]
    if value.interval:
        if value.optimum is not None:
            lines.append(f"optimum {rounded(value.optimum, value.lower, value.upper)}")
        lines.append(value.interval)
    return Lines([*lines, *map(Word, filter(None, value.verdict.split(", ")))])


def _by_spot(data: ReportData, bests: Sequence[Best]) -> Table:
    """Values of one scenario, parameter by spot; the joint fit comes first."""
    truth = data.study.truth
    known: list[Cell] = [None] if truth else []
    rows: list[list[Cell]] = []
    for values in zip(*(best.values for best in bests), strict=True):
        of_truth = [truth.get(values[0].name)] if truth else []
        rows.append([values[0].label, *(_cell(value) for value in values), *of_truth])
    rows += [[label, *values] for label, values in _moduli(data, bests)]
    mean, least = ("", "") if bests[0].spot != ALL_SPOTS else (" (all spots: mean)", " (all spots: least)")
    rows.append([f"Fopt{mean}", *(best.fopt for best in bests), *known])
    rows.append([f"least Fopt of the search{mean}", *(best.fopt_least for best in bests), *known])
    for channel in data.measured_channels:
        rows.append([f"R² {in_words(channel)}{least}", *(best.r2[channel] for best in bests), *known])
    rows.append(["found by", *(best.found for best in bests), *([""] if truth else [])])
    is_sure = any(value.level for best in bests for value in best.values)
    below = "its 95 % interval" if is_sure else "the fitted optimum, and the range that fits about as well"
    return Table(
        f"The fit to {bests[0].fitted_to} (scenario {bests[0].scenario}); below each value {below}",
        ["parameter", *(best.spot for best in bests), *(["true value"] if truth else [])],
        rows,
        numeric=frozenset(range(1, 1 + len(bests) + bool(truth))),
    )


def _moduli(data: ReportData, bests: Sequence[Best]) -> Iterator[tuple[str, list[Cell]]]:
    """Rows of the initial moduli of each best set, and of the true value if there is one."""
    columns: list[dict[str, Cell]] = [{each.parameter: _cell(each) for each in best.moduli} for best in bests]
    if truth := data.study.truth:
        known = initial_moduli(data.study.space, truth, data.factors, data.modulus_unit)
        columns.append({name: rounded(value) for name, value in known})
    for name in dict.fromkeys(name for column in columns for name in column):
        yield f"{name} ({data.modulus_unit})", [column.get(name) for column in columns]
