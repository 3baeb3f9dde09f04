"""The space of the parameters, coloured by NMSE, as the paper shows it."""

from collections.abc import Sequence
from functools import partial
from itertools import combinations
from typing import Any

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.figure import Figure

from palpate.domain import FloatArray, Parameter
from palpate.report.fit_path import paths
from palpate.report.report_data import ReportData, label_of
from palpate.report.style import (
    DOUBLE_MM,
    LEAST_COLOUR,
    LINES,
    MEASURED_COLOUR,
    SINGLE_MM,
    entitle,
    legend_below,
    sized,
)
from palpate.stages.selection import objectives

COLOUR_LIMIT = 2.5
"""NMSE up to which the parameter space is coloured; above it is black."""

MOST_PAIRS = 15
"""Most pairs of parameters that one figure shows."""

_PANEL_MM = {1: 65.0, 2: 60.0, 4: 42.0}
"""Height of a panel by the number of columns."""


def colours() -> Colormap:
    """Viridis without its dark end, which could be taken for the black of what is above."""
    viridis = mpl.colormaps["viridis"]
    return LinearSegmentedColormap.from_list("nmse", viridis(np.linspace(0.25, 1.0, 256)))


def parameter_space(data: ReportData, spot: str) -> Figure:
    """Show sets in the space of their parameters: coloured by NMSE, black above the limit, red the least.

    The ways of the joint fit and of the spot's own are drawn over them, each to a diamond at its end.
    Three parameters are shown in space and in pairs, more in pairs (at most ``MOST_PAIRS``), one over
    its own axis.
    """
    values, fopt = _sets_at(data, spot)
    parameters = tuple(data.brief.values())
    n = len(parameters)
    if n == 1:
        figure, flat = _one_parameter(values[:, 0], fopt, parameters[0])
        _draw_paths(data, spot, flat[0], [data.design.parameters[0].name, "fopt"])
    else:
        pairs = list(combinations(range(n), 2))[:MOST_PAIRS]
        figure, flat = _pair_grid(len(pairs) + (n == 3))
        if n == 3:
            _draw_space(figure, flat, values, fopt, parameters)
            _draw_paths(data, spot, flat[0], [p.name for p in data.design.parameters])
        for axis, (i, j) in zip(flat[n == 3 :], pairs, strict=True):
            _scatter(axis, (values[:, i], values[:, j]), fopt)
            _draw_paths(data, spot, axis, [data.design.parameters[k].name for k in (i, j)])
            axis.set_xlabel(label_of(parameters[i]))
            axis.set_ylabel(label_of(parameters[j]))
            axis.locator_params(nbins=5)
    if n > 1:
        _colour_bar(figure, flat, data)
    legend_below(figure, flat[-1:])
    n_sets = int(np.isfinite(values[:, 0]).sum())
    shown = f"{n_sets} sets and their NMSE" if data.design.n_sets else "the way of the fit"
    entitle(figure, f"{data.study.name}, spot {spot}: {shown}", data.notice)
    return figure


def _sets_at(data: ReportData, spot: str) -> tuple[FloatArray, FloatArray]:
    """Values of every set, NaN where it was not simulated, and its Fopt at a spot, NaN where it failed."""
    rows = objectives(data.scores, [data.generalising]).filter(pl.col("spot") == spot)
    fopt = np.full(data.design.n_sets, np.nan)
    fopt[rows["set_id"].to_numpy()] = rows["fopt"].to_numpy()
    simulated = np.isin(np.arange(fopt.size), data.scores.filter(pl.col("spot") == spot)["set_id"])
    return np.where(simulated[:, None], data.design.values, np.nan), fopt


def _one_parameter(values: FloatArray, fopt: FloatArray, parameter: Parameter) -> tuple[Figure, list[Axes]]:
    figure = sized(SINGLE_MM, 70.0)
    axis = figure.subplots()
    axis.scatter(values, fopt, s=7, color=MEASURED_COLOUR, linewidths=0, label="set")
    if np.isfinite(fopt).any():
        least = int(np.nanargmin(fopt))
        axis.scatter(
            [values[least]], [fopt[least]], marker="*", s=70, color=LEAST_COLOUR, label=f"least: set {least}"
        )
    axis.set_xlabel(label_of(parameter))
    axis.set_ylabel("Fopt (NMSE)")
    return figure, [axis]


