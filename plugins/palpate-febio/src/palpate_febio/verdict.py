"""Decides what became of a run: nothing is believed because FEBio says so."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate.api import BalancedStates, FloatArray, Status
from palpate.mesh.spot_frame import SpotWrench, pose_of
from palpate.sandbox import Ended
from palpate_febio.deck import RECORD_DATA
from palpate_febio.log import LogSummary, read_log
from palpate_febio.record import Record, RecordError, read_record
from palpate_febio.steps import Steps

POSITION_TOLERANCE_MM = 1e-4
ROTATION_TOLERANCE_RAD = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Verdict:
    """What became of one run.

    Parameters
    ----------
    status : Status
    message : str
        Empty when all is well.
    states : BalancedStates
        At rest and at the first k − 1 steps.
    log : LogSummary
    """

    status: Status
    message: str
    states: BalancedStates
    log: LogSummary

    @property
    def n_steps(self) -> int:
        """Steps that balanced."""
        return max(len(self.states.pose) - 1, 0)

    @property
    def torque_Nmm(self) -> FloatArray:  # noqa: N802 -- the unit
        """Torque (k,) of the states."""
        return self.states.columns["torque_Nmm"]


def judge(ended: Ended, log: str | None, record: str | None, steps: Steps, radius_mm: float) -> Verdict:
    """Compare what was written with what was asked for.

    A run is ``ok`` only with exit code 0, the good banner, every step present
    where it was asked for, finite, and with reactions that are not zero.

    Parameters
    ----------
    ended : Ended
    log, record : str or None
        Contents of the files; None where there is no such file.
    steps : Steps
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
    states = BalancedStates(pose=np.zeros((0, 6)), wrench=np.zeros((0, 6)))
    try:
        if record is None:
            raise RecordError("there is none")
        states = _matched(read_record(record, len(RECORD_DATA)), steps, radius_mm)
    except RecordError as error:
        message = _message(ended, said, f"record: {error}")
    else:
        missing = steps.n + 1 - len(states.pose)
        if failure is not None:
            message = _message(ended, said, "")
        elif missing:
            message = f"FEBio ended well with {missing} of {steps.n} steps missing from its record"
        elif not states.wrench[:, [0, 5]].any():
            message = "every reaction is zero: the record is of another body, or nothing was touched"
        else:
            status = Status.OK
    return Verdict(status=status, message=message, states=states, log=said)


def _failure(ended: Ended, said: LogSummary) -> Status | None:
    """What the end of the process and its words amount to; None when both claim success."""
    if ended.stopped:
        return Status.TIMED_OUT
    if ended.exit_code == 0 and said.finished:
        return None
    if said.finished is False:
        refusals = ("deck refused", "deck not read", "model refused")
        is_refused = said.reason is not None and said.reason.name in refusals
        return Status.CRASHED if is_refused else Status.DIVERGED
    return Status.UNREADABLE if ended.exit_code == 0 else Status.CRASHED


def _message(ended: Ended, said: LogSummary, record: str) -> str:
    parts = [ended.stopped] if ended.stopped else []
    if said.reason is not None:
        parts.append(f"FEBio: {said.reason}")
    elif not ended.stopped and ended.exit_code:
        parts.append(f"FEBio ended with code {ended.exit_code} and gave no reason")
    elif not ended.stopped and said.finished is None:
        parts.append("FEBio ended with code 0 and without its banner")
    if said.failed_at is not None:
        parts.append(f"no balance at step {said.failed_at:g}")
    return " · ".join([*parts, record] if record else parts)


def _matched(record: Record, steps: Steps, radius_mm: float) -> BalancedStates:
    """States of the steps from rest up to the first that is missing.

    Raises
    ------
    RecordError
        Not finite, or the indenter was not where it was sent.
    """
    places = np.searchsorted(record.times, np.arange(steps.n + 1) - 1e-6)
    there = places < len(record.times)
    there[there] = np.abs(record.times[places[there]] - np.flatnonzero(there)) < 1e-6
    n = len(there) if there.all() else int(np.argmin(there))
    values = record.values[places[:n]]
    depth, turn = steps.depth_mm[:n], np.deg2rad(steps.rotation_deg[:n])
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if bad.size:
        raise RecordError(f"step {bad[0]} holds a value that is not finite")
    off = np.abs(radius_mm - values[:, 0] - depth) > POSITION_TOLERANCE_MM
    around = np.abs((values[:, 1] - turn + np.pi) % (2.0 * np.pi) - np.pi) > ROTATION_TOLERANCE_RAD
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
    return BalancedStates(pose=pose_of(depth, steps.rotation_deg[:n]), wrench=wrench.on_tissue(centre))


def as_rows(states: BalancedStates) -> Mapping[str, Any]:
    """The columns of a press and twist, for the diagnostics."""
    names = ("depth_mm", "rotation_deg", "force_N", "torque_Nmm")
    return {name: states.columns[name].tolist() for name in names}
