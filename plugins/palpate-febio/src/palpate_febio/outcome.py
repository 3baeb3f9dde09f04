"""Outcome of a run: its record, the verdict on it, and the verification of its torque.

Nothing is taken for granted because FEBio reports it. Friction that remembers gives the same torque however
finely the twist is cut, and keeps it while the indenter is held. One more run verifies both: every step in
two halves up to the first turn of the rotation, and then a hold.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate.api import FloatArray, PalpateError, Status
from palpate.api.experiment import EquilibriumStates
from palpate.api.files import Ended
from palpate.api.mesh import SpotWrench, pose_of
from palpate_febio.deck import RECORD_DATA
from palpate_febio.log import LogSummary, read_log
from palpate_febio.steps import Steps, halved, up_to_first_turn, with_hold


class RecordError(PalpateError):
    """A record that cannot be what FEBio writes."""


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """Blocks of a record in order.

    Parameters
    ----------
    times : (n,) array
        Rising.
    values : (n, n_columns) array
        Finite or not: that is for the reader to judge.
    """

    times: FloatArray
    values: FloatArray


def read_record(text: str, n_columns: int) -> Record:
    """Record of one item; a last block that was cut off is left out.

    Parameters
    ----------
    n_columns : int
        Values in a row, after the item's number.

    Raises
    ------
    RecordError
        Naming the line.
    """
    lines = text.split("\n")
    whole = lines[:-1]  # what follows the last line end was cut off
    times: list[float] = []
    rows: list[list[float]] = []
    time: float | None = None
    for number, line in enumerate(whole, start=1):
        if line.startswith("*"):
            key, _, word = line[1:].partition("=")
            if key.strip() == "Time":
                time = _float(word, number)
        elif line.strip():
            if time is None:
                raise RecordError(f"line {number}: values before any time; this is not a record of FEBio")
            rows.append(_row(line, number, n_columns))
            times.append(time)
            time = None
    found = Record(np.array(times), np.array(rows).reshape(-1, n_columns))
    if (np.diff(found.times) <= 0.0).any():
        raise RecordError("times do not rise; two runs wrote into one record")
    return found


def _row(line: str, number: int, n_columns: int) -> list[float]:
    words = line.replace(",", " ").split()
    if len(words) != n_columns + 1:
        raise RecordError(f"line {number}: {len(words)} numbers and not {n_columns + 1}")
    return [_float(word, number) for word in words[1:]]


def _float(word: str, number: int) -> float:
    try:
        return float(word)
    except ValueError:
        raise RecordError(f"line {number}: '{word.strip()[:40]}' is no number") from None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Verdict:
    """Result of one run.

    Parameters
    ----------
    message : str
        Empty when all is well.
    states : EquilibriumStates
        At rest and at the first k − 1 steps.
    """

    status: Status
    message: str
    states: EquilibriumStates
    log: LogSummary

    @property
    def n_steps(self) -> int:
        """Number of steps that balanced."""
        return max(len(self.states.pose) - 1, 0)

    @property
    def torque_Nmm(self) -> FloatArray:  # noqa: N802 -- the unit
        """Torque (k,) of the states."""
        return self.states.columns["torque_Nmm"]


def judge(ended: Ended, log: str | None, record: str | None, steps: Steps, radius_mm: float) -> Verdict:
    """Verdict on a run: its output, compared with what the deck asked for.

    A run is ``ok`` only with exit code 0, the good banner, every step present
    where it was asked for, finite, and with reactions that are not zero.

    Parameters
    ----------
    log, record : str or None
        Contents of the files; None where there is no such file.
    radius_mm : float
        Height of the indenter's centre at rest.
    """
    said = read_log(log if log is not None else ended.tail)
    if log is not None and said.reason is None and said.finished is not True:
        # What was printed has the reason that the log lacks: XML errors come before the log.
        printed = read_log(ended.tail)
        said = replace(said, version=said.version or printed.version, reason=printed.reason)
    failure = _failure(ended, said)
    status, message = failure or Status.UNREADABLE, ""
    states = EquilibriumStates(pose=np.zeros((0, 6)), wrench=np.zeros((0, 6)))
    try:
        if record is None:
            raise RecordError("there is none")
        states = _matched(read_record(record, len(RECORD_DATA)), steps, radius_mm)
    except RecordError as error:
        message = _message(ended, said, steps, f"record: {error}")
    else:
        missing = steps.n + 1 - len(states.pose)
        if failure is not None:
            message = _message(ended, said, steps, "")
        elif missing:
            message = f"FEBio ended well with {missing} of {steps.n} steps missing from its record"
        elif not states.wrench[:, [0, 5]].any():
            message = "every reaction is zero: the record is of another body, or nothing was touched"
        else:
            status = Status.OK
    return Verdict(status=status, message=message, states=states, log=said)


def _failure(ended: Ended, said: LogSummary) -> Status | None:
    """Status by the end of the process and the log; None if both report success."""
    if ended.stopped:
        return Status.TIMED_OUT
    if ended.exit_code == 0 and said.finished:
        return None
    if said.finished is False:
        refusals = ("deck refused", "deck not read", "model refused")
        is_refused = said.reason is not None and said.reason.name in refusals
        return Status.CRASHED if is_refused else Status.DIVERGED
    return Status.UNREADABLE if ended.exit_code == 0 else Status.CRASHED


def _message(ended: Ended, said: LogSummary, steps: Steps, record: str) -> str:
    parts = [ended.stopped] if ended.stopped else []
    if said.reason is not None:
        parts.append(f"FEBio: {said.reason}")
    elif not ended.stopped and ended.exit_code:
        parts.append(f"FEBio ended with code {ended.exit_code} and gave no reason")
    elif not ended.stopped and said.finished is None:
        parts.append("FEBio ended with code 0 and without its banner")
    if said.failed_at is not None:
        unit = "step {:g}" if steps.time_s is None else "{:g} s"
        parts.append(f"no balance at {unit.format(said.failed_at)}")
    return " · ".join([*parts, record] if record else parts)


def _matched(record: Record, steps: Steps, radius_mm: float) -> EquilibriumStates:
    """States of the steps from rest up to the first that is missing.

    Raises
    ------
    RecordError
        Not finite, or the indenter was not where it was sent.
    """
    # A share of the shortest step, and the rounding of a time: FEBio prints nine digits.
    near = 1e-6 * np.diff(steps.time).min() + 1e-8 * steps.time
    places = np.searchsorted(record.times, steps.time - near)
    there = places < len(record.times)
    there[there] = np.abs(record.times[places[there]] - steps.time[there]) < near[there]
    n = len(there) if there.all() else int(np.argmin(there))
    alike = np.flatnonzero(np.diff(places[:n]) <= 0)
    if alike.size:
        k = int(alike[0])
        raise RecordError(f"steps {k} and {k + 1} are alike in the digits of their times that FEBio prints")
    values = record.values[places[:n]]
    depth, turn = steps.depth_mm[:n], np.deg2rad(steps.rotation_deg[:n])
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if bad.size:
        raise RecordError(f"step {bad[0]} holds a value that is not finite")
    off = np.abs(radius_mm - values[:, 0] - depth) > 1e-4
    around = np.abs((values[:, 1] - turn + np.pi) % (2.0 * np.pi) - np.pi) > 1e-5
    if (off | around).any():
        k = int(np.flatnonzero(off | around)[0])
        raise RecordError(
            f"at step {k} the indenter is at {radius_mm - values[k, 0]:.6g} mm, "
            f"{np.rad2deg(values[k, 1]):.6g} "
            f"degrees, and was sent to {depth[k]:.6g} mm, {steps.rotation_deg[k]:.6g} degrees"
        )
    # FEBio prints force and moment, about the centre, that move the indenter: the opposite of the tissue's.
    wrench = SpotWrench(force_N=-values[:, 2:5] + 0.0, moment_Nmm=-values[:, 5:8])
    centre = np.tile([0.0, 0.0, radius_mm], (n, 1))
    return EquilibriumStates(
        pose=pose_of(depth, steps.rotation_deg[:n]),
        wrench=wrench.on_tissue(centre),
        time_s=None if steps.time_s is None else steps.time_s[:n],
    )


def as_rows(states: EquilibriumStates) -> Mapping[str, Any]:
    """The columns of a press and twist, for the diagnostics."""
    names = ("depth_mm", "rotation_deg", "force_N", "torque_Nmm")
    return {name: states.columns[name].tolist() for name in names}


N_HELD = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """Result of the two checks: changes relative to the verified torque, None if unknown."""

    tolerance: float
    halving: float | None = None
    hold: float | None = None
    message: str = ""

    @property
    def passed(self) -> bool:
        """True if both changes are within the tolerance."""
        changes = (self.halving, self.hold)
        return all(change is not None and abs(change) <= self.tolerance for change in changes)

    def row(self) -> dict[str, Any]:
        """Row of the diagnostics and of the run's table of verifications."""
        return {
            "passed": self.passed,
            "message": str(self),
            "halving": self.halving,
            "hold": self.hold,
            "tolerance": self.tolerance,
        }

    def __str__(self) -> str:
        if self.halving is None or self.hold is None:
            found = "" if self.halving is None else f"halved steps change it by {self.halving:+.1%}, and "
            return f"torque not verified: {found}{self.message}"
        verdict = "torque verified" if self.passed else "torque NOT to be relied on"
        return (
            f"{verdict}: halved steps change it by {self.halving:+.1%}, a hold by {self.hold:+.1%} "
            f"({self.tolerance:.1%} allowed)"
        )


