"""Figures of the paper, for any channels, spots, parameters and scenarios, and of single presses."""

import gc
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import cycle, product
from pathlib import Path
from typing import Literal

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.api import Channel, Curve, FloatArray, Response
from palpate.api.runs import file_name, objectives
from palpate_report.answer.curves import fits_at, for_all_spots, residuals, same_curves
from palpate_report.answer.material import material_curves
from palpate_report.answer.model_verdict import NO_PARAMETERS, model_verdict
from palpate_report.data.report_data import ReportData
from palpate_report.figures.material import stress_strain
from palpate_report.figures.panels import causes, limbs, pressed, pressures, profiles, sobol_indices
from palpate_report.figures.space import parameter_space
from palpate_report.figures.style import (
    LEAST_COLOUR,
    LINES,
    MEASURED_COLOUR,
    Dash,
    axis_label,
    column_mm,
    finished,
    panels,
    save,
    set_log,
    sized,
    styled,
    symbols,
)
from palpate_report.settings import BY_ITSELF, ReportSettings


def write_figures(data: ReportData, folder: Path) -> tuple[Path, ...]:
    """Draw every figure as SVG, PDF and PNG."""
    folder.mkdir(parents=True, exist_ok=True)
    data, files = stamped(data), list[Path]()
    gc.freeze()  # else each collection while drawing goes through everything that was imported
    try:
        for name, is_there, draw in _drawings(data):
            if is_there:
                files += _saved(partial(draw, data), folder / name, data.settings)
    finally:
        gc.unfreeze()
    return tuple(files)


def stamped(data: ReportData) -> ReportData:
    """Data whose figures state that no parameters can be read from them, where that is so."""
    refusal = f"{NO_PARAMETERS}: not a result" if model_verdict(data).failure else ""
    return replace(data, refusal=refusal)


def _drawings(data: ReportData) -> Iterator[tuple[str, bool, Callable[[ReportData], Figure]]]:
    """Name of every figure, whether there is something to draw, and the function that draws it."""
    has_sets = data.design.n_sets > 0
    yield "nmse_distribution", has_sets, nmse_distribution
    yield "intervals", bool(data.bests), interval_plot
    yield "causes", not data.table("budget").is_empty(), causes
    yield "parameter_space", not has_sets and len(data.brief) > 1, partial(parameter_space, spot="")
    for spot in data.spots:
        yield f"parameter_space_{file_name(spot)}", has_sets, partial(parameter_space, spot=spot)
        yield f"response_{file_name(spot)}", True, partial(responses, spot=spot)
    has_joint = len(data.spots) > 1 and (data.is_fitted or not data.generalisation.is_empty())
    yield "generalised", has_joint, generalised
    has_stress = not data.refusal and any(material_curves(data, data.generalising.name))
    yield "stress_strain", has_stress, stress_strain
    yield "profiles", not data.table("profiles").is_empty(), profiles
    yield "sobol_indices", not data.table("sobol_indices").is_empty(), sobol_indices
    yield "limbs", not data.limbs.keys().isdisjoint(data.spots), limbs
    yield "pressures", bool(pressed(data)), pressures


def _saved(draw: Callable[[], Figure], stem: Path, settings: ReportSettings) -> list[Path]:
    with styled(settings):
        return save(draw(), stem)


def for_notebook(data: ReportData) -> Figure:
    """Figure of the measured and the fitted curves, in the style of the report."""
    with styled(data.settings):
        return generalised(stamped(data))


# ------------------------------------------------------------ curves by scenario


