"""Figures of causes, limbs, pressures, and the posterior."""

import colorsys
import zlib
from collections.abc import Iterator
from typing import Any

from matplotlib.figure import Figure

from palpate.api import Indentation, SurfaceStates, convert
from palpate.api.fit import RISE
from palpate_report.answer.next_step import COLOURS, cause_name
from palpate_report.data.report_data import ReportData
from palpate_report.figures.limb_drawing import draw_limb, from_the_side, legend_of
from palpate_report.figures.limb_view import ViewPart, limb_view
from palpate_report.figures.scene import coarsened, deepest
from palpate_report.figures.skin_map import draw_map
from palpate_report.figures.style import (
    LEAST_COLOUR,
    LINES,
    axis_label,
    column_mm,
    finished,
    lettered,
    panels,
    sized,
    symbol,
    symbols,
)

MOST_TRIANGLES = 8000
"""Triangles of a limb that is drawn for print."""


def colour_of(name: str) -> str:
    """Colour of a cause, or of another share: the same for a name in every bar."""
    if name in COLOURS:
        return COLOURS[name]
    hue = zlib.crc32(name.encode("utf-8", "replace")) % 360 / 360.0
    return "#" + "".join(f"{round(255.0 * part):02x}" for part in colorsys.hls_to_rgb(hue, 0.55, 0.4))


def budget_bars(data: ReportData) -> Iterator[tuple[str, list[tuple[str, float]]]]:
    """Causes of each interval that leads, with their shares in percent, the largest first."""
    budget = data.leading_rows(data.table("budget"))
    for (name,), causes in budget.drop_nulls("share").group_by("parameter", maintain_order=True):
        shares = causes.sort("share", descending=True).select("cause", "share").iter_rows()
        yield (
            data.brief_name(str(name)),
            [(cause_name(data, cause), round(100.0 * share, 1)) for cause, share in shares if share >= 0.005],
        )


def causes(data: ReportData) -> Figure:
    """Draw the share of each cause in the variance of the parameters that lead."""
    bars = list(budget_bars(data))
    figure = sized(column_mm(True), 8.0 * len(bars) + 32.0)
    axis = figure.subplots()
    for place, (_, parts) in enumerate(bars):
        left = 0.0
        for cause, share in parts:
            axis.barh(place, share, 0.6, left, color=colour_of(cause), label=symbols(cause))
            left += share
    axis.set_yticks(range(len(bars)), [symbol(name) for name, _ in bars])
    axis.invert_yaxis()
    axis.set(xlabel="share of the variance (%)", xlim=(0.0, 100.0))
    return finished(figure, [axis], data.stamp)


def pressed(data: ReportData) -> dict[str, SurfaceStates]:
    """Skin by spot, where it is touched at the greatest depth."""
    return {
        spot: states
        for spot in data.spots
        if (states := data.surfaces.get(spot)) is not None
        and states.depth_mm.size
        and states.pressures_MPa[deepest(states)].any()
    }


def pressures(data: ReportData) -> Figure:
    """Draw the pressure on the skin where each press is deepest, with what was found."""
    found = pressed(data)
    factor = 1.0 / convert(f"1 {data.modulus_unit}", "MPa")
    values = {spot: factor * states.pressures_MPa[deepest(states)] for spot, states in found.items()}
    most = max(float(each.max()) for each in values.values())
    figure, axes = _panels(len(found), 55.0)
    maps = []
    for axis, (spot, states) in zip(axes, found.items(), strict=True):
        maps.append(draw_map(axis, states, deepest(states), values[spot], most))
        axis.set_title(f"spot {spot}")
    lettered(axes)
    if drawn := [each for each in maps if each is not None]:
        figure.colorbar(drawn[0], ax=list(axes), label=f"contact pressure ({data.modulus_unit})", shrink=0.8)
    return finished(figure, [], data.stamp)


def limbs(data: ReportData) -> Figure:
    """Draw the limb around each spot with its bones and the indenter at rest; the normal is upwards."""
    found = {spot: data.limbs[spot] for spot in data.spots if spot in data.limbs}
    figure, axes = _panels(len(found), 50.0)
    shown: list[ViewPart] = []
    for axis, (spot, limb) in zip(axes, found.items(), strict=True):
        protocol = data.study.protocol_at(spot)
        indenter = protocol.indenter if isinstance(protocol, Indentation) else None
        parts = coarsened(limb_view(limb, indenter, MOST_TRIANGLES), MOST_TRIANGLES)
        draw_limb(axis, limb, parts, from_the_side(limb))
        axis.set_title(f"spot {spot}")
        shown += parts
    return finished(figure, axes, data.stamp, legend_of(shown))


def profiles(data: ReportData) -> Figure:
    """Draw how much worse the fit is at each value, with the other parameters fitted again."""
    table, truth = data.table("profiles"), data.study.truth
    names = list(dict.fromkeys(table["parameter"].to_list()))
    figure, axes = _panels(len(names), 50.0)
    for axis, name in zip(axes, names, strict=True):
        rows = table.filter(parameter=name).sort("value")
        axis.plot(rows["value"], rows["rise"], color=LINES[0][0], label="profile")
        axis.axhline(RISE, color="0.5", linestyle=":", linewidth=0.8, label="95 %")
        if name in truth:
            axis.axvline(truth[name], color=LEAST_COLOUR, linewidth=0.8, label="true value")
        axis.set(xlabel=axis_label(data.searched[name]), ylabel="rise of −2 log density")
    return finished(figure, axes, data.stamp)


def sobol_indices(data: ReportData) -> Figure:
    """Draw the share of each parameter in the variance along each curve, a row for each spot."""
    table = data.table("sobol_indices")
    spots, channels, names = (
        list(dict.fromkeys(table[column].to_list())) for column in ("spot", "channel", "parameter")
    )
    figure = sized(column_mm(True), 42.0 * len(spots) + 18.0)
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
            axis.set(xlabel=f"point of the {channel}", ylabel=f"share at {spot} (%)", ylim=(0.0, 100.0))
    return finished(figure, axes.flat, data.stamp)


def _panels(n: int, height_mm: float) -> tuple[Figure, list[Any]]:
    """Figure with so many panels of this height; four are in two rows."""
    # Most panels side by side.
    return panels(n, 2 if n == 4 else min(n, 3), height_mm, 15.0)
