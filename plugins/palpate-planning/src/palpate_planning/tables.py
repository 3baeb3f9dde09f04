"""A proposal as tables, and as a file for a robot."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from palpate.api import Indentation, Limb
from palpate.api.cli import Closed, Row
from palpate.api.experiment import POSE
from palpate_planning.candidates import CandidatePress, described
from palpate_planning.narrowing import Narrowing, Proposal


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
    failed_checks: list[str]
    check_spot: str | None
    warnings: list[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class ProposalTables:
    """Tables of a proposal.

    Parameters
    ----------
    ranking : DataFrame
        One row per step and candidate, the best first: step, press, spot, what is done, width (of the goal,
        over that before the step), width of each parameter, and the peak of each channel.
    intervals : DataFrame
        One row per parameter, and predicted force, and step, from 0 (now): value, lower and upper end of the
        95 % interval, and its width over that now.
    refused : DataFrame
        Candidates that cannot be made, and why.
    """

    ranking: pl.DataFrame
    intervals: pl.DataFrame
    refused: pl.DataFrame


def proposal_tables(proposal: Proposal) -> ProposalTables:
    """Put a proposal into tables."""
    ranking = [
        {"step": number, **_row(proposal, found)}
        for number, step in enumerate(proposal.steps, 1)
        for found in step.ranked
    ]
    refused = [{"press": name, "reason": why} for name, why in proposal.refused.items()]
    return ProposalTables(
        ranking=pl.from_dicts(ranking, infer_schema_length=None),
        intervals=pl.from_dicts(_intervals(proposal)),
        refused=pl.from_dicts(refused) if refused else pl.DataFrame(),
    )


def _row(proposal: Proposal, found: Narrowing) -> dict[str, Any]:
    press = found.press.press
    names = [f"width_{p.name}" for p in proposal.goal.parameters]
    peaks = {f"peak_{name}": peak for name, peak in found.press.peaks.items()}
    about = {"press": press.name, "spot": press.spot, "protocol": described(press), "width": found.goal}
    return about | dict(zip(names, found.widths.tolist(), strict=True)) | peaks


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
        }
        for step, (lower, upper) in enumerate(ends)
        for i, ((name, unit), value) in enumerate(zip(about, values, strict=True))
    ]


def for_robot(proposal: Proposal, limbs: Mapping[str, Limb]) -> dict[str, Any]:
    """Describe a proposal in numbers: the poses and paths of the chosen presses, and the intervals."""
    tables = proposal_tables(proposal)
    return {
        "goal": proposal.goal.name,
        "presses": [
            {
                **_pose(step.chosen.press.press, limbs),
                "expected_width": step.chosen.goal,
                "expected_peaks": step.chosen.press.peaks,
            }
            for step in proposal.steps
        ],
        "intervals": tables.intervals.to_dicts(),
        "ranking": tables.ranking.to_dicts(),
        "protocols": {
            each.press.press.name: dict(each.press.press.keys) for each in proposal.steps[0].ranked
        },
        "refused": tables.refused.to_dicts(),
        "failed_checks": list(proposal.failed_checks),
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
