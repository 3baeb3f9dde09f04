"""What the curves allow: the density of the parameters, its profiles, and who rules the curves where."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import polars as pl

from palpate.certainty.profiles import RISE
from palpate.domain import FloatArray, Parameter
from palpate.plugins.sections import Block, Figure, Fold, Paragraph, Section
from palpate.report.estimates import draws_of
from palpate.report.report_data import ReportData
from palpate.report.result import Report
from palpate.run.result import ALL_SPOTS

MOST_DRAWS = 400
"""Draws in a panel."""

MOST_PARAMETERS = 5
"""Parameters that pairs are drawn of: ten panels."""

N_COLUMNS = 3
"""Panels side by side."""

GAP = 0.12
"""Space between panels, over the width of the figure."""


class WhatCurvesAllow(Section):
    """Pairs of parameters, profiles, and indices along the path."""

    name, title, entry = "density", "What the curves allow", "Pairs"
    summary = "pairs of parameters that the curves allow, profiles, and which parameter rules the curves"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show pairs by scenario, then what a posterior adds."""
        pairs = [figure for s in data.study.scenarios for figure in _pairs(data, s.name)]
        if not pairs or report.verdict.failure:
            return
        yield Paragraph(
            "Each dot is a set of parameters that the curves of a scenario allow, as often as it is likely; "
            "grey are sets of the sweep. One variable leaves a valley, in which parameters make up for each "
            "other; two variables cut it."
        )
        yield from pairs
        yield from _ribbons(data)
        profiles = list(_profiles(data))
        if profiles:
            yield Fold(
                "Profiles: how much worse the fit is, with the other parameters fitted again", profiles
            )


def _pairs(data: ReportData, scenario: str) -> Iterator[Figure]:
    draws = draws_of(data, scenario, MOST_DRAWS)
    names = [name for name in data.searched if name in draws.columns][:MOST_PARAMETERS]
    if draws.is_empty():
        return
    if len(names) == 1:
        yield _one(data, scenario, draws[names[0]].to_numpy(), data.searched[names[0]])
        return
    panels = list(combinations(names, 2))
    end = data.fit.ends.filter(pl.col("fit").is_in([data.together, ALL_SPOTS]), scenario=scenario)
    traces: list[Mapping[str, Any]] = []
    for k, (x, y) in enumerate(panels, start=1):
        axes = {"type": "scatter", "mode": "markers", **_on(k)}
        if data.design.n_sets and {x, y} <= {p.name for p in data.design.parameters}:
            sets = [[p.name for p in data.design.parameters].index(name) for name in (x, y)]
            swept = data.design.values[:, sets].T
            look = {"size": 4, "color": "--soft", "opacity": 0.35}
            traces.append(axes | {"name": "sweep", "x": swept[0], "y": swept[1], "marker": look})
        look = {"size": 4, "color": "--line0", "opacity": 0.35}
        traces.append(
            axes | {"name": "allowed", "x": draws[x].to_list(), "y": draws[y].to_list(), "marker": look}
        )
        for found in end.iter_rows(named=True):
            look = {"size": 11, "symbol": "diamond", "color": "--ink"}
            traces.append(axes | {"name": "fit", "x": [found[x]], "y": [found[y]], "marker": look})
        if {x, y} <= data.study.truth.keys():
            look = {"size": 12, "symbol": "x", "color": "--least"}
            at = [[data.study.truth[x]], [data.study.truth[y]]]
            traces.append(axes | {"name": "known answer", "x": at[0], "y": at[1], "marker": look})
    titles = [(_title(data.searched[x]), _title(data.searched[y])) for x, y in panels]
    yield Figure(
        label=f"Pairs of parameters that the curves allow in scenario {scenario}; the intervals are in the "
        "table of causes",
        traces=traces,
        layout=_grid(titles) | {"showlegend": True},
        height=60 + 300 * _n_rows(len(panels)),
        scenario=scenario,
    )


def _one(data: ReportData, scenario: str, draws: FloatArray, parameter: Parameter) -> Figure:
    """How often each value of the only parameter is drawn."""
    counts, edges = np.histogram(draws, bins=30)
    look = {"color": "--line0", "shape": "hv"}
    steps = {"x": edges, "y": np.append(counts, counts[-1]), "fill": "tozeroy", "line": look}
    return Figure(
        label=f"Values that the curves allow in scenario {scenario}; the interval is in the table of causes",
        traces=[{"type": "scatter", "mode": "lines", "name": "allowed"} | steps],
        layout={"xaxis": {"title": _title(parameter)}, "yaxis": {"title": "draws"}},
        height=280,
        scenario=scenario,
    )


def _profiles(data: ReportData) -> Iterator[Figure]:
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
        layout=_grid(titles) | {"showlegend": True},
        height=60 + 260 * _n_rows(len(names)),
    )


def _ribbons(data: ReportData) -> Iterator[Block]:
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
            layout=_grid(titles) | {"showlegend": True},
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


def _grid(titles: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """Axes of panels side by side, by the titles of x and y of each."""
    n_columns, n_rows = min(len(titles), N_COLUMNS), _n_rows(len(titles))
    width, height = ((1.0 - GAP * (n - 1)) / n for n in (n_columns, n_rows))
    axes: dict[str, Any] = {}
    for k, (x, y) in enumerate(titles):
        row, column = divmod(k, n_columns)
        left, low = column * (width + GAP), 1.0 - height - row * (height + GAP)
        number = "" if k == 0 else str(k + 1)
        ends = np.clip([left, left + width, low, low + height], 0.0, 1.0).tolist()
        axes[f"xaxis{number}"] = {"title": x, "domain": ends[:2], "anchor": f"y{number}", "nticks": 5}
        axes[f"yaxis{number}"] = {"title": y, "domain": ends[2:], "anchor": f"x{number}", "nticks": 5}
    return axes
