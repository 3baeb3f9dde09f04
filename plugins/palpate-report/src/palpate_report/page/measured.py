"""The page of all measured curves, each figure with a cursor that is common to its axis.

``measured.html.jinja`` is its frame, ``cursor.js`` moves the cursors and lists the values under them.
"""

import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
import polars as pl
from markupsafe import Markup
from matplotlib.backends.backend_svg import FigureCanvasSVG

from palpate.api import Channel, FloatArray, PluginError, Response
from palpate.api.experiment import TIME
from palpate.api.files import write_atomically
from palpate.api.report import Picture
from palpate_report.data.showable import plain
from palpate_report.figures.style import LINES, finished, sized, styled
from palpate_report.page.html import content_policy, template, text_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """Curves of one press at a spot over one axis: by label, places on the axis (n,) and values (n,)."""

    spot: str
    press: str
    curves: dict[str, tuple[FloatArray, FloatArray]]


def write_measured_page(
    study: str,
    presses: Mapping[str, Mapping[str, Response]],
    pictures: Mapping[str, Path],
    channels: Mapping[str, Channel],
    notice: str,
    page: Path,
) -> None:
    """Write the page; for the arguments see :class:`palpate.plugins.optional.ExperimentDrawer`."""
    views: dict[str, list[Line]] = {}
    for spot, found in presses.items():
        for axis, line in (*_logged(spot, pictures[spot], channels), *_read(spot, found, channels)):
            views.setdefault(axis, []).append(line)
    drawn: list[dict[str, Any]] = [
        {"axis": axis, "figures": [_figure(axis, some, notice) for some in _by_spots(lines)]}
        for axis, lines in views.items()
    ]
    script = text_of("cursor.js")
    text = template("measured.html.jinja").render(
        study=study,
        notice=notice,
        date=datetime.now().astimezone().date().isoformat(),
        views=drawn,
        data=[[figure["data"] for figure in view["figures"]] for view in drawn],
        script=Markup(script),
        policy=content_policy(script),
    )
    write_atomically(page, text.encode())


def _logged(spot: str, pictures: Path, channels: Mapping[str, Channel]) -> Iterator[tuple[str, Line]]:
    """Quantities over time that a loader has written next to its pictures; a PluginError without the time."""
    labels = {c.abscissa: c.abscissa_label for c in channels.values()}
    labels |= {c.ordinate: c.ordinate_label for c in channels.values()}
    for file in sorted(pictures.rglob("over_time.csv")):
        frame = _numbers(file)
        if TIME not in frame.columns:
            raise PluginError(f"{file}: no column '{TIME}'; the loader that draws gives it, in seconds")
        frame = frame.filter(pl.col(TIME).is_finite())
        if frame.is_empty():
            continue
        time = frame[TIME].to_numpy() - frame[TIME][0]
        curves = {
            labels.get(name, name): (time, frame[name].to_numpy()) for name in frame.columns if name != TIME
        }
        # Other curves over time begin at first contact, so that they share no axis with the log.
        press = file.parent.relative_to(pictures).as_posix()
        yield "time of the log (s)", Line(spot=spot, press=press, curves=curves)


def _numbers(file: Path) -> pl.DataFrame:
    """Table of numbers; a PluginError with row and column of the first cell that is none."""
    try:
        text = pl.read_csv(file, infer_schema=False)
    except pl.exceptions.PolarsError as error:
        why = str(error).partition("\n")[0]
        raise PluginError(f"{file}: no table ({why}); the loader that draws gives one") from None
    frame = text.select(pl.all().str.strip_chars().cast(pl.Float64, strict=False))
    for name in text.columns:
        for row in (frame[name].is_null() & text[name].is_not_null()).arg_true().to_list():
            raise PluginError(
                f"{file}: row {row + 1}, column '{name}': '{text[name][row]}' is not a number; the loader "
                "that draws gives numbers"
            )
    return frame


def _read(
    spot: str, presses: Mapping[str, Response], channels: Mapping[str, Channel]
) -> Iterator[tuple[str, Line]]:
    """Curves that the loader gives, by the label of their abscissa."""
    for file, response in presses.items():
        found: dict[str, Line] = {}
        for name, curve in response.curves.items():
            axis, label = channels[name].abscissa_label, channels[name].ordinate_label
            line = found.setdefault(axis, Line(spot=spot, press=file, curves={}))
            line.curves[label] = curve.abscissa, curve.ordinate
        yield from found.items()


def _by_spots(lines: Sequence[Line]) -> Iterator[list[Line]]:
    """Lines of as many spots as have looks of their own."""
    spots = list(dict.fromkeys(line.spot for line in lines))
    for start in range(0, len(spots), len(LINES)):
        some = spots[start : start + len(LINES)]
        yield [line for line in lines if line.spot in some]


def _figure(axis: str, lines: Sequence[Line], notice: str) -> dict[str, Any]:
    """Picture of panels over one axis, and the numbers of its lines."""
    labels = list(dict.fromkeys(label for line in lines for label in line.curves))
    looks = dict(zip(dict.fromkeys(line.spot for line in lines), LINES, strict=False))
    content = io.BytesIO()
    with styled():
        # Text to read on a phone, next to it values on a screen.
        figure = sized(100.0, 28.0 * len(labels) + 18.0)
        panels = list(figure.subplots(len(labels), 1, squeeze=False, sharex=True)[:, 0])
        for panel, label in zip(panels, labels, strict=True):
            panel.set_ylabel(fill(label, 19))
            for line in (each for each in lines if label in each.curves):
                colour, dash = looks[line.spot]
                panel.plot(*line.curves[label], color=colour, linestyle=dash, label=line.spot)
        panels[-1].set_xlabel(axis)
        figure.align_ylabels()
        canvas: Any = FigureCanvasSVG(finished(figure, panels, notice))
        canvas.print_svg(content, metadata={"Date": None})
    first, last, spots = panels[0].get_position(), panels[-1].get_position(), ", ".join(looks)
    return {
        "picture": Picture(label=f"{', '.join(labels)} over {axis}: {spots}", content=content.getvalue()),
        "spots": spots,
        "columns": labels,
        "rows": [line.spot if len(lines) == len(looks) else f"{line.spot}, {line.press}" for line in lines],
        "data": {
            "box": plain([first.x0, last.x1, 1.0 - first.y1, 1.0 - last.y0]),
            "ends": plain(panels[0].get_xlim()),
            "lines": [[_thinned(line.curves.get(label)) for label in labels] for line in lines],
        },
    }


def _thinned(curve: tuple[FloatArray, FloatArray] | None, most: int = 1000) -> list[list[float]] | None:
    """Numbers of a curve as JSON, at most so many, with its ends, peaks and gaps; None without a curve."""
    if curve is None or curve[0].size <= most:
        return curve and [plain(each) for each in curve]
    kept = {0, curve[0].size - 1}
    for rows in np.array_split(np.arange(curve[0].size), (most - 2) // 5):
        along, values = (each[rows] for each in curve)
        ends = [np.where(np.isnan(each), np.inf, each).argmin() for each in (along, -along, values, -values)]
        kept |= set(rows[[*ends, np.isnan(values).argmax()]].tolist())
    return [plain(each[sorted(kept)]) for each in curve]
