"""The paper's figures, for any channels, spots, parameters and scenarios."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.figure import Figure

from palpate.domain import Curve, FloatArray, Parameter
from palpate.report.content import Content
from palpate.run_directory import file_name
from palpate.selection import objectives

COLOUR_LIMIT = 2.5
"""NMSE up to which the parameter space is coloured; above it is black."""

DISTRIBUTION_LIMIT = 4.0
"""NMSE at which the distribution is cut."""

MOST_PAIRS = 15
"""Most pairs of parameters that one figure shows."""

STYLE: Mapping[str, Any] = MappingProxyType(
    {
        "figure.dpi": 160,
        "figure.constrained_layout.use": True,
        "font.size": 9.0,
        "axes.titlesize": 9.0,
        "axes.labelsize": 9.0,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.color": "0.9",
        "grid.linewidth": 0.6,
        "axes.axisbelow": True,
        "legend.frameon": False,
        "legend.fontsize": 8.0,
        "lines.linewidth": 1.4,
        "svg.hashsalt": "palpate",
    }
)

Dash = str | tuple[int, tuple[int, ...]]

MEASURED_COLOUR = "#0072B2"
_LEAST = "#D7191C"
_LINES: tuple[tuple[str, Dash], ...] = (
    ("#D55E00", "-"),
    ("#E69F00", "--"),
    ("#CC79A7", "-."),
    ("#009E73", ":"),
    ("#56B4E9", (0, (5, 1, 1, 1, 1, 1))),
    ("#000000", (0, (1, 1))),
)
"""Okabe and Ito's colours, which people with any colour vision tell apart, each with its dash."""


def write_figures(content: Content, folder: Path) -> tuple[Path, ...]:
    """Draw every figure as SVG and PNG, and remove those of an earlier report."""
    for old in (*folder.glob("*.svg"), *folder.glob("*.png")):
        old.unlink()
    folder.mkdir(parents=True, exist_ok=True)
    drawings: dict[str, Callable[[], Figure]] = {"nmse_distribution": partial(nmse_distribution, content)}
    for spot in content.spots:
        drawings[f"parameter_space_{file_name(spot)}"] = partial(parameter_space, content, spot)
        drawings[f"response_{file_name(spot)}"] = partial(responses, content, spot)
    if not content.generalisation.is_empty():
        drawings["generalised"] = partial(generalised, content)
    files: list[Path] = []
    for name, draw in drawings.items():
        # The context is left before the next figure, so that nobody else's style changes.
        with mpl.rc_context(cast("Any", dict(STYLE))):
            files += save(draw(), folder / name)
    return tuple(files)


def save(figure: Figure, stem: Path) -> list[Path]:
    """Write a figure as ``<stem>.svg`` and ``<stem>.png``."""
    svg, png = stem.with_name(f"{stem.name}.svg"), stem.with_name(f"{stem.name}.png")
    FigureCanvasSVG(figure).print_figure(svg, metadata={"Date": None})
    figure.set_layout_engine("none")  # what the first drawing has laid out stays
    FigureCanvasAgg(figure).print_figure(png, dpi=figure.dpi)
    return [svg, png]


def _titled(figure: Figure, content: Content, title: str) -> None:
    figure.suptitle(f"{title}\n{content.notice}" if content.notice else title, fontsize=10)


# ------------------------------------------------------------ curves by scenario


def responses(content: Content, spot: str) -> Figure:
    """Measured curves of a spot, and the best simulated ones of each scenario."""
    measured = content.measured[spot].curves
    figure = Figure(figsize=(4.2 * len(measured), 3.6))
    axes = figure.subplots(1, len(measured), squeeze=False)[0]
    for axis, (channel, curve) in zip(axes, measured.items(), strict=True):
        _draw_measured(axis, content, curve)
        for i, scenario in enumerate(content.study.scenarios):
            colour, dash = _LINES[i % len(_LINES)]
            label, fit = _fit(content, spot, scenario.name)
            if channel in fit:
                _draw(axis, fit[channel], colour, dash, label)
    legend_below(figure, axes[:1])
    _titled(figure, content, f"{content.study.name}, spot {spot}: least NMSE by scenario")
    return figure