def responses(data: ReportData, spot: str) -> Figure:
    """Measured curves of a spot, and the best simulated ones of each scenario; below, what these miss."""
    measured = data.measured[spot].curves
    figure = sized(column_mm(len(measured) > 1), 90.0)
    grid = figure.subplots(2, len(measured), squeeze=False, sharex="col", height_ratios=(3, 1))
    fits = fits_at(data, spot)
    for (axis, below), (channel, curve) in zip(grid.T, measured.items(), strict=True):
        _draw_measured(axis, data, curve)
        for (label, fit), (colour, dash) in zip(fits, cycle(LINES), strict=False):
            if channel in fit:
                _draw(axis, fit[channel], colour, dash, label)
                below.plot(curve.abscissa, residuals(curve, fit[channel]), color=colour, linestyle=dash)
        axis.set_xlabel("")
        below.axhline(0.0, color="0.4", linewidth=0.6)
        below.set(
            xlabel=data.channels[channel].abscissa_label,
            ylabel=f"residual\n{_unit(data.channels[channel]).strip()}".rstrip(),
        )
    figure.align_ylabels()
    return finished(figure, grid[0], data.stamp)


def _draw_measured(
    axis: Axes, data: ReportData, curve: Curve, label: str = "experiment", colour: str = MEASURED_COLOUR
) -> None:
    few = curve.abscissa.size <= 80
    _draw_band(axis, curve)
    axis.plot(
        curve.abscissa,
        curve.ordinate,
        color=colour,
        marker="o",
        markersize=2.6 if few else 2.0,
        markevery=1 if few else max(1, curve.abscissa.size // 60),
        markerfacecolor="none",
        markeredgewidth=0.6,
        linestyle="none",
        zorder=4,
        label=f"{label} (simulated)" if data.notice else label,
    )
    _label(axis, data.channels[curve.channel])


def _label(axis: Axes, channel: Channel) -> None:
    axis.set_xlabel(channel.abscissa_label)
    axis.set_ylabel(channel.ordinate_label)


def _unit(channel: Channel) -> str:
    """Unit of the ordinate, as its label ends with it in brackets; empty without one."""
    found = re.search(r" *[\[(][^\])]*[\])]$", channel.ordinate_label)
    return found[0] if found else ""


def _draw(axis: Axes, curve: Curve, colour: str, dash: Dash, label: str) -> None:
    axis.plot(curve.abscissa, curve.ordinate, color=colour, linestyle=dash, label=label)


def _draw_band(axis: Axes, curve: Curve) -> None:
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


def generalised(data: ReportData) -> Figure:
    """Show the joint fit, or the one set for all spots, on the measured curves of every spot."""
    return _curves({"": data})


def write_comparison_figures(runs: Mapping[str, ReportData], folder: Path) -> list[Path]:
    """Draw the parameters of several runs as ``parameters``, and their curves as ``curves``."""
    folder.mkdir(parents=True, exist_ok=True)
    every = {name: stamped(data) for name, data in runs.items()}
    settings = next(iter(runs.values())).settings
    files = (
        [] if not _common(every) else _saved(partial(draw_parameters, every), folder / "parameters", settings)
    )
    return files + _saved(partial(_curves, every), folder / "curves", settings)


def _common(runs: Mapping[str, ReportData]) -> list[tuple[str, str]]:
    """Names and units of initial moduli, then of parameters, that several runs report."""
    found = Counter((each.parameter, each.unit) for data in runs.values() for each in data.moduli)
    found.update((each.parameter, each.unit) for data in runs.values() for each in data.estimates)
    # Most parameters that runs are compared by in a figure.
    return [key for key, n in found.items() if n > 1][:6]


def draw_parameters(runs: Mapping[str, ReportData]) -> Figure:
    """Values and intervals of each parameter that several runs report, a row for each run."""
    common, places = _common(runs), range(len(runs))
    n_columns = min(len(common), 3)
    figure, axes = panels(len(common), n_columns, 7.0 * len(runs) + 14.0, 8.0)
    for number, (axis, (parameter, unit)) in enumerate(zip(axes, common, strict=True)):
        for place, (data, (colour, _)) in enumerate(zip(runs.values(), cycle(LINES), strict=False)):
            for each in (*data.moduli, *data.estimates):
                if (each.parameter, each.unit) != (parameter, unit) or each.value is None:
                    continue
                if each.level and each.lower is not None and each.upper is not None:
                    axis.plot([each.lower, each.upper], [place, place], "-|", color=colour, markersize=4.0)
                axis.plot(each.value, place, "o", color=colour, markersize=3.5)
        axis.set_yticks(places, list(runs) if number % n_columns == 0 else [""] * len(runs))
        axis.set_ylim(len(runs) - 0.5, -0.5)
        axis.set_xlabel(symbols(f"{parameter} ({unit})" if unit else parameter))
        axis.locator_params(axis="x", nbins=4)
    notices = dict.fromkeys(data.notice for data in runs.values() if data.notice)
    return finished(figure, axes, "\n".join(notices))


def _curves(runs: Mapping[str, ReportData]) -> Figure:
    """Curves by channel and spot, on the same axes along a row where they are of one run."""
    spots = list(dict.fromkeys(spot for data in runs.values() for spot in data.spots))
    channels = list(dict.fromkeys(name for data in runs.values() for name in data.measured_channels))
    figure = sized(column_mm(len(spots) > 1), 46.0 * len(channels) + 22.0)
    shared: Literal["row", "none"] = "row" if len(runs) == 1 else "none"
    axes = figure.subplots(len(channels), len(spots), squeeze=False, sharex=shared, sharey=shared)
    same = same_curves(runs)
    for k, ((name, data), (colour, dash)) in enumerate(zip(runs.items(), cycle(LINES), strict=False)):
        for (i, channel), (j, spot) in product(enumerate(channels), enumerate(spots)):
            if spot not in data.measured or channel not in data.measured[spot].curves:
                continue
            if k == 0 or not same:
                whose = ("experiment", MEASURED_COLOUR) if same else (f"{name}: experiment", colour)
                _draw_measured(axes[i, j], data, data.measured[spot][channel], *whose)
            label, fitted = for_all_spots(data, spot)
            if channel in fitted:
                _draw(axes[i, j], fitted[channel], colour, dash, name or label)
            if j and shared == "row":
                axes[i, j].set_ylabel("")
    for spot, axis in zip(spots, axes[0], strict=True):
        axis.set_title(f"spot {spot}")
    for axis in axes.flat:
        if not axis.has_data():
            axis.set_axis_off()
    notices = dict.fromkeys(data.notice for data in runs.values() if data.notice)
    refusals = (
        f"{name}: {data.refusal}" if name else data.refusal for name, data in runs.items() if data.refusal
    )
    return finished(figure, axes.flat, "\n".join([*notices, *refusals]))


# ------------------------------------------------------------------ the intervals


MARKERS = ("o", "s", "^", "D", "v", "P")
"""Of the scenarios."""


def interval_plot(data: ReportData) -> Figure:
    """Parameters of the fits, else of the best sets, by spot and scenario; the interval that leads is shaded.

    Intervals are 95 % intervals of a fit, else the sets that fit about as well in the sweep.
    """
    bests = [best for best in data.bests if best.scenario in data.shown_scenarios]
    fits = [best for best in bests if best.found == "fit"] or bests
    lead = data.lead if len(data.spots) > 1 else None
    is_sure = any(value.level for best in fits for value in best.values)
    spots, names = list(dict.fromkeys(best.spot for best in fits)), list(data.searched.items())
    figure = sized(column_mm(len(names) > 1), 14.0 * len(spots) + 36.0)
    figure.set_layout_engine("constrained", wspace=0.08)  # ticks of neighbours stay apart
    axes = figure.subplots(1, len(names), squeeze=False, sharey=True)[0]
    scenarios = [s.name for s in data.study.scenarios]
    for k, (axis, (name, parameter)) in enumerate(zip(axes, names, strict=True)):
        for best in fits:
            if (found := best.values[k]).value is None:
                continue
            i = scenarios.index(best.scenario)
            at = spots.index(best.spot) + 0.6 * ((i + 0.5) / len(scenarios) - 0.5)
            look = {"color": LINES[i % len(LINES)][0], "marker": MARKERS[i % len(MARKERS)], "markersize": 3.5}
            is_alike = bool(found.level) == is_sure  # one kind of interval in a figure
            if is_alike and found.lower is not None and found.upper is not None:
                ends = [found.lower, found.upper]
                width = 1.6 if best.scenario == data.generalising.name else 0.8
                axis.plot(ends, [at, at], "-|", linewidth=width, color=look["color"], markersize=4.0)
                if best is lead:
                    axis.axvspan(*ends, color=MEASURED_COLOUR, alpha=0.12, linewidth=0)
            label = f"scenario {best.scenario}: {best.fitted_to}"
            axis.plot(found.value, at, linestyle="none", label=label, **look)
        if (truth := data.study.truth.get(name)) is not None:
            axis.axvline(truth, color=LEAST_COLOUR, linewidth=0.8, label="true value")
        if parameter.scale == "log":
            set_log(axis, "x")
        else:
            axis.locator_params(axis="x", nbins=4)
        axis.set_xlabel(axis_label(data.widened.get(name, parameter)))
    axes[0].set_yticks(range(len(spots)), spots)
    axes[0].set_ylim(len(spots) - 0.5, -0.5)
    return finished(figure, axes, data.stamp)


# ------------------------------------------------------------- NMSE over the sets


def nmse_distribution(data: ReportData) -> Figure:
    """Fopt of every set at each spot, on a log scale."""
    rows = objectives(data.scores, [data.generalising])
    figure = sized(column_mm(len(data.spots) > 6), 75.0)
    axis = figure.subplots()
    for place, spot in enumerate(data.spots):
        fopt = rows.filter(pl.col("spot") == spot)["fopt"].to_numpy()
        _draw_distribution(axis, place, fopt)
    axis.set_xticks(range(len(data.spots)), data.spots)
    axis.set_xlim(-0.6, len(data.spots) - 0.4)
    set_log(axis, "y")
    axis.set_xlabel("spot")
    axis.set_ylabel(f"Fopt (NMSE), scenario {data.generalising.name}")
    return finished(figure, [axis], data.stamp)


def _draw_distribution(axis: Axes, place: int, fopt: FloatArray) -> None:
    if not fopt.size:
        return
    shown = np.sort(fopt)
    # The golden ratio spreads neighbours evenly, and the same data always look the same.
    spread = (np.arange(shown.size) * 0.6180339887 % 1.0 - 0.5) * 0.5
    axis.scatter(place + spread, shown, s=7, color=MEASURED_COLOUR, alpha=0.5, linewidths=0, label="set")
    axis.hlines(float(np.median(fopt)), place - 0.32, place + 0.32, color="black", linewidth=1.3,
                label="median of all sets")  # fmt: skip
    axis.scatter([place], shown[:1], marker="*", s=50, color=LEAST_COLOUR, zorder=4, clip_on=False,
                 label="least")  # fmt: skip


# ------------------------------------------------------------ presses of one spot


def draw_presses(
    spot: str,
    presses: Mapping[str, Response],
    mean: Response,
    channels: Mapping[str, Channel],
    notice: str,
    folder: Path,
) -> tuple[Path, ...]:
    """Draw ``curves.svg``, ``curves.pdf`` and ``curves.png``: each channel in its own panel.

    For the arguments see :meth:`palpate_report.stage.ReportStage.draw_presses`.
    """

    def draw() -> Figure:
        figure = sized(column_mm(len(mean.curves) > 1), 75.0)
        axes = figure.subplots(1, len(mean.curves), squeeze=False)[0]
        for axis, (name, curve) in zip(axes, mean.curves.items(), strict=True):
            _draw_channel(axis, [each[name] for each in presses.values() if name in each.curves], curve)
            _label(axis, channels[name])
        return finished(figure, axes, notice)

    return tuple(_saved(draw, folder / "curves", BY_ITSELF))


def _draw_channel(axis: Axes, repeats: Sequence[Curve], mean: Curve) -> None:
    label = "press"
    if len(repeats) > 1:
        label = f"mean of {len(repeats)} presses"
        for k, curve in enumerate(repeats):
            of_all = "_" if k else f"{len(repeats)} presses"
            axis.plot(curve.abscissa, curve.ordinate, label=of_all, color="0.45", linewidth=0.8)
    _draw_band(axis, mean)
    axis.plot(mean.abscissa, mean.ordinate, color=MEASURED_COLOUR, label=label)
