"""The figure of a prediction: each spot's curves with their bands, and maps of pressure and shear."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from palpate.api import Channel
from palpate_prediction.predict import Prediction, SpotPrediction
from palpate_report.api import LINES, column_mm, draw_map, lettered, save, sized, styled

KPA = 1e3


def draw(prediction: Prediction, channels: Mapping[str, Channel], folder: Path) -> list[Path]:
    """Draw ``prediction.svg``, ``.pdf`` and ``.png``: for each spot its curves, and below them its maps."""
    names = list(dict.fromkeys(c for each in prediction.spots.values() for c in _response(each)))
    n = len(names)
    with styled():
        figure = sized(column_mm(True), 92.0 * len(prediction.spots))
        grid = figure.add_gridspec(2 * len(prediction.spots), 2 * n)
        every = []
        for k, (spot, each) in enumerate(prediction.spots.items()):
            curves = [figure.add_subplot(grid[2 * k, 2 * j : 2 * j + 2]) for j in range(n)]
            maps = [figure.add_subplot(grid[2 * k + 1, half]) for half in (slice(n), slice(n, None))]
            for axis, name in zip(curves, names, strict=True):
                _curve(axis, each, channels[name])
            _maps(figure, maps, each)
            curves[0].set_title(f"{prediction.tool.name} at {spot}")
            every += [*curves, *maps]
        lettered(every)
        folder.mkdir(parents=True, exist_ok=True)
        return save(figure, folder / "prediction")


def _response(each: SpotPrediction) -> tuple[str, ...]:
    assert each.simulation.response is not None
    return tuple(each.simulation.response.curves)


def _curve(axis: Axes, each: SpotPrediction, channel: Channel) -> None:
    assert each.simulation.response is not None
    curve = each.simulation.response.curves.get(channel.name)
    axis.set_xlabel(channel.abscissa_label)
    axis.set_ylabel(channel.ordinate_label)
    if curve is None:
        return
    colour = LINES[0][0]
    if (band := each.bands.get(channel.name)) is not None:
        axis.fill_between(curve.abscissa, *band, color=colour, alpha=0.25, linewidth=0.0)
    axis.plot(curve.abscissa, curve.ordinate, color=colour)


def _maps(figure: Figure, axes: Sequence[Axes], each: SpotPrediction) -> None:
    """Pressure and shear on the deformed skin, seen along the axis of the tool."""
    states, at = each.states, each.at
    shear = np.linalg.norm(states.shears_MPa[at], axis=1)
    for axis, values, label in zip(
        axes,
        (states.pressures_MPa[at], shear),
        ("contact pressure (kPa)", "contact shear (kPa)"),
        strict=True,
    ):
        drawn = draw_map(axis, states, at, KPA * values, max(KPA * float(values.max()), 1e-9))
        if drawn is not None:
            figure.colorbar(drawn, ax=axis, label=label, ticks=MaxNLocator(5), shrink=0.9)
