"""Sections on the sets of the sweep."""

from collections.abc import Iterator
from itertools import combinations

import polars as pl

from palpate.api.report import Block, Drawing, Paragraph, Section, Table, shown
from palpate_report.answer.result import Report
from palpate_report.data.report_data import ReportData
from palpate_report.data.tables import TITLES
from palpate_report.figures.contours import contours
from palpate_report.sections.tables import picture, tables


class Space(Section):
    """Every set in the planes of the parameters."""

    name, title = "space", "Parameter space"
    summary = "sets and fits in every plane of two parameters"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show the planes."""
        if data.design.n_sets:
            yield Paragraph(
                "Each point is a set, coloured by its Fopt at the spot. Drag over points, or click one, to "
                "select sets and list them below."
            )
        pairs = combinations(data.brief, 2)
        if any(contours(data, data.generalising.name, one, other) for one, other in pairs):
            yield Paragraph(
                f"Contour lines: least Fopt of the fit to {data.together} when the other parameters are "
                "fitted again, from an emulator of the simulated curves. A long valley is a combination of "
                "parameters that the curves do not tell apart."
            )
        elif data.is_fitted and len(data.brief) > 1:
            few = "Few sets are near the fit" if data.design.n_sets else "Only the fit was simulated"
            yield Paragraph(f"{few}. Fopt is unknown in most of each plane, so there are no contour lines.")
        if data.is_fitted:
            yield Paragraph(
                "Each line is the path of a search to its least Fopt (diamond), and a circle marks the "
                "reported values. A break in a line marks a correction by a finer mesh."
            )
        yield Drawing("space")

    def result(self, data: ReportData, report: Report) -> str:
        """Number of sets, or that only the search was simulated."""
        return f"{data.design.n_sets} sets" if data.design.n_sets else "paths of the searches"


class Distribution(Section):
    """Fopt of every set."""

    name, title, entry = "distribution", "NMSE of all sets", "NMSE"
    summary = "Fopt of every set by spot"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show the sets by spot, and the least of each."""
        if data.design.n_sets:
            yield from picture(
                report, "nmse_distribution", "Fopt of every set by spot; the least is in the table"
            )
            yield from tables(report, "table2_nmse")


class OtherChannels(Section):
    """Channels that a fit leaves out."""

    name, title = "channels", "Across channels"
    summary = "how well a fit to one curve predicts the other"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show what each fit misses."""
        if found := list(tables(report, "unfitted_channels", "cross_channel")):
            yield Paragraph("Prediction of one curve by a fit to another, such as torque by a fit to force.")
            yield from found

    def result(self, data: ReportData, report: Report) -> str:
        """Least R² of a channel in the fits that leave it out."""
        misfits = report.tables.get("unfitted_channels", pl.DataFrame()).iter_rows(named=True)
        known = [row["r2"] for row in misfits if row["r2"] is not None]
        return f"R² of a curve that a fit leaves out: {shown(min(known))} or more" if known else ""


class Generalisation(Section):
    """One set for all spots."""

    name, title = "generalisation", "Generalisation"
    summary = "the set of the sweep for all spots, and its loss of fit at each"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show the set and its cost."""
        if "generalised" not in report.tables or len(data.spots) < 2 or data.widened:
            return  # a set of the narrower ranges has no verdict
        yield Paragraph(
            "The sampled set with the lowest mean Fopt over all spots, compared with the best set at each "
            "spot."
        )
        yield from tables(report, "generalised", "cost_of_one_set")


class Convergence(Section):
    """Section on how the simulations ended."""

    name, title, entry = "convergence", "Convergence and failures", "Convergence"
    summary = "how the simulations ended, by spot and reason"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show the ends of the simulations."""
        if data.convergence.height:
            yield Table.of(TITLES["convergence"], data.convergence)
        if "failures" not in report.tables and data.design.n_sets:
            yield Paragraph("All simulated sets could be ranked.")
        yield from tables(report, "failures", "verification")
