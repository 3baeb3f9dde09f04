"""How sure the parameters are: by intervals of the fit, by posteriors, and by the sets of the sweep."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from palpate.api import Parameter
from palpate.api.fit import RISE, share_of_range
from palpate.api.report import Bar, Block, Figure, Fold, Listing, Paragraph, Section, Shares, Table, Word
from palpate_report.answer import budget_bars
from palpate_report.marks import verdict_of
from palpate_report.report_data import ReportData
from palpate_report.result import Report
from palpate_report.sections.tables import table

N_COLUMNS = 3
"""Panels side by side."""

GAP = 0.12
"""Space between panels, over the width of the figure."""

ROW_GAPS = 0.35
"""Most of the height of the figure that is between rows of panels."""


def profiles(data: ReportData) -> Iterator[Block]:
    """How much worse the fit is at each value, with the other parameters fitted again."""
    table = data.posterior.profiles
    if table.is_empty():
        return
    names = list(dict.fromkeys(table["parameter"].to_list()))
    traces: list[Mapping[str, Any]] = []
    for k, name in enumerate(names, start=1):
        rows = table.filter(parameter=name).sort("value")
        at = {"type": "scatter", "mode": "lines", **_on(k)}
        x = rows["value"].to_list()
        traces.append(
            at | {"name": "profile", "x": x, "y": rows["rise"].to_list(), "line": {"color": "--line0"}}
        )
        look = {"color": "--soft", "dash": "dot", "width": 1}
        traces.append(at | {"name": "95 %", "x": [x[0], x[-1]], "y": [RISE, RISE], "line": look})
        if name in data.study.truth:
            truth = data.study.truth[name]
            look = {"color": "--least", "width": 1.6}
            traces.append(at | {"name": "known answer", "x": [truth, truth], "y": [0.0, RISE], "line": look})
    titles = [(_title(data.searched[name]), "rise of −2 log density") for name in names]
    yield Figure(
        label="Profiles of the parameters; their ends are in the table of posteriors",
        traces=traces,
        layout=grid(titles) | {"showlegend": True},
        height=60 + 260 * _n_rows(len(names)),
    )


def ribbons(data: ReportData) -> Iterator[Block]:
    """Shares of the parameters in the variance along each curve, at the spot that the menu chooses."""
    table = data.posterior.ribbons
    if table.is_empty():
        return
    yield Paragraph(
        "Which parameter rules the curves where: its share of the variance over the ranges by itself "
        "(first-order Sobol index), along the path."
    )
    for spot in dict.fromkeys(table["spot"].to_list()):
        of_spot = table.filter(spot=spot)
        channels = list(dict.fromkeys(of_spot["channel"].to_list()))
        names = list(dict.fromkeys(of_spot["parameter"].to_list()))
        traces = []
        for k, channel in enumerate(channels, start=1):
            for i, name in enumerate(names):
                rows = of_spot.filter(channel=channel, parameter=name).sort("point")
                traces.append(
                    {
                        "type": "scatter",
                        "mode": "lines",
                        "name": data.searched[name].name,
                        "x": rows["point"].to_list(),
                        "y": (100.0 * rows["first"].clip(0.0, 1.0)).to_list(),
                        "text": [f"{channel} at {at:.4g}" for at in rows["abscissa"].to_list()],
                        "stackgroup": str(k),
                        "line": {"width": 0.5, "color": f"--line{i % 6}"},
                        **_on(k),
                    }
                )
        titles = [(f"point of the {channel} along the path", "share [%]") for channel in channels]
        yield Figure(
            label=f"Shares of the parameters in the variance of the curves at {spot}; the table is "
            "ribbons.parquet",
            traces=traces,
            layout=grid(titles) | {"showlegend": True},
            height=60 + 220 * _n_rows(len(channels)),
            spot=spot,
        )


def _on(k: int) -> dict[str, Any]:
    """The axes of panel k; its traces are in the legend once."""
    number = "" if k == 1 else str(k)
    return {"xaxis": f"x{number}", "yaxis": f"y{number}", "showlegend": k == 1}


def _title(parameter: Parameter) -> str:
    unit = "" if parameter.unit in ("", "1") else f" [{parameter.unit}]"
    return f"{parameter.name}{unit}"


def _n_rows(n: int) -> int:
    return -(-n // N_COLUMNS)


def grid(titles: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """Axes of panels side by side, by the titles of x and y of each."""
    n_columns, n_rows = min(len(titles), N_COLUMNS), _n_rows(len(titles))
    row_gap = min(ROW_GAPS / n_rows, GAP)
    width, height = (1.0 - GAP * (n_columns - 1)) / n_columns, (1.0 - row_gap * (n_rows - 1)) / n_rows
    axes: dict[str, Any] = {}
    for k, (x, y) in enumerate(titles):
        row, column = divmod(k, n_columns)
        left, low = column * (width + GAP), 1.0 - height - row * (height + row_gap)
        number = "" if k == 0 else str(k + 1)
        ends = np.clip([left, left + width, low, low + height], 0.0, 1.0).tolist()
        axes[f"xaxis{number}"] = {"title": x, "domain": ends[:2], "anchor": f"y{number}", "nticks": 5}
        axes[f"yaxis{number}"] = {"title": y, "domain": ends[2:], "anchor": f"x{number}", "nticks": 5}
    return axes


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
            "large as the study's error budget says. Shares of its causes:"
        )
        bars = list(budget_bars(data))
        yield Table(
            "Causes of the intervals that lead",
            ["parameter", "causes"],
            [[n, Shares(parts)] for n, parts in bars],
        )
        yield from table(report, "inadequate")
        every = [t for name in ("intervals", "directions", "budget") for t in table(report, name)]
        yield Fold("Every interval, combinations that are known better, and every cause", every)
        if "posterior" in report.tables:
            names = ("posterior", "profile_ends", "volumes", "emulator")
            found = [t for name in names for t in table(report, name)]
            yield from ribbons(data)
            yield Fold(
                "Posteriors of the joint fits, by an emulator of the curves", [*profiles(data), *found]
            )

    def is_open(self, data: ReportData, report: Report) -> bool:
        """Where there are few parameters."""
        return len(list(budget_bars(data))) < 6


class Identifiability(Section):
    """Which values the sets of the sweep allow."""

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
        is_sure = any(each.level for each in report.verdict.estimates)
        if is_sure:
            yield Paragraph(
                "How well a parameter is identified is said by the 95 % intervals of the fit, which have "
                "the whole error budget; these ranges do not."
            )
        else:
            yield Paragraph(
                "Up to 10 % of the range is called well identifiable, up to 30 % roughly, up to 80 % "
                "poorly, beyond that not. Unclear: too few sets, or curves that the slopes do not predict."
            )
            yield Listing([("", sentence) for sentence in report.verdict.identifiability])
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
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    other, correlation = row["most_correlated_with"], row["correlation"]
    return [
        row["name"],
        row["spot"],
        row["scenario"],
        row["bar"],
        f"{row['value']:.4g}{unit}",
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
