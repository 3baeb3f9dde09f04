"""The space of the parameters, coloured by NMSE, as the paper shows it."""

from collections.abc import Sequence
from functools import partial
from itertools import combinations
from typing import Any, cast

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.spatial import ConvexHull, QhullError

from palpate.api import FloatArray, Parameter
from palpate.api.runs import objectives
from palpate_report.answer.headline import draws_of
from palpate_report.data.report_data import ReportData
from palpate_report.figures.contours import contours, paths, reported
from palpate_report.figures.style import (
    LEAST_COLOUR,
    LINES,
    MEASURED_COLOUR,
    PlainNumbers,
    axis_label,
    finished,
    lettered,
    panels,
    set_log,
)

SMALLEST = 1e-6
"""Least part of the largest Fopt that a log scale shows."""

MOST_PAIRS = 15
"""Most pairs of parameters that one figure shows."""


def colours() -> Colormap:
    """Viridis without its dark end, next to which black marks would not be seen."""
    viridis = mpl.colormaps["viridis"]
    return LinearSegmentedColormap.from_list("nmse", viridis(np.linspace(0.25, 1.0, 256)))


def parameter_space(data: ReportData, spot: str) -> Figure:
    """Show sets in the space of their parameters: coloured by the logarithm of Fopt, red the least.

    The ways of the joint fit and of the spot's own are drawn over them, each to a diamond at its least Fopt,
    with a circle at the reported values, and below them contour lines of Fopt and the 95 % region of the fit
    that leads; without a spot, where there is no sweep, the ways of every spot. Three parameters of a sweep
    are shown in space and in pairs, more in pairs (at most ``MOST_PAIRS``), one over its own axis. Axes are
    logarithmic where the sweep is; space has none such.
    """
    values, fopt = _sets_at(data, spot)
    # Most draws that outline a region.
    draws = draws_of(data, data.generalising.name, 2000)
    parameters = tuple(data.brief.values())
    ranges = tuple(data.widened.get(name, p) for name, p in data.brief.items())
    n = len(parameters)
    if n == 1:
        figure, flat = panels(1, 1, 70.0, 0.0)
        _draw_one_parameter(flat[0], values[:, 0], fopt, parameters[0])
        _draw_paths(data, spot, flat[0], [data.design.parameters[0].name, "fopt"])
    else:
        pairs = list(combinations(range(n), 2))[:MOST_PAIRS]
        in_space = n == 3 and data.design.n_sets > 0 and not any(p.scale == "log" for p in parameters)
        n_panels = len(pairs) + in_space
        n_columns = min(n_panels, 2 if n_panels <= 4 else 4)
        # Height of a panel by the number of columns.
        figure, flat = panels(n_panels, n_columns, {1: 65.0, 2: 60.0, 4: 42.0}[n_columns], 18.0)
        if in_space:
            _draw_space(figure, flat, values, fopt, ranges)
            _draw_paths(data, spot, flat[0], [p.name for p in data.design.parameters])
        for axis, (i, j) in zip(flat[in_space:], pairs, strict=True):
            names = [data.design.parameters[k].name for k in (i, j)]
            _draw_region(draws, axis, names, f"95 % region of {data.together}, as the intervals")
            _scatter(axis, (values[:, i], values[:, j]), fopt)
            _draw_paths(data, spot, axis, names)
            axis.set_xlabel(axis_label(ranges[i]))
            axis.set_ylabel(axis_label(ranges[j]))
            _draw_truth(data, axis, names)
            _set_scales(axis, (parameters[i], parameters[j]))
            _draw_contours(data, axis, *names)
    if n > 1 and np.isfinite(fopt).any():
        _colour_bar(figure, flat, data, fopt)
    lettered(flat)
    return finished(figure, flat[-1:], data.stamp)


def _sets_at(data: ReportData, spot: str) -> tuple[FloatArray, FloatArray]:
    """Values of every set, NaN where it was not simulated, and its Fopt at a spot, NaN where it failed."""
    rows = objectives(data.scores, [data.generalising]).filter(pl.col("spot") == spot)
    fopt = np.full(data.design.n_sets, np.nan)
    fopt[rows["set_id"].to_numpy()] = rows["fopt"].to_numpy()
    simulated = np.isin(np.arange(fopt.size), data.scores.filter(pl.col("spot") == spot)["set_id"])
    return np.where(simulated[:, None], data.design.values, np.nan), fopt