def check_torque(
    steps: Steps, torque_Nmm: float, run: Callable[[Steps], Verdict], tolerance: float, held_s: float = 0.0
) -> Verification:
    """Verification of a torque by one more run, with finer steps and a hold.

    Parameters
    ----------
    steps : Steps
        Of the run to be verified.
    torque_Nmm : float
        Its answer where the rotation first turns.
    run : callable
        Simulates other steps.
    tolerance : float
        Largest relative change.
    held_s : float
        Time of the hold where the tissue relaxes: so short that hardly anything does.
    """
    if not torque_Nmm:
        return Verification(tolerance=tolerance, message="there is no torque where the rotation first turns")
    fine = halved(up_to_first_turn(steps))
    verdict = run(with_hold(fine, N_HELD, held_s / N_HELD))
    turned = verdict.status in (Status.OK, Status.DIVERGED) and verdict.n_steps >= fine.n
    before = float(verdict.torque_Nmm[fine.n]) if turned else None
    held = (
        None if before is None or verdict.status is not Status.OK else float(verdict.torque_Nmm[-1]) - before
    )
    return Verification(
        tolerance=tolerance,
        halving=None if before is None else (before - torque_Nmm) / torque_Nmm,
        hold=None if held is None else held / torque_Nmm,
        message="" if held is not None else f"the finer run did not end well ({verdict.message})",
    )
