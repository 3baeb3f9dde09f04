"""Pictures of what was measured at one spot: every press, their mean and its band."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
from matplotlib.axes import Axes

from palpate.domain import Channel, Curve, Response
from palpate.report.figures import draw_band
from palpate.report.style import (
    DOUBLE_MM,
    MEASURED_COLOUR,
    SINGLE_MM,
    STYLE,
    entitle,
    legend_below,
    save,
    sized,
)
from palpate.stages.experiment import Presses

_PRESS = {"color": "0.45", "linewidth": 0.8}


def draw_presses(
    presses: Presses, mean: Response, channels: Mapping[str, Channel], notice: str, folder: Path
) -> tuple[Path, ...]:
    """Draw ``curves.svg``, ``curves.pdf`` and ``curves.png``: each channel in its own panel.

    Parameters
    ----------
    presses : Presses
    mean : Response
        What :func:`palpate.stages.experiment.mean` made of them.
    channels : mapping of name to Channel
        Axes and labels.
    notice : str
        What the picture must say of the data; empty for nothing.
    folder : Path
    """
    with mpl.rc_context(cast("Any", dict(STYLE))):
        figure = sized(DOUBLE_MM if len(mean.curves) > 1 else SINGLE_MM, 75.0)
        axes = figure.subplots(1, len(mean.curves), squeeze=False)[0]
        for axis, (name, curve) in zip(axes, mean.curves.items(), strict=True):
            _draw(axis, presses.curves(name), curve, channels[name])
        legend_below(figure, list(axes))
        entitle(figure, f"spot {presses.spot.spot.name}: measured curves", notice)
        return tuple(save(figure, folder / "curves"))


def _draw(axis: Axes, repeats: Mapping[str, Curve], mean: Curve, channel: Channel) -> None:
    n_presses = len(repeats)
    if n_presses > 1:
        for k, curve in enumerate(repeats.values()):
            label = "_" if k else f"{n_presses} presses"
            axis.plot(curve.abscissa, curve.ordinate, label=label, **cast("Any", _PRESS))
    draw_band(axis, mean)
    label = f"mean of {n_presses} presses" if n_presses > 1 else "press"
    axis.plot(mean.abscissa, mean.ordinate, color=MEASURED_COLOUR, label=label)
    axis.set_xlabel(channel.abscissa_label)
    axis.set_ylabel(channel.ordinate_label)