def fopt_scale(fopt: FloatArray) -> LogNorm:
    """Log scale over the finite errors, none of them too small to show."""
    largest = max(float(np.nanmax(fopt)), np.finfo(float).tiny / SMALLEST)
    return LogNorm(max(float(np.nanmin(fopt)), SMALLEST * largest), largest, clip=True)


def _set_scales(axis: Axes, parameters: Sequence[Parameter]) -> None:
    """Scale axes x and y as the sweep is."""
    ticks: Any = axis
    for name, parameter in zip("xy", parameters, strict=False):
        if parameter.scale == "log":
            set_log(axis, name)
        else:
            ticks.locator_params(axis=name, nbins=5)


def _draw_one_parameter(axis: Axes, values: FloatArray, fopt: FloatArray, parameter: Parameter) -> None:
    axis.scatter(values, fopt, s=7, color=MEASURED_COLOUR, linewidths=0, label="set")
    if np.isfinite(fopt).any():
        least = int(np.nanargmin(fopt))
        axis.scatter(
            [values[least]],
            [fopt[least]],
            marker="*",
            s=70,
            color=LEAST_COLOUR,
            label="best set of the sweep",
        )
    axis.set(xlabel=axis_label(parameter), ylabel="Fopt (NMSE)")
    _set_scales(axis, [parameter])
    set_log(axis, "y")


def _draw_space(
    figure: Figure, flat: list[Axes], values: FloatArray, fopt: FloatArray, parameters: Sequence[Parameter]
) -> None:
    """Put a view in space where the first panel was."""
    place = flat[0].get_subplotspec()
    flat[0].remove()
    flat[0] = figure.add_subplot(place, projection="3d")
    _scatter(flat[0], tuple(values.T), fopt)
    axis: Any = flat[0]
    for one, parameter in zip((axis.xaxis, axis.yaxis, axis.zaxis), parameters, strict=True):
        one.set_label_text(axis_label(parameter))
        one.label.set_fontsize(5.5)
        one.labelpad = -9.0
    axis.tick_params(labelsize=5, pad=-3)
    axis.locator_params(nbins=3)
    axis.set_box_aspect(None, zoom=0.78)
    axis.computed_zorder = False  # the least stays on top
    axis.zaxis.set_ticks_position("lower")
    axis.zaxis.set_label_position("lower")


def _scatter(axis: Axes, at: Sequence[FloatArray], fopt: FloatArray) -> None:
    """Draw sets at coordinates (n_sets,) each: coloured, grey failed, red least."""
    draw: Any = axis.scatter
    scatter = partial(draw, depthshade=False) if axis.name == "3d" else draw
    unranked = np.isnan(fopt)
    failed = unranked & np.isfinite(at[0])
    if failed.any():
        look = {"color": "0.6", "marker": "+", "s": 14, "linewidths": 0.6}
        scatter(*(x[failed] for x in at), label=f"failed: {failed.sum()} sets", **look)
    if unranked.all():
        return
    order = np.argsort(-fopt)[: (~unranked).sum()]  # the best are on top
    scatter(*(x[order] for x in at), c=fopt[order], cmap=colours(), norm=fopt_scale(fopt), s=14,
            linewidths=0, alpha=1.0)  # fmt: skip
    least = int(np.nanargmin(fopt))
    scatter(*(x[least : least + 1] for x in at), color=LEAST_COLOUR, marker="*", s=70,
            edgecolors="white", linewidths=0.4, zorder=5,
            label=f"best set of the sweep, Fopt {fopt[least]:.3g}")  # fmt: skip


def _draw_contours(data: ReportData, axis: Axes, parameter: str, other: str) -> None:
    """Draw Fopt of the fit that leads below everything else, with its levels where nothing else is."""
    drawn = contours(data, data.generalising.name, parameter, other)
    label, write = f"Fopt of the fit to {data.together}", cast("Any", axis.text)
    if drawn:
        axis.margins(0.0)  # the lines end where the ranges do
    marks = [np.concatenate([_on_axes(axis, line, 40) for line in axis.get_lines()] or [np.zeros((0, 2))])]
    for each in drawn:
        (line,) = axis.plot(each.x, each.y, color="0.55", linewidth=0.5, zorder=1, label=label)
        at = _freest(_on_axes(axis, line), np.concatenate(marks))
        marks.append(_on_axes(axis, line)[at][None])
        box = {"facecolor": "white", "edgecolor": "none", "pad": 0.4}
        look = {"fontsize": 5, "color": "0.35", "ha": "center", "va": "center", "zorder": 1.5}
        write(each.x[at], each.y[at], f"{each.level:g}", bbox=box, **look)
        label = "_"