def _fit(content: Content, spot: str, scenario: str) -> tuple[str, Mapping[str, Curve]]:
    """Label and curves of a scenario at a spot: the refined ones, else those of the selected set."""
    if (refined := content.refined.responses.get((spot, scenario))) is not None:
        return f"scenario {scenario}, refined", refined.curves
    rows = content.selection.filter((pl.col("spot") == spot) & (pl.col("scenario") == scenario))
    for row in rows.iter_rows(named=True):
        if (response := content.responses.get((spot, row["set_id"]))) is not None:
            return f"scenario {scenario}, set {row['set_id']}", response.curves
    return scenario, {}


def _draw_measured(axis: Axes, content: Content, curve: Curve) -> None:
    channel = content.channels[curve.channel]
    few = curve.abscissa.size <= 80
    draw_band(axis, curve)
    axis.plot(
        curve.abscissa,
        curve.ordinate,
        color=MEASURED_COLOUR,
        marker="o",
        markersize=3.5 if few else 2.5,
        markevery=1 if few else max(1, curve.abscissa.size // 60),
        markerfacecolor="none",
        linestyle="none",
        zorder=4,
        label="experiment (simulated)" if content.notice else "experiment",
    )
    axis.set_xlabel(channel.abscissa_label)
    axis.set_ylabel(channel.ordinate_label)


def _draw(axis: Axes, curve: Curve, colour: str, dash: Dash, label: str) -> None:
    axis.plot(curve.abscissa, curve.ordinate, color=colour, linestyle=dash, label=label)


def draw_band(axis: Axes, curve: Curve) -> None:
    """Shade one standard deviation to each side of a curve that has it."""
    if curve.std is None:
        return
    for start, stop in curve.branches:
        axis.fill_between(
            curve.abscissa[start:stop],
            (curve.ordinate - curve.std)[start:stop],
            (curve.ordinate + curve.std)[start:stop],
            color=MEASURED_COLOUR,
            alpha=0.2,
            linewidth=0,
            label="_" if start else "± one standard deviation",
        )


def legend_below(figure: Figure, axes: Sequence[Axes]) -> None:
    """Put one legend of everything that these axes show below a figure."""
    labelled: dict[str, Any] = {}
    for axis in axes:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            labelled.setdefault(label, handle)
    widest = max(len(label) for label in labelled)
    n_columns = int(figure.get_figwidth() / (0.55 + 0.068 * widest))
    figure.legend(
        list(labelled.values()),
        list(labelled),
        loc="outside lower center",
        ncols=max(1, min(n_columns, len(labelled))),
    )


def generalised(content: Content) -> Figure:
    """Show the one set for all spots on the measured curves of every spot."""
    channels, spots = content.measured_channels, content.spots
    figure = Figure(figsize=(3.0 * len(spots) + 0.6, 2.6 * len(channels) + 0.9))
    axes = figure.subplots(len(channels), len(spots), squeeze=False)
    row = content.generalisation.row(0, named=True)
    colour, dash = _LINES[0]
    for j, spot in enumerate(spots):
        simulated = content.responses.get((spot, row["set_id"]))
        for i, channel in enumerate(channels):
            axis = axes[i, j]
            if channel in content.measured[spot].curves:
                _draw_measured(axis, content, content.measured[spot][channel])
            else:
                axis.set_axis_off()
            if simulated is not None and channel in simulated.curves:
                _draw(axis, simulated[channel], colour, dash, f"set {row['set_id']}")
        axes[0, j].set_title(f"spot {spot}: Fopt {_fopt_at(content, spot):.3g}")
    legend_below(figure, list(axes.flat))
    spread = "" if row["fopt_sd"] is None else f" ± {row['fopt_sd']:.2g}"
    title = f"{content.study.name}: one set for all spots, mean Fopt {row['fopt_mean']:.4g}{spread}"
    _titled(figure, content, title)
    return figure


def _fopt_at(content: Content, spot: str) -> float:
    return float(content.generalisation.filter(pl.col("spot") == spot)["fopt"][0])


# ------------------------------------------------------------- NMSE over the sets


def nmse_distribution(content: Content) -> Figure:
    """Fopt of every set at each spot, cut at ``DISTRIBUTION_LIMIT``."""
    rows = objectives(content.scores, [content.generalising])
    figure = Figure(figsize=(1.3 * len(content.spots) + 2.4, 3.8))
    axis = figure.subplots()
    for place, spot in enumerate(content.spots):
        fopt = rows.filter(pl.col("spot") == spot)["fopt"].to_numpy()
        _draw_distribution(axis, place, fopt)
    axis.set_xticks(range(len(content.spots)), content.spots)
    axis.set_xlim(-0.6, len(content.spots) - 0.4)
    axis.set_ylim(0.0, DISTRIBUTION_LIMIT * 1.12)
    axis.axhline(DISTRIBUTION_LIMIT, color="0.4", linewidth=0.8, linestyle="--")
    axis.set_xlabel("spot")
    axis.set_ylabel(f"Fopt (NMSE), scenario {content.generalising.name}")
    legend_below(figure, [axis])
    _titled(figure, content, f"{content.study.name}: NMSE of {content.design.n_sets} sets per spot")
    return figure


def _draw_distribution(axis: Axes, place: int, fopt: FloatArray) -> None:
    shown = np.sort(fopt[fopt <= DISTRIBUTION_LIMIT])
    # The golden ratio spreads neighbours evenly, and the same data always look the same.
    spread = (np.arange(shown.size) * 0.6180339887 % 1.0 - 0.5) * 0.5
    # Matplotlib leaves what begins with an underscore out of the legend.
    hide = "" if place == 0 else "_"
    axis.scatter(
        place + spread, shown, s=9, color=MEASURED_COLOUR, alpha=0.5, linewidths=0, label=f"{hide}set"
    )
    if fopt.size:
        least, middle = float(fopt.min()), float(np.median(fopt))
        if middle <= DISTRIBUTION_LIMIT:
            axis.hlines(middle, place - 0.32, place + 0.32, color="black", linewidth=1.6,
                        label=f"{hide}median of all sets")  # fmt: skip
        if least <= DISTRIBUTION_LIMIT:
            axis.scatter([place], [least], marker="*", s=90, color=_LEAST, zorder=4, clip_on=False,
                         label=f"{hide}least")  # fmt: skip
    n_above = int((fopt > DISTRIBUTION_LIMIT).sum())
    if n_above:
        axis.text(place, DISTRIBUTION_LIMIT * 1.06, f"{n_above} above", ha="center", va="center", fontsize=8)


def _colours() -> Colormap:
    """Viridis without its dark end, which could be taken for the black of what is above."""
    viridis = mpl.colormaps["viridis"]
    return LinearSegmentedColormap.from_list("nmse", viridis(np.linspace(0.25, 1.0, 256)))


def parameter_space(content: Content, spot: str) -> Figure:
    """Show sets in the space of their parameters: coloured by NMSE, black above the limit, red the least.

    Three parameters are shown in space and in pairs, more in pairs (at most
    ``MOST_PAIRS``), one over its own axis.
    """
    values, fopt = _sets_at(content, spot)
    parameters = _named_briefly(content.design.parameters)
    n = len(parameters)
    if n == 1:
        figure, flat = _one_parameter(values[:, 0], fopt, parameters[0])
    else:
        pairs = list(combinations(range(n), 2))[:MOST_PAIRS]
        figure, flat = _pair_grid(len(pairs) + (n == 3))
        if n == 3:
            _draw_space(figure, flat, values, fopt, parameters)
        for axis, (i, j) in zip(flat[n == 3 :], pairs, strict=True):
            _scatter(axis, (values[:, i], values[:, j]), fopt)
            axis.set_xlabel(_label(parameters[i]))
            axis.set_ylabel(_label(parameters[j]))
    if n > 1:
        _colour_bar(figure, flat, content)
    legend_below(figure, flat[-1:])
    _titled(figure, content, f"{content.study.name}, spot {spot}: {len(fopt)} sets and their NMSE")
    return figure


def _sets_at(content: Content, spot: str) -> tuple[FloatArray, FloatArray]:
    """Values of every set and its Fopt at a spot, NaN where it failed."""
    rows = objectives(content.scores, [content.generalising]).filter(pl.col("spot") == spot)
    fopt = np.full(content.design.n_sets, np.nan)
    fopt[rows["set_id"].to_numpy()] = rows["fopt"].to_numpy()
    return content.design.values, fopt


def _one_parameter(values: FloatArray, fopt: FloatArray, parameter: Parameter) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(4.6, 3.6))
    axis = figure.subplots()
    axis.scatter(values, fopt, s=14, color=MEASURED_COLOUR, linewidths=0, label="set")
    if np.isfinite(fopt).any():
        least = int(np.nanargmin(fopt))
        axis.scatter(
            [values[least]], [fopt[least]], marker="*", s=110, color=_LEAST, label=f"least: set {least}"
        )
    axis.set_xlabel(_label(parameter))
    axis.set_ylabel("Fopt (NMSE)")
    return figure, [axis]


