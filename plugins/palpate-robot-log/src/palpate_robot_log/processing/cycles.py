"""Cycles of one log: presses of a spot between which the tool leaves it, and the drift from one to the next.

Each cycle has free air before and after it, and is processed as a log that holds it alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from palpate.api import EQUILIBRIUM_CHANNELS, Curve, CurveError
from palpate_robot_log.checks import check
from palpate_robot_log.processing.chain import Processed, process, windowed
from palpate_robot_log.processing.contact import contacts_of
from palpate_robot_log.processing.settings import ProcessingSettings
from palpate_robot_log.recording import Recording

_PLACED = frozenset(channel.name for channel in EQUILIBRIUM_CHANNELS)
"""Channels along a place and not along the time."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cycles:
    """Cycles of a log by number, from 1.

    The table has a row for each of several, of plain values: ``cycle``, ``counts``, ``start_s``, ``stop_s``,
    ``depth_mm``; ``force_N`` and ``work_Nmm`` of the press at ``at_depth_mm``, which all cycles reach;
    ``peaks`` by channel; by channel ``changes`` of that force and of the other peaks, a ``share`` since the
    cycle before with its ``std``, and the share ``since_first``; and the ``problem`` of a cycle that does not
    count and cannot be processed.
    """

    processed: Mapping[int, Processed]  # that could be processed
    counted: tuple[int, ...]
    table: list[dict[str, Any]] = field(default_factory=list)

    @property
    def labelled(self) -> dict[str, Processed]:
        """Curves of the cycles that count, by name; a single one has none."""
        several = len(self.counted) > 1
        return {f"cycle_{number}" if several else "": self.processed[number] for number in self.counted}


def parts_of(recording: Recording) -> tuple[Recording, ...]:
    """Parts with one contact each, cut half-way through the time that the tool is far from the limb."""
    contacts, cuts = contacts_of(recording), [0]
    for before, after in pairwise(contacts):
        between = recording.position_mm[before.last : after.first]
        far_mm = np.linalg.norm(between - between[0], axis=1)
        far = np.flatnonzero(far_mm >= 0.9 * far_mm.max())
        cuts.append(before.last + int(far[far.size // 2]))
    if len(contacts) == 1:
        return (recording,)
    return tuple(recording.part(slice(*rows)) for rows in pairwise([*cuts, recording.n_rows]))


def process_cycles(
    recording: Recording, settings: ProcessingSettings, cycle: Literal["last", "all"] | int = "last"
) -> Cycles:
    """Process every cycle of a log; ``cycle`` chooses those that count.

    Raises
    ------
    CurveError
        A cycle that counts is no complete press, or is not there; or they are of several spots.
    """
    parts = parts_of(windowed(recording, settings))
    n = len(parts)
    if isinstance(cycle, int):
        check(recording, "cycle", cycle - n, cycle=cycle, n_cycles=n)
    if n == 1:
        return Cycles(processed={1: process(parts[0], settings)}, counted=(1,))
    if settings.onset.time is not None:
        check(recording, "one onset", n)
    counted = (cycle,) if isinstance(cycle, int) else (n,) if cycle == "last" else tuple(range(1, n + 1))
    processed, problems = dict[int, Processed](), dict[int, str]()
    for number, part in enumerate(parts, start=1):
        try:
            processed[number] = process(part, settings)
        except CurveError as error:
            if number in counted:
                raise
            problems[number] = str(error)
    _check_one_spot(recording, processed, counted[-1])
    rows = _described(processed)
    spans = {
        k: {"start_s": float(p.time_s[0]), "stop_s": float(p.time_s[-1])} for k, p in enumerate(parts, 1)
    }
    table = [
        {"cycle": k, "counts": k in counted, **span, **rows.get(k, {}), "problem": problems.get(k, "")}
        for k, span in spans.items()
    ]
    return Cycles(processed=processed, counted=counted, table=table)


def _check_one_spot(recording: Recording, processed: Mapping[int, Processed], counted: int) -> None:
    """Refuse presses that begin at different places."""
    here, normal = processed[counted].motion.origin_mm, processed[counted].normal.vector
    for number, other in processed.items():
        shift = other.motion.origin_mm - here
        along_skin = float(np.linalg.norm(shift - (shift @ normal) * normal))
        check(recording, "one spot", along_skin, cycle=number, counted=counted)


def _described(processed: Mapping[int, Processed]) -> dict[int, dict[str, Any]]:
    """Row of each cycle that could be processed."""
    depth = min(float(each.curves["force"].abscissa.max()) for each in processed.values())
    rows, found = dict[int, dict[str, Any]](), dict[int, dict[str, tuple[float, float]]]()
    for number, each in processed.items():
        force, leave = each.curves["force"], each.phases[-1]
        peaks = {name: _at_peak(c) for name, c in each.curves.items() if name in _PLACED}
        found[number] = peaks | {"force": _at(force, depth)}
        to = np.linspace(0.0, depth, 201)
        rows[number] = {
            "start_s": each.phase("press").start.time_s,
            "stop_s": leave.start.time_s if leave.name == "departure" else leave.stop.time_s,
            "depth_mm": float(force.abscissa.max()),
            "at_depth_mm": depth,
            "force_N": found[number]["force"][0],
            "work_Nmm": float(np.trapezoid(np.interp(to, force.abscissa, force.ordinate), to)),
            "peaks": {name: value for name, (value, _) in peaks.items()},
            "changes": {},
        }
    first = next(iter(found.values()))
    for (_, before), (number, now) in pairwise(found.items()):
        for name in filter(before.__contains__, now):
            (value, std), (was, was_std) = now[name], before[name]
            rows[number]["changes"][name] = {
                "share": value / was - 1.0,
                "std": float(np.hypot(std, value / was * was_std)) / was,
                "since_first": value / first[name][0] - 1.0 if name in first else None,
            }
    return rows


def _at(curve: Curve, abscissa: float) -> tuple[float, float]:
    """Ordinate and its standard deviation at an abscissa of a curve of one branch."""
    assert curve.std is not None, "curves of a log have standard deviations"
    value, std = (np.interp(abscissa, curve.abscissa, each) for each in (curve.ordinate, curve.std))
    return float(value), float(std)


def _at_peak(curve: Curve) -> tuple[float, float]:
    """Largest magnitude of a curve and its standard deviation."""
    assert curve.std is not None, "curves of a log have standard deviations"
    k = int(np.argmax(np.abs(curve.ordinate)))
    return float(abs(curve.ordinate[k])), float(curve.std[k])
