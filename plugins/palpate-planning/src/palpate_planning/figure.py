"""The picture of a proposal: where on the limb to press, and what each candidate there is expected to do."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize

from palpate.api import Limb
from palpate.api.mesh import spot_axes
from palpate_planning.candidates import described
from palpate_planning.plan import ALL, PREDICTION, WORST, ExpectedEffect, Proposal
from palpate_report.api import coarsened, column_mm, limb_view, save, sized, styled

MOST_SHOWN, MOST_SPOTS = 6, 3
"""Candidates of a spot, the best first, and spots in a row."""

MOST_TRIANGLES, ROW_MM = 3000, 75.0
SCALE, LEAST_SPAN = 0.6, 0.1
"""Width of the colour scale, in those of a spot, and the least range of errors that it has."""

OF_GOAL = {
    ALL: "mean error of all parameters",
    WORST: "largest relative error",
    PREDICTION: "error of the tool's force",
}
"""Words for the goals that are no parameter."""

SKIN, LIGHT = np.array([0.87, 0.71, 0.60]), 0.45
"""Colour of the skin, and its share where it is seen edge-on."""


def draw(proposal: Proposal, limbs: Mapping[str, Limb], folder: Path) -> list[Path]:
    """Draw ``next.svg``, ``.pdf`` and ``.png``: each spot seen along its normal, with its candidates.

    The colour is the expected error of the goal after the first press, over that now.
    """
    ranked = proposal.steps[0].ranked
    spots = list(dict.fromkeys(each.press.press.spot for each in ranked))
    rows = -(-len(spots) // MOST_SPOTS)
    columns = min(len(spots), MOST_SPOTS)
    errors = [each.goal for each in ranked]
    colours = ScalarMappable(Normalize(min(errors), max(max(errors), min(errors) + LEAST_SPAN)), "viridis")
    with styled():
        figure = sized(column_mm(True) * (columns + SCALE) / (MOST_SPOTS + SCALE), ROW_MM * rows)
        axes = figure.subplots(2 * rows, columns, squeeze=False)
        for axis in axes.ravel():
            axis.set_axis_off()
        for i, spot in enumerate(spots):
            of_spot = [each for each in ranked if each.press.press.spot == spot]
            top, bottom = axes[2 * (i // columns) : 2 * (i // columns) + 2, i % columns]
            if spot in limbs:
                _limb(top, limbs[spot], colours.to_rgba(np.array([of_spot[0].goal]))[0])
            top.set_title(f"{spot}: {of_spot[0].goal:.2f}")
            _candidates(bottom, of_spot[:MOST_SHOWN], colours)
        goal = proposal.goal.name
        label = f"{OF_GOAL.get(goal, f'error of {goal}')},\nafter the press over now"
        folder.mkdir(parents=True, exist_ok=True)
        figure.colorbar(colours, ax=axes.ravel().tolist(), label=label, shrink=0.6)
        return save(figure, folder / "next")


def _limb(axis: Axes, limb: Limb, colour: object) -> None:
    """The outside of a limb seen along the normal of its spot, which is a dot."""
    spot = limb.spot
    axes = spot_axes(spot.normal, spot.along)
    parts = [p for p in coarsened(limb_view(limb), MOST_TRIANGLES) if p.role in ("contact", "free")]
    corners = np.concatenate([part.points_mm[part.triangles] for part in parts])
    seen = (corners - spot.position_mm) @ axes
    normals = np.cross(seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0])
    facing = normals[:, 2] / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    front = np.flatnonzero(facing > 0.0)
    order = front[np.argsort(seen[front, :, 2].mean(axis=1))]
    shade = (LIGHT + (1.0 - LIGHT) * facing[order, None]) * SKIN
    axis.add_collection(PolyCollection(list(seen[order, :, :2]), facecolors=shade, edgecolors="face", lw=0.2))
    axis.plot(0.0, 0.0, "o", color=cast("Any", colour), markeredgecolor="white", markersize=8.0)
    axis.autoscale_view()
    axis.set_aspect("equal")


def _candidates(axis: Axes, ranked: Sequence[ExpectedEffect], colours: ScalarMappable) -> None:
    """Expected error of each candidate, the best at the top."""
    errors = [each.goal for each in ranked]
    places = np.arange(len(ranked))
    axis.barh(places, errors, color=colours.to_rgba(np.array(errors)), height=0.3)
    for place, each in zip(places, ranked, strict=True):
        axis.text(
            0.0, place - 0.2, f"{described(each.press.press)}: {each.goal:.2f}", va="bottom", fontsize=5
        )
    axis.set_axis_on()
    axis.spines[["left", "right", "top"]].set_visible(False)
    axis.set_yticks([])
    axis.set_xticks([0.0, 0.5, 1.0])
    axis.set_xlabel("error after the press over now")
    axis.axvline(1.0, color="0.6", linewidth=0.5, linestyle=":")
    axis.set_xlim(0.0, max(1.0, *errors))
    axis.set_ylim(MOST_SHOWN - 0.5, -0.5)