def _pair_grid(n_panels: int) -> tuple[Figure, list[Axes]]:
    n_columns = min(n_panels, 2 if n_panels <= 4 else 4)
    n_rows = -(-n_panels // n_columns)
    figure = sized(DOUBLE_MM if n_columns > 1 else SINGLE_MM, _PANEL_MM[n_columns] * n_rows + 18.0)
    axes = list(figure.subplots(n_rows, n_columns, squeeze=False).flat)
    for empty in axes[n_panels:]:
        empty.remove()
    return figure, axes[:n_panels]


def _draw_space(
    figure: Figure, flat: list[Axes], values: FloatArray, fopt: FloatArray, parameters: Sequence[Parameter]
) -> None:
    """Put a view in space where the first panel was."""
    place = flat[0].get_subplotspec()
    flat[0].remove()
    flat[0] = figure.add_subplot(place, projection="3d")
    _scatter(flat[0], tuple(values.T), fopt)
    axis: Any = flat[0]
    for set_label, parameter in zip(
        (axis.set_xlabel, axis.set_ylabel, axis.set_zlabel), parameters, strict=True
    ):
        set_label(label_of(parameter), fontsize=5.5)
    axis.tick_params(labelsize=5, pad=-3)
    axis.locator_params(nbins=4)
    axis.set_box_aspect(None, zoom=0.78)
    axis.computed_zorder = False  # the least stays on top
    axis.zaxis.set_ticks_position("lower")
    axis.zaxis.set_label_position("lower")


def _scatter(axis: Axes, at: Sequence[FloatArray], fopt: FloatArray) -> None:
    """Draw sets at coordinates (n_sets,) each: coloured, black above the limit, grey failed, red least."""
    draw: Any = axis.scatter
    scatter = partial(draw, depthshade=False) if axis.name == "3d" else draw
    unranked, above = np.isnan(fopt), fopt > COLOUR_LIMIT
    failed = unranked & np.isfinite(at[0])
    kinds = {
        "failed": (failed, {"color": "0.6", "marker": "+", "s": 14, "linewidths": 0.6}),
        f"NMSE above {COLOUR_LIMIT:g}": (
            above,
            {"color": "black", "marker": "x", "s": 9, "linewidths": 0.5},
        ),
    }
    for label, (where, look) in kinds.items():
        if where.any():
            scatter(*(x[where] for x in at), label=f"{label}: {where.sum()} sets", **look)
    # The best are on top.
    order = np.argsort(-np.where(unranked | above, -np.inf, fopt))
    order = order[~(unranked | above)[order]]
    scatter(*(x[order] for x in at), c=fopt[order], cmap=colours(), vmin=0.0, vmax=COLOUR_LIMIT, s=14,
            linewidths=0, alpha=1.0)  # fmt: skip
    if not unranked.all():
        least = int(np.nanargmin(fopt))
        scatter(*(x[least : least + 1] for x in at), color=LEAST_COLOUR, marker="*", s=70,
                edgecolors="white", linewidths=0.4, zorder=5,
                label=f"least: set {least}, {fopt[least]:.3g}")  # fmt: skip


def _draw_paths(data: ReportData, spot: str, axis: Axes, names: Sequence[str]) -> None:
    """Draw the ways of the joint fit and of that of a spot along their columns of these names."""
    draw: Any = axis.plot
    for fit, (colour, dash) in zip(dict.fromkeys((data.together, spot)), LINES, strict=False):
        ways = paths(data, fit, data.generalising.name, spot)
        for way in ways:
            draw(*(way[name] for name in names), color=colour, linestyle=dash, linewidth=0.9, zorder=4)
        for way in ways[-1:]:
            end, label = [way[name][-1:] for name in names], f"{fit}: fit, {way['fopt'][-1]:.3g}"
            draw(*end, "D", color=colour, markersize=4, markeredgecolor="white", zorder=6, label=label)


def _colour_bar(figure: Figure, axes: Sequence[Axes], data: ReportData) -> None:
    scale = mpl.cm.ScalarMappable(mpl.colors.Normalize(0.0, COLOUR_LIMIT), colours())
    figure.colorbar(
        scale,
        ax=list(axes),
        label=f"Fopt (NMSE), scenario {data.generalising.name}",
        shrink=0.8,
        pad=0.02,
    )