def _on_axes(axis: Axes, line: Line2D, n: int = 1) -> FloatArray:
    """Points (k, 2) of a line in parts of the axes, n for each of its own."""
    axis.get_xlim(), axis.get_ylim()  # they follow what has been drawn
    places = np.asarray(
        axis.transAxes.inverted().transform(line.get_transform().transform(line.get_xydata()))
    )
    at = np.linspace(0, len(places) - 1, n * len(places))
    return np.column_stack([np.interp(at, np.arange(len(places)), column) for column in places.T])


def _freest(places: FloatArray, marks: FloatArray) -> int:
    """Number of the place of a line, not at its ends, that is farthest from marks."""
    known = np.flatnonzero(np.isfinite(places[:, 0]))
    inner = known[len(known) // 10 : len(known) - len(known) // 10]
    inside = inner[(np.abs(places[inner] - 0.5) < 0.45).all(axis=1)]  # not across an axis
    inner = inside if inside.size else inner
    apart = np.linalg.norm(places[inner, None] - marks, axis=2).min(axis=1, initial=np.inf)
    return int(inner[int(np.argmax(apart))])


def _draw_region(draws: pl.DataFrame, axis: Axes, names: Sequence[str], label: str) -> None:
    """Shade the hull of the 95 % of draws that are nearest to their mean, by their covariance."""
    if not set(names) <= set(draws.columns):
        return
    values = draws.select(names).to_numpy()
    centred = values - values.mean(axis=0)
    away = (centred * (centred @ np.linalg.pinv(np.cov(centred.T)))).sum(axis=1)
    inside = values[away <= np.quantile(away, 0.95)]
    try:
        edge = inside[ConvexHull(inside).vertices]
    except QhullError:  # on a line: one parameter follows the other
        return
    look: dict[str, Any] = {"color": LINES[0][0], "alpha": 0.2, "linewidth": 0, "zorder": 2}
    axis.fill(*edge.T, label=label, **look)


def _draw_truth(data: ReportData, axis: Axes, names: Sequence[str]) -> None:
    """Draw the true value across the panel."""
    truth = data.study.truth
    look: dict[str, Any] = {"color": LEAST_COLOUR, "linestyle": ":", "linewidth": 0.7, "zorder": 2}
    if names[0] in truth:
        axis.axvline(truth[names[0]], label="true value", **look)
    if names[1] in truth:
        axis.axhline(truth[names[1]], **look)


def _draw_paths(data: ReportData, spot: str, axis: Axes, names: Sequence[str]) -> None:
    """Draw the paths of the joint fit and of the fit of a spot, or of each, along columns of these names."""
    draw: Any = axis.plot
    fits = dict.fromkeys((data.together, *((spot,) if spot else data.spots)))
    for fit, (colour, dash) in zip(fits, LINES, strict=False):
        ways = paths(data, fit, data.generalising.name, fit if fit in data.spots else spot or data.spots[0])
        for way in ways:
            draw(*(way[name] for name in names), color=colour, linestyle=dash, linewidth=0.9, zorder=4)
        for way in ways[-1:]:
            end, label = [way[name][-1:] for name in names], f"{fit}: least Fopt {way['fopt'][-1]:.3g}"
            draw(*end, "D", color=colour, markersize=4, markeredgecolor="white", zorder=6, label=label)
        if at := reported(data, fit, data.generalising.name):
            values = [at.get(name) for name in names]
            if None not in values:
                label = f"{fit}: reported values"
                draw(*([value] for value in values), "o", color=colour, markersize=5, markeredgecolor="white",
                     zorder=7, label=label)  # fmt: skip


def _colour_bar(figure: Figure, axes: Sequence[Axes], data: ReportData, fopt: FloatArray) -> None:
    bar = figure.colorbar(
        mpl.cm.ScalarMappable(fopt_scale(fopt), colours()),
        ax=list(axes),
        label=f"Fopt (NMSE), scenario {data.generalising.name}",
        shrink=0.8,
        pad=0.02,
        format=PlainNumbers(),
    )
    bar.ax.yaxis.set_minor_formatter(PlainNumbers())
