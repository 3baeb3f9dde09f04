"""A proposal as tables, and as a file for a robot."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import polars as pl

from palpate.api import Indentation, Limb
from palpate.api.cli import Closed, Row
from palpate.api.experiment import POSE
from palpate.api.fit import ALL_SPOTS, THRESHOLDS
from palpate_planning.candidates import CandidatePress, described
from palpate_planning.plan import ExpectedEffect, Proposal
from palpate_report.api import brief_names

WIDTH, MESH_BIAS, PEAK = "width_", "mesh_bias_", "peak_"
"""How columns of a ranking begin, before the parameter and the channel."""


class ProposalOutput(Closed):
    """Presses to make: ``presses`` has the poses and paths of those that are chosen.

    ``ranking`` and ``intervals`` are tables as rows, ``protocols`` what a study says of each candidate.
    """

    goal: str
    presses: list[dict[str, Any]]
    intervals: list[Row]
    ranking: list[Row]
    protocols: dict[str, dict[str, Any]]
    refused: list[Row]
    failure: str | None
    check_spot: str | None
    warnings: list[str]


def proposal_tables(proposal: Proposal) -> dict[str, pl.DataFrame]:
    """Put a proposal into tables.

    Returns
    -------
    ranking : DataFrame
        One row per step and candidate, the best first: step, press, spot, what is done, error of the goal and
        width of each interval (over those before the step), mesh bias of each parameter (in its unit), and
        the peak of each channel. Where presses go to more places, those at other places come first.
    intervals : DataFrame
        One row per parameter, and predicted force, and step, from 0 (now): value, lower and upper end of the
        95 % interval, its width over that now, and the most that the errors of the meshes can change it.
    refused : DataFrame
        Candidates that cannot be made, and why.
    """
    ranking = [
        {"step": number, **_row(proposal, found)}
        for number, step in enumerate(proposal.steps, 1)
        for found in step.ranked
    ]
    refused = [{"press": name, "reason": why} for name, why in proposal.refused.items()]
    rows = {"ranking": ranking, "intervals": _intervals(proposal), "refused": refused}
    return {name: pl.DataFrame(each, infer_schema_length=None) for name, each in rows.items()}


def _row(proposal: Proposal, found: ExpectedEffect) -> dict[str, Any]:
    press = found.press.press
    widths, biases = (
        {f"{head}{p.name}": float(value) for p, value in zip(proposal.goal.parameters, values, strict=True)}
        for head, values in ((WIDTH, found.widths), (MESH_BIAS, found.mesh_bias))
    )
    peaks = {f"{PEAK}{name}": peak for name, peak in found.press.peaks.items()}
    about = {"press": press.name, "spot": press.spot, "protocol": described(press), "error": found.goal}
    return about | widths | biases | peaks


def _intervals(proposal: Proposal) -> list[dict[str, Any]]:
    goal = proposal.goal
    about = [(p.name, p.unit) for p in goal.parameters] + [(p.name, "N") for p in goal.predicted]
    values = [*goal.values.tolist(), *(p.force_N for p in goal.predicted)]
    ends = [np.hstack(pair) for pair in zip(proposal.intervals(), proposal.bands(), strict=True)]
    first = ends[0][1] - ends[0][0]
    return [
        {
            "step": step,
            "parameter": name,
            "unit": unit,
            "value": value,
            "lower": float(lower[i]),
            "upper": float(upper[i]),
            "width": float((upper[i] - lower[i]) / first[i]),
            "mesh_bias": float(biases[i]),
        }
        for step, ((lower, upper), biases) in enumerate(zip(ends, proposal.mesh_biases(), strict=True))
        for i, ((name, unit), value) in enumerate(zip(about, values, strict=True))
    ]


def not_narrowed(ranking: pl.DataFrame) -> list[str]:
    """Parameters that no press of a ranking narrows by more than a twentieth."""
    widths = [name for name in ranking.columns if name.startswith(WIDTH)]
    least = {name.removeprefix(WIDTH): ranking[name].min() for name in widths}
    return [name for name, width in least.items() if width > THRESHOLDS.narrowed]  # type: ignore[operator]


def realised(
    proposed: Mapping[str, Any], press: str, before: pl.DataFrame, after: pl.DataFrame
) -> pl.DataFrame:
    """Half of each interval over its value: before a press, as expected after it, and as realised.

    Expected is the half before times the width that was planned, over the value of the fit with the press.

    Parameters
    ----------
    proposed : mapping
        What :func:`for_robot` describes.
    press : str
        One of its candidates. The expected interval is cut off at the range for the chosen one alone.
    before, after : DataFrame
        Intervals of the scenario that generalises, without and with the press.
    """
    (row,) = (each for each in proposed["ranking"] if (each["step"], each["press"]) == (1, press))
    expected = {name.removeprefix(WIDTH): width for name, width in row.items() if name.startswith(WIDTH)}
    if press == proposed["presses"][0]["press"]:
        expected = {each["parameter"]: each["width"] for each in proposed["intervals"] if each["step"] == 1}
    without, with_it = _joint_intervals(before), _joint_intervals(after)
    rows = []
    for name in (name for name in expected if name in without and name in with_it):
        (value_before, half_before), (value, half) = without[name], with_it[name]
        if value_before and value:
            planned = expected[name] * half_before / value
            row = {"before": half_before / value_before, "expected": planned, "realised": half / value}
            rows.append({"parameter": name, **row})
    return pl.DataFrame(rows)


def _joint_intervals(intervals: pl.DataFrame) -> dict[str, tuple[float, float]]:
    """Size of each value, and half of its interval, in the joint fit; of the spot, where there is one."""
    one = intervals["fit"].n_unique() == 1
    shown = (intervals if one else intervals.filter(fit=ALL_SPOTS)).to_dicts()
    return {row["parameter"]: (abs(row["value"]), (row["upper"] - row["lower"]) / 2.0) for row in shown}


def shown_realised(found: pl.DataFrame) -> pl.DataFrame:
    """Halves of intervals as text, in percent of the values."""
    brief = brief_names(found["parameter"])
    halves = [
        _text(name, lambda half: f"± {100 * half:{'.2g' if half < 0.1 else '.0f'}} %")
        for name in ("before", "expected", "realised")
    ]
    return found.with_columns(pl.col("parameter").replace_strict(brief), *halves)


def shown_ranking(ranking: pl.DataFrame, labels: Mapping[str, str]) -> pl.DataFrame:
    """Ranking of one step as text: error and widths in percent, peaks with ``labels`` of their channels."""
    brief = brief_names(name.removeprefix(WIDTH) for name in ranking.columns if name.startswith(WIDTH))
    shown = [pl.col("press"), pl.col("spot"), pl.col("protocol")]
    shown.append(_text("error", _percent))
    shown += [_text(f"{WIDTH}{name}", _percent).alias(short) for name, short in brief.items()]
    channels = [name.removeprefix(PEAK) for name in ranking.columns if name.startswith(PEAK)]
    heads = [labels.get(channel, channel) for channel in channels]
    for channel, head in zip(channels, heads, strict=True):
        label = head if heads.count(head) == 1 else f"{channel}: {head}"
        shown.append(_text(f"{PEAK}{channel}", "{:.3g}".format).alias(label))
    return ranking.select(shown)


def shown_intervals(intervals: pl.DataFrame) -> pl.DataFrame:
    """Intervals with the bias as text of two digits, and the width as percentage of today's."""
    brief = brief_names(intervals["parameter"])
    bias, width = _text("mesh_bias", "{:.2g}".format), _text("width", _percent)
    return intervals.with_columns(pl.col("parameter").replace_strict(brief), bias, width)


