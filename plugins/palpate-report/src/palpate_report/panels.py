"""Figures of the posterior, and of the contact along the path."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.api.fit import RISE
from palpate_report.report_data import CONTACT, ReportData, label_of
from palpate_report.style import (
    DOUBLE_MM,
    LEAST_COLOUR,
    LINES,
    SINGLE_MM,
    legend_below,
    show_notice,
    sized,
)

N_COLUMNS = 3
"""Panels side by side."""


def profiles(data: ReportData) -> Figure:
    """Draw how much worse the fit is at each value, with the other parameters fitted again."""
    table, truth = data.posterior.profiles, data.study.truth
    names = list(dict.fromkeys(table["parameter"].to_list()))
    figure, axes = _panels(len(names), 50.0)
    for axis, name in zip(axes, names, strict=True):
        rows = table.filter(parameter=name).sort("value")
        axis.plot(rows["value"], rows["rise"], color=LINES[0][0], label="profile")
        axis.axhline(RISE, color="0.5", linestyle=":", linewidth=0.8, label="95 %")
        if name in truth:
            axis.axvline(truth[name], color=LEAST_COLOUR, linewidth=0.8, label="known answer")
        axis.set(xlabel=label_of(data.searched[name]), ylabel="rise of −2 log density")
    legend_below(figure, axes)
    show_notice(figure, data.notice)
    return figure


def sobol_indices(data: ReportData) -> Figure:
    """Draw the share of each parameter in the variance along each curve, a row for each spot."""
    table = data.posterior.sobol_indices
    spots, channels, names = (
        list(dict.fromkeys(table[column].to_list())) for column in ("spot", "channel", "parameter")
    )
    figure = sized(DOUBLE_MM, 42.0 * len(spots) + 18.0)
    axes = figure.subplots(len(spots), len(channels), squeeze=False)
    for row, spot in zip(axes, spots, strict=True):
        for axis, channel in zip(row, channels, strict=True):
            shares = [
                table.filter(spot=spot, channel=channel, parameter=name).sort("point") for name in names
            ]
            axis.stackplot(
                shares[0]["point"].to_numpy(),
                [100.0 * each["first"].clip(0.0, 1.0).to_numpy() for each in shares],
                labels=[data.searched[name].name for name in names],
                colors=[LINES[i % len(LINES)][0] for i in range(len(names))],
            )
            axis.set(xlabel=f"point of the {channel}", ylabel=f"share at {spot} [%]", ylim=(0.0, 100.0))
    legend_below(figure, list(axes.flat))
    show_notice(figure, data.notice)
    return figure


def contact(data: ReportData) -> Figure:
    """Draw the contact along the path of the set that was selected at each spot."""
    rows = data.selection.filter(scenario=data.generalising.name).iter_rows(named=True)
    found = {row["spot"]: data.contact.get((row["spot"], row["set_id"]), {}) for row in rows}
    names = [name for name in CONTACT if any(name in path for path in found.values())]
    figure, axes = _panels(len(names), 50.0)
    for axis, name in zip(axes, names, strict=True):
        for k, (spot, path) in enumerate(found.items()):
            if name in path:
                colour, dash = LINES[k % len(LINES)]
                steps = np.arange(1, len(path[name]) + 1)
                axis.plot(steps, path[name], color=colour, linestyle=dash, marker=".", label=spot)
        axis.set(xlabel="step of the path", ylabel=CONTACT[name], ylim=(0.0, None))
    legend_below(figure, axes)
    show_notice(figure, data.notice)
    return figure


def _panels(n: int, height_mm: float) -> tuple[Figure, Sequence[Axes]]:
    """Figure with so many panels of this height."""
    n_columns = min(n, N_COLUMNS)
    n_rows = -(-n // n_columns)
    figure = sized(DOUBLE_MM if n_columns > 1 else SINGLE_MM, height_mm * n_rows + 15.0)
    axes = list(figure.subplots(n_rows, n_columns, squeeze=False).flat)
    for empty in axes[n:]:
        empty.remove()
    return figure, axes[:n]