def _pair_grid(n_panels: int) -> tuple[Figure, list[Axes]]:
    n_columns = min(n_panels, 2 if n_panels <= 4 else 4)
    n_rows = -(-n_panels // n_columns)
    figure = Figure(figsize=(3.5 * n_columns + 0.9, 3.0 * n_rows + 0.7))
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
        set_label(_label(parameter), fontsize=7)
    axis.tick_params(labelsize=6, pad=-1)
    axis.locator_params(nbins=4)
    axis.set_box_aspect(None, zoom=0.78)
    axis.computed_zorder = False  # the least stays on top
    axis.zaxis.set_ticks_position("lower")
    axis.zaxis.set_label_position("lower")


def _scatter(axis: Axes, at: Sequence[FloatArray], fopt: FloatArray) -> None:
    """Draw sets at coordinates (n_sets,) each: coloured, black above the limit, grey failed, red least."""
    draw: Any = axis.scatter
    scatter = partial(draw, depthshade=False) if axis.name == "3d" else draw
    failed, above = np.isnan(fopt), fopt > COLOUR_LIMIT
    kinds = {
        "failed": (failed, {"color": "0.6", "marker": "+", "s": 18}),
        f"NMSE above {COLOUR_LIMIT:g}": (
            above,
            {"color": "black", "marker": "x", "s": 12, "linewidths": 0.8},
        ),
    }
    for label, (where, look) in kinds.items():
        if where.any():
            scatter(*(x[where] for x in at), label=f"{label}: {where.sum()} sets", **look)
    # The best lie on top.
    order = np.argsort(-np.where(failed | above, -np.inf, fopt))
    order = order[~(failed | above)[order]]
    scatter(*(x[order] for x in at), c=fopt[order], cmap=_colours(), vmin=0.0, vmax=COLOUR_LIMIT, s=18,
            linewidths=0, alpha=1.0)  # fmt: skip
    if not failed.all():
        least = int(np.nanargmin(fopt))
        scatter(*(x[least : least + 1] for x in at), color=_LEAST, marker="*", s=120, edgecolors="white",
                linewidths=0.5, zorder=5, label=f"least: set {least}, {fopt[least]:.3g}")  # fmt: skip


def _colour_bar(figure: Figure, axes: Sequence[Axes], content: Content) -> None:
    colours = mpl.cm.ScalarMappable(mpl.colors.Normalize(0.0, COLOUR_LIMIT), _colours())
    figure.colorbar(
        colours,
        ax=list(axes),
        label=f"Fopt (NMSE), scenario {content.generalising.name}",
        shrink=0.8,
        pad=0.02,
    )


def _named_briefly(parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """Parameters without the name of their region, where there is only one."""
    if len({p.name.partition(".")[0] for p in parameters}) > 1:
        return tuple(parameters)
    return tuple(replace(p, name=p.name.partition(".")[2]) for p in parameters)


def _label(parameter: Parameter) -> str:
    return parameter.name if parameter.unit in ("", "1") else f"{parameter.name} [{parameter.unit}]"