def _percent(width: float) -> str:
    return f"{100 * width:.0f} %"


def _text(name: str, written: Callable[[float], str]) -> pl.Expr:
    return pl.col(name).map_elements(written, return_dtype=pl.String)


def for_robot(proposal: Proposal, limbs: Mapping[str, Limb]) -> dict[str, Any]:
    """Describe a proposal in numbers: the poses and paths of the chosen presses, and the intervals."""
    return {
        "goal": proposal.goal.name,
        "presses": [
            {
                **_pose(step.chosen.press.press, limbs),
                "expected_error": step.chosen.goal,
                "expected_peaks": step.chosen.press.peaks,
            }
            for step in proposal.steps
        ],
        **{name: table.to_dicts() for name, table in proposal_tables(proposal).items()},
        "protocols": {
            each.press.press.name: dict(each.press.press.keys) for each in proposal.steps[0].ranked
        },
        "failure": proposal.failure or None,
        "check_spot": proposal.check or None,
    }


def _pose(press: CandidatePress, limbs: Mapping[str, Limb]) -> dict[str, Any]:
    protocol = press.protocol
    assert isinstance(protocol, Indentation)
    spot = limbs[press.spot].spot if press.spot in limbs else None
    motion = protocol.waypoints
    return {
        "press": press.name,
        "spot": press.spot,
        "protocol": dict(press.keys),
        "position_mm": None if spot is None else spot.position_mm.tolist(),
        "normal": None if spot is None else spot.normal.tolist(),
        **{name: values.tolist() for name, values in zip(POSE, motion.pose.T, strict=True)},
        "loads": None if motion.loads is None else motion.loads.tolist(),
        "time_s": None if motion.time_s is None else motion.time_s.tolist(),
        "axis_tilt_deg": list(protocol.tilt_deg),
    }
