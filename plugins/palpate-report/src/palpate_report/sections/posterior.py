"""Posteriors on the page: profiles of the parameters, and who rules the curves where."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from palpate.api import Parameter
from palpate.api.fit import RISE
from palpate.api.report import Block, Figure, Paragraph
from palpate_report.report_data import ReportData

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
