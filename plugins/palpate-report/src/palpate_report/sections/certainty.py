"""Sections on how sure the parameters are: by intervals of the fit, posteriors, and sets of the sweep."""

from collections.abc import Iterator, Mapping
from typing import Any

from palpate.api import Parameter
from palpate.api.fit import share_of_range
from palpate.api.report import Bar, Block, Fold, Listing, Paragraph, Section, Table, Word
from palpate_report.marks import verdict_of, with_unit
from palpate_report.report_data import ReportData
from palpate_report.result import Report
from palpate_report.sections.tables import picture, tables


class Certainty(Section):
    """Intervals of the fit and their causes."""

    name, title, entry = "certainty", "What the intervals come from", "Certainty"
    summary = "causes of the 95 % intervals, and combinations of parameters that are known better"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show the causes of what leads, then every interval."""
        if "intervals" not in report.tables:
            return
        yield Paragraph(
            "A 95 % interval holds the true value in 95 of 100 experiments, if what may be wrong is as "
            "large as the study's error budget states. Shares of its causes:"
        )
        yield from picture(report, "causes", "What widens each interval; the shares are in the table below")
        yield from tables(report, "inadequate")
        every = tables(report, "intervals", "parameter_combinations", "budget")
        yield Fold("Every interval, combinations that are known better, and every cause", list(every))
        if "posterior" in report.tables:
            found = tables(report, "posterior", "profile_ends", "volumes", "emulator")
            if not data.posterior.sobol_indices.is_empty():
                yield Paragraph(
                    "Which parameter rules the curves where: its share of the variance over the ranges by "
                    "itself (first-order Sobol index), along the path."
                )
            yield from picture(report, "sobol_indices", "First-order Sobol indices along the path")
            label = "Profiles of the parameters; their ends are in the table of posteriors"
            yield Fold(
                "Posteriors of the joint fits, by an emulator of the curves",
                [*picture(report, "profiles", label), *found],
            )

    def is_open(self, data: ReportData, report: Report) -> bool:
        """True where there are few parameters."""
        return data.leading_rows(data.fit.certainty.intervals).height < 6


class Identifiability(Section):
    """Section on the values that the sets of the sweep allow."""

    name, title, entry = "identifiability", "What the sweep allows", "Identifiability"
    summary = "values with which sets of the sweep fit about as well as the best"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show the intervals of the scenario that generalises, then those of the others."""
        rows = list(_intervals(data))
        if not rows or not data.design.n_sets:
            return
        thin = ", the thin line the known answer" if data.study.truth else ""
        yield Paragraph(
            "The interval holds the values with which a set fits about as well as the best, the other "
            "parameters adjusting themselves within their ranges: Fopt at most twice its fitted least, or "
            "the least plus the effect of the measured spread or of the error of the fit, whichever is "
            "more. Fopt is fitted to the sweep's own curves; the fitted optimum is where it is least. In a "
            f"bar the thick line is the interval, the dot the best value{thin}."
        )
        is_sure = any(each.level for each in report.conclusion.estimates)
        if is_sure:
            yield Paragraph(
                "How well a parameter is identified is shown by the 95 % intervals of the fit, which have "
                "the whole error budget; these ranges do not."
            )
        else:
            yield Paragraph(
                "Up to 10 % of the range is called well identifiable, up to 30 % roughly, up to 80 % "
                "poorly, beyond that not. Unclear: too few sets, or curves that the slopes do not predict."
            )
            yield Listing([("", sentence) for sentence in report.conclusion.identifiability])
        main = data.generalising.name
        own = [row for row in rows if row["scenario"] == main]
        yield _table(f"Intervals in scenario {main}", own, words=not is_sure)
        if others := [row for row in rows if row["scenario"] != main]:
            yield Fold(
                "The other scenarios", [_table("Intervals in the other scenarios", others, words=not is_sure)]
            )


def _table(caption: str, rows: list[dict[str, Any]], *, words: bool) -> Table:
    heads = ["parameter", "spot", "scenario", "within the range", "best set"]
    heads += ["fitted optimum", "about as good", "most correlated with", "sets as good"]
    cells = [_cells(row) for row in rows]
    if words:
        heads.append("identifiability")
        cells = [
            [*own, Word(verdict_of(row["identifiability"]))] for own, row in zip(cells, rows, strict=True)
        ]
    return Table(caption, heads, cells)


def _cells(row: Mapping[str, Any]) -> list[Any]:
    other, correlation = row["most_correlated_with"], row["correlation"]
    return [
        row["name"],
        row["spot"],
        row["scenario"],
        row["bar"],
        with_unit(f"{row['value']:.4g}", row["unit"]),
        row["optimum"],
        None if row["lower"] is None else f"{row['lower']:.4g} to {row['upper']:.4g}",
        None if not other or correlation is None else f"{other} ({correlation:.2f})",
        row["n_as_good"],
    ]


def _intervals(data: ReportData) -> Iterator[dict[str, Any]]:
    """Rows of the identifiability under brief names, with places in percent of the range for their bars."""
    for row in data.identifiability.iter_rows(named=True):
        parameter, other = data.brief[row["parameter"]], data.brief.get(row["most_correlated_with"])
        places = {end: row[end] for end in ("lower", "upper", "value")}
        places["truth"] = data.study.truth.get(row["parameter"])
        at = {end: _percent(parameter, value) for end, value in places.items() if value is not None}
        width = row["relative_width"]
        yield row | {
            "name": parameter.name,
            "most_correlated_with": other and other.name,
            "bar": Bar(**at, text="" if width is None else f"{100.0 * width:.0f} %"),
        }


def _percent(parameter: Parameter, value: float) -> float:
    return round(min(max(100.0 * share_of_range(parameter, value), 0.0), 100.0), 2)
