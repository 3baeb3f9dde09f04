"""The picture of a proposal: where on the limb to press, and what each candidate there is expected to do."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.axes import Axes

from palpate.api import Limb
from palpate_planning.candidates import described
from palpate_planning.plan import ALL, PREDICTION, WORST, ExpectedEffect, Proposal
from palpate_report.api import (
    ABOVE,
    LINES,
    coarsened,
    column_mm,
    draw_limb,
    lettered,
    limb_view,
    save,
    sized,
    styled,
)

MOST_SHOWN, N_COLUMNS = 6, 2
"""Candidates of a spot, the best first, and spots side by side."""

MOST_TRIANGLES, ROW_MM, LIMB = 3000, 42.0, 0.8
"""Triangles of a limb, height of a row of spots, and width of a limb over that of its candidates."""

BEST, OTHERS = LINES[0][0], "0.45"
"""Colours of the best candidate of all, and of the others."""


def draw(proposal: Proposal, limbs: Mapping[str, Limb], folder: Path) -> list[Path]:
    """Draw ``next.svg``, ``.pdf`` and ``.png``: each spot seen along its normal, with its candidates.

    The error is the expected error of the goal after the first press, over the error now.
    """
    ranked = proposal.steps[0].ranked
    spots = list(dict.fromkeys(each.press.press.spot for each in ranked))
    n_columns = min(len(spots), N_COLUMNS)
    n_rows = -(-len(spots) // n_columns)
    goal = proposal.goal.name
    words = {
        ALL: "mean error of all parameters",
        WORST: "largest relative error",
        PREDICTION: "error of the tool's force",
    }
    label = f"{words.get(goal, f'error of {goal}')}, after the press over now"
    with styled():
        figure = sized(column_mm(n_columns > 1), ROW_MM * n_rows + 8.0)
        axes = figure.subplots(
            n_rows, 2 * n_columns, squeeze=False, width_ratios=[LIMB, 1.0] * n_columns
        ).reshape(-1, 2)
        for axis in axes[len(spots) :].ravel():
            axis.remove()
        for (left, right), spot in zip(axes, spots, strict=False):
            left.set_axis_off()
            if spot in limbs:
                _limb(left, limbs[spot])
            left.set_title(f"spot {spot}")
            of_spot = [each for each in ranked if each.press.press.spot == spot]
            _candidates(right, of_spot[:MOST_SHOWN], ranked)
        lettered(axes[: len(spots), 0])
        figure.supxlabel(label, fontsize=7.0)
        folder.mkdir(parents=True, exist_ok=True)
        return save(figure, folder / "next")


def _limb(axis: Axes, limb: Limb) -> None:
    """The outside of a limb seen along the normal of its spot, which is a dot."""
    parts = coarsened(limb_view(limb, most=MOST_TRIANGLES), MOST_TRIANGLES)
    draw_limb(axis, limb, [part for part in parts if part.role in ("contact", "free")], ABOVE, glass=1.0)
    axis.plot(0.0, 0.0, "o", color="black", markeredgecolor="white", markersize=5.0)


def _candidates(axis: Axes, shown: Sequence[ExpectedEffect], ranked: Sequence[ExpectedEffect]) -> None:
    """Expected error of each candidate of a spot, the best at the top, on the axis of all spots."""
    errors, places = [each.goal for each in ranked], range(len(shown))
    for place, each in enumerate(shown):
        colour = BEST if each is ranked[0] else OTHERS
        axis.plot([each.goal, 1.0], [place, place], color=colour, linewidth=1.0)
        axis.plot(each.goal, place, "o", color=colour, markersize=3.5)
        at = (1.03, place)
        axis.annotate(f"{each.goal:.2f}", at, xycoords=("axes fraction", "data"), va="center", fontsize=6.0)
    axis.axvline(1.0, color="0.6", linewidth=0.6)
    # With signs as in print.
    words = [re.sub(r"-(?=\d)", "−", described(each.press.press).replace(" deg", "°")) for each in shown]
    axis.set_yticks(places, words, fontsize=6.0)
    axis.tick_params(axis="y", length=0.0)
    axis.spines["left"].set_visible(False)
    low, high = min(*errors, 1.0), max(*errors, 1.0)
    # Least range of errors of an axis.
    room = 0.06 * max(high - low, 0.1)
    axis.set_xlim(low - room, high + room)
    axis.set_ylim(MOST_SHOWN - 0.5, -0.5)
    axis.locator_params(axis="x", nbins=3)
