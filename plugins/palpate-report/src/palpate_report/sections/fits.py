"""Sections on the fits: curves, warnings, every value, and the ways of the searches."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from palpate.api.fit import ALL_SPOTS
from palpate.api.report import (
    Block,
    Cell,
    Fold,
    Heading,
    Lines,
    Listing,
    Paragraph,
    ReportWarning,
    Section,
    Table,
    Word,
)
from palpate.api.runs import file_name
from palpate_report.answer.best_sets import Best, initial_moduli
from palpate_report.answer.headline import MODULI
from palpate_report.answer.material import material_curves, rows_of
from palpate_report.answer.result import Report
from palpate_report.data.marks import Headline
from palpate_report.data.report_data import ReportData
from palpate_report.data.tables import TITLES, printed
from palpate_report.sections.tables import picture, tables


class Curves(Section):
    """Small multiples of all spots."""

    name, title, entry = "curves", "Measured and simulated curves", "Curves"
    summary = "measured and simulated curves of all spots, and the residuals"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show curves with what they miss below."""
        yield Paragraph(
            "Lower panels: residuals, simulated − measured. The shaded band is one standard deviation of "
            "the measured presses to each side, where there is one."
        )
        for spot in data.spots:
            if len(data.spots) > 1:
                yield Heading(f"Spot {spot}")
            label = f"Measured and simulated curves at {spot}; the errors are in the tables below"
            yield from picture(report, f"response_{file_name(spot)}", label)

    def is_open(self, data: ReportData, report: Report) -> bool:
        """Always."""
        return True


class Warnings(Section):
    """All that limits the result."""

    name, title = "warnings", "Warnings"
    summary = "limits of the result, the most severe first"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """List the first warnings in the open, then the others and the notes."""
        warnings, notes = report.conclusion.warnings, report.conclusion.notes
        if warnings:
            yield _listing(warnings[:IN_THE_OPEN])
        if more := warnings[IN_THE_OPEN:]:
            yield Fold(f"{len(more)} more", [_listing(more)])
        if notes:
            yield Fold(f"Notes on scenarios that are not reported ({len(notes)})", [_listing(notes)])

    def is_open(self, data: ReportData, report: Report) -> bool:
        """Always."""
        return True


IN_THE_OPEN = 3
"""Warnings that are not folded."""


def _listing(warnings: Sequence[ReportWarning]) -> Listing:
    return Listing([(f"{warning.what}.", warning.why) for warning in warnings])


class Values(Section):
    """The numbers behind the first picture."""

    name, title, entry = "values", "Every value, by spot and scenario", "Values"
    summary = "every value with its interval, by spot and scenario"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show what leads, then every best set."""
        conclusion = report.conclusion
        if conclusion.lead and not conclusion.failure:
            yield Paragraph(conclusion.lead)
        leading = [best for best in conclusion.bests if best.scenario == data.generalising.name]
        if any(best.found == "fit" for best in leading):
            yield _leading(data, report, leading)
            yield Paragraph(conclusion.spent)
            yield Fold("Every scenario", [_every(data, report)])
        else:
            yield _every(data, report)
        if "distance_to_truth" in report.tables:
            yield Fold("Distance to the known answer", list(tables(report, "distance_to_truth")))


class Fits(Section):
    """Effect of the meshes, and ends of the searches."""

    name, title, entry = "fit", "How the fit went", "Fit"
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
            yield Table.of(TITLES["fit_mesh"], printed("fit_mesh", rows))
        yield from tables(report, "table2_fit")
        yield Fold("Every fit", list(tables(report, "fit")))


class MaterialItself(Section):
    """Stress of the fits."""

    name, title, entry = "material", "The material itself", "Material"
    summary = "stress over stretch of the fitted material, with its 95 % band"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Draw the stress of each region, and list some of it."""
        if report.conclusion.failure:
            return
        curves = list(material_curves(data, data.generalising.name))
        if not curves:
            return
        yield Paragraph(
            "Nominal stress of the fitted law at constant volume, drawn at the top of the page. The band "
            "holds 95 % of the draws of the joint fit. Where the tissue was stretched less, the law alone "
            "decides."
        )
        rows = [row for each in curves for row in rows_of(each, data.together)]
        heads = ["region", "stress", "at", f"value [{data.modulus_unit}]", "lower", "upper"]
        yield Table(f"Nominal stress of the fit to {data.together}", heads, rows)


# ------------------------------------------------------------------- values


def _cell(value: Headline, report: Report) -> Lines:
    lines: list[Any] = [value.text]
    if value.interval:
        lines += [f"optimum {value.optimum:.4g}"] if value.optimum is not None else []
        lines.append(value.interval)
    verdict = replace(value, model=report.conclusion.model.verdict).verdict
    return Lines([*lines, *map(Word, verdict.split(", "))])


def _below(bests: Sequence[Best]) -> str:
    """Blocks below the values."""
    if any(value.level for best in bests for value in best.values):
        return "its 95 % interval"
    return "the fitted optimum, and the range that fits about as well"


def _leading(data: ReportData, report: Report, bests: Sequence[Best]) -> Table:
    """Show the joint fit with the spots next to it."""
    truth = data.study.truth
    known: list[Cell] = [None] if truth else []
    rows: list[list[Cell]] = []
    for values in zip(*(best.values for best in bests), strict=True):
        of_truth = [truth.get(values[0].name)] if truth else []
        rows.append([values[0].label, *(_cell(value, report) for value in values), *of_truth])
    rows += [[label, *values] for label, values in _moduli(data, bests)]
    mean, least = ("", "") if bests[0].spot != ALL_SPOTS else (" (all spots: mean)", " (all spots: least)")
    rows.append([f"Fopt{mean}", *(best.fopt for best in bests), *known])
    rows.append([f"least Fopt of the search{mean}", *(best.fopt_least for best in bests), *known])
    for channel in data.measured_channels:
        rows.append([f"R² {channel}{least}", *(best.r2[channel] for best in bests), *known])
    rows.append(["found", *(best.found for best in bests), *([""] if truth else [])])
    return Table(
        f"The fit to {bests[0].fitted_to} (scenario {data.generalising.name}); below each value "
        f"{_below(bests)}",
        ["parameter", *(best.spot for best in bests), *(["known answer"] if truth else [])],
        rows,
    )


def _moduli(data: ReportData, bests: Sequence[Best]) -> Iterator[tuple[str, list[float | None]]]:
    """Rows of the initial moduli of each best set, and of the known answer if there is one."""
    columns = [best.moduli for best in bests]
    if data.study.truth:
        columns.append(dict(initial_moduli(data, data.study.truth)))
    for region in dict.fromkeys(region for column in columns for region in column):
        of = f" of {region}" if len(data.study.space.regions) > 1 else ""
        for i, name in enumerate(MODULI):
            values = [column[region][i] if region in column else None for column in columns]
            yield f"{name}{of} [{data.modulus_unit}]", values


def _every(data: ReportData, report: Report) -> Table:
    conclusion, channels = report.conclusion, data.measured_channels
    return Table(
        f"Best values by spot and scenario; below each {_below(conclusion.bests)}",
        [
            "spot",
            "scenario",
            *conclusion.parameters,
            "Fopt",
            *(f"R² {c}" for c in channels),
            "fitted to",
            "found",
        ],
        [
            [
                best.spot,
                best.scenario,
                *(_cell(value, report) for value in best.values),
                best.fopt,
                *(best.r2[channel] for channel in channels),
                best.fitted_to,
                best.found,
            ]
            for best in conclusion.bests
        ],
        strong=frozenset(
            k for k, best in enumerate(conclusion.bests) if best.scenario == data.generalising.name
        ),
    )
