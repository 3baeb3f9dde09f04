"""``palpate experiment inspect``: what is in a log, and a map that may read it.

Which of several readings of a log is meant, the press and the twist decide. A twist turns the tool about the
line of the press, and tissue pushes the tool back along it. A quaternion read in another order, angles about
other axes or a wrench in another frame do not.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from scipy.spatial.transform import Rotation

from palpate.api import CurveError
from palpate.api.files import ASKED, InspectedTable, Inspection, kind_of
from palpate_robot_log.checks import LARGEST_TURN_AXIS_ANGLE_DEG
from palpate_robot_log.measures import longest_step_s
from palpate_robot_log.processing.chain import Processed
from palpate_robot_log.processing.contact import contacts_of
from palpate_robot_log.processing.cycles import process_cycles
from palpate_robot_log.processing.settings import ProcessingSettings, Switch
from palpate_robot_log.reading.assembly import assemble, read_both, seconds_of, share_clock
from palpate_robot_log.reading.channel_map import ChannelMap, LogFiles, Time
from palpate_robot_log.reading.formats import read_log
from palpate_robot_log.reading.processed_curves import curves_by, curves_of, spans_of
from palpate_robot_log.reading.proposal import Proposal, validated
from palpate_robot_log.reading.quantities import (
    ORDER,
    QUANTITIES,
    Guess,
    complete_rows,
    extent,
    pressed_rows,
    rest_of,
)
from palpate_robot_log.reading.raw import RawLog, Stream
from palpate_robot_log.reading.robots import (
    LogGuess,
    machine_of,
    proposal_of,
    propose,
    with_one_angle,
    with_unit,
)
from palpate_robot_log.recording import Recording, rotated
from palpate_robot_log.robot_log import RobotLogLoader

_LEAST_TURN_DEG = 3.0
_ALONG = 0.8
_RISEN = 0.05
_RESISTED, _LEAST_TILT_DEG = 0.5, 3.0
"""Correlation of moment and turn, and angle between twist and press, by which one angle is the tool's."""


def inspect_log(path: Path, wrench: Path | None = None) -> Inspection:
    """Contents of a log of unknown columns, and a study that may read it.

    Where ``path`` has the pose alone, ``wrench`` is the other file. A CurveError where they cannot be read at
    all; what is merely wrong in them is among the findings.
    """
    log = read_log(path) if wrench is None else read_both(path, wrench)
    guess = propose(log) if wrench is None else _of_two(log, path, wrench)
    guess, proposal = _chosen(log, _in_order(log, _or_one_angle(log, judged(log, guess))))
    is_log, problem = proposal.loader == RobotLogLoader.name, "; ".join(proposal.questions)
    tried = [f"{ASKED}: {question}" for question in proposal.questions]
    try:
        if not problem and is_log:
            tried = [*_of_log(log, guess)]
        elif not problem:
            tried = [f"these tables read the file: {spans_of(curves_by(proposal, path))}"]
    except CurveError as error:
        problem = str(error)
        tried = [f"with these tables: {problem}"]
    streams = [_described(log, stream, guess) for stream in log.streams]
    gaps = _gap_findings(log, streams) if is_log else ()
    findings = (*log.notes, *gaps, *proposal.remarks, *tried)
    for kept in (_assembled, _pressed):
        kept.cache_clear()
    text = proposal.text(path.name)
    record = {
        "file": str(path),
        "wrench_file": wrench and str(wrench),
        "format": log.format,
        "layout": dict(log.layout),
        "streams": streams,
        "channels": proposal.settings.get("channels", {}),
        "findings": findings,
        "problem": problem,
        "study_toml": text,
    }
    tables = _tables(log, streams)[0 if is_log else 1 :]
    return Inspection(tables=tables, findings=findings, study_text=text, test=proposal.test, record=record)


def _of_two(log: RawLog, pose: Path, wrench: Path) -> LogGuess:
    """Guess for the log of two files, with their names and clocks."""
    guess = propose(log)
    timed = ((name, time) for name, time in guess.time.items() if not time.is_counter)
    clocks = [_clock(log, log.stream(name), time) for name, time in timed]
    shared = len(clocks) > 1 and share_clock([(clock["begin_s"], clock["end_s"]) for clock in clocks])
    return replace(guess, files=LogFiles.of(pose, wrench).model_dump(), clocks="common" if shared else "own")


@lru_cache(maxsize=1)
def _assembled(log: RawLog, channels: str) -> Recording:
    """Recording by a channel map in JSON; the last one is kept."""
    return assemble(log, validated(ChannelMap, json.loads(channels))).recording


def _read(log: RawLog, guess: LogGuess) -> Recording:
    """Recording by a guess; a CurveError where the log cannot be read so."""
    proposal = proposal_of(log, guess)
    if proposal.questions:
        raise CurveError("; ".join(proposal.questions))
    return _assembled(log, json.dumps(proposal.settings["channels"]))


@lru_cache(maxsize=1)
def _pressed(recording: Recording, *, ends_in_contact: bool) -> Processed:
    """Last press of a recording, which is kept; drift is known where the recording ends in free air."""
    settings = ProcessingSettings(drift=Switch(enabled=not ends_in_contact))
    return [*process_cycles(recording, settings).processed.values()][-1]


def _first_press(log: RawLog, *guesses: LogGuess) -> LogGuess | None:
    """First of some guesses by which a log has a press; None where none is."""
    for guess in guesses:
        with suppress(CurveError):
            _pressed(_read(log, guess), ends_in_contact=guess.ends_in_contact)
            return guess
    return None


def _chosen(log: RawLog, guess: LogGuess) -> tuple[LogGuess, Proposal]:
    """Proposal for a log, of a robot or a testing machine, or else for curves; and the guess of the log."""
    found = {*guess.guesses}
    # A pose is a robot's, whatever else the log has of depth; a place alone may be a stage's.
    if found <= {"position"} or not ("position" in found or {"orientation", "force"} <= found):
        curves, machine = curves_of(log, has_place="position" in found), machine_of(log)
        if machine is not None and not (curves and curves.test):
            # A log that ends under load shows no drift.
            tried = _first_press(log, machine, replace(machine, ends_in_contact=True))
            if tried or curves is None or not _is_loading(log, machine):
                curves, guess = None, tried or machine
        if curves is not None:
            return LogGuess(guesses={}, time={}), curves
    return guess, proposal_of(log, guess)


def _of_log(log: RawLog, guess: LogGuess) -> Iterator[str]:
    """Findings on the recording of a log and on its curves."""
    found = _read(log, guess)
    seconds = found.time_s[-1] - found.time_s[0]
    yield f"this map reads the file: {found.n_rows} rows at {found.rate_hz:.4g} Hz over {seconds:.4g} s"
    yield from _yielding(log, guess, found)
    try:
        yield from _cycles(found)
        press = _pressed(found, ends_in_contact=guess.ends_in_contact)
        yield f"its curves: {spans_of(press.curves)}"
    except CurveError as error:
        yield f"no curves yet: {error}"


def _or_one_angle(log: RawLog, guess: LogGuess) -> LogGuess:
    """Guess, or one whose tool turns by a single angle, if the tissue resists this twist about the press."""
    if {*QUANTITIES} - {*guess.guesses} != {"orientation"} or (turned := with_one_angle(log, guess)) is None:
        return guess
    motion = _motion(log, found := judged(log, turned))
    is_shown = motion is not None and motion.tilt_deg < _LEAST_TILT_DEG and motion.resistance > _RESISTED
    pressed = _first_press(log, found) if is_shown else None
    return pressed or guess


def _is_loading(log: RawLog, machine: LogGuess) -> bool:
    """Whether the force rises from the first rows on, as in curves that begin at contact, or to the last."""
    (travel,), (force,) = (
        [column.values for column in log.columns(guess.stream, guess.names)]
        for guess in (machine.guesses["position"], machine.guesses["force"])
    )
    change = np.abs(force - force[0])
    share = change / max(float(np.nanmax(change)), 1e-300)
    rises, ends = int(np.argmax(share > _RISEN)), int(np.argmax(share > 1.0 - _RISEN))
    before = float(abs(travel[rises] - travel[0])) / float(np.ptp(travel[np.isfinite(travel)]))
    return before < 0.35 or ends > (1.0 - _RISEN) * share.size


def _in_order(log: RawLog, proposal: LogGuess) -> LogGuess:
    """Guess with the moment before the force, where both are only numbered and only so are a press."""
    force, moment = (proposal.guesses.get(name) for name in ("moment", "force"))
    if not force or not moment or ORDER.format("force") not in moment.to_check:
        return proposal
    check = "the moment is taken before the force: only so the force follows the press"
    size = extent(complete_rows(log.columns(force.stream, force.names)))
    swapped = {
        name: replace(one, entry={"columns": one.entry["columns"]}, to_check=(check,))
        for name, one in (("force", force), ("moment", moment))
    }
    guesses = {name: with_unit(log, name, one, size) for name, one in swapped.items()}
    exchanged = judged(log, replace(proposal, guesses={**proposal.guesses, **guesses}))
    return _first_press(log, proposal, exchanged) or proposal


def _yielding(log: RawLog, proposal: LogGuess, measured: Recording) -> Iterable[str]:
    """Finding on a commanded position next to the measured one: their difference is the arm's compliance."""
    for one in [one for one in proposal.others.get("position", ()) if one.is_commanded][:1]:
        guess = replace(
            proposal, guesses={**proposal.guesses, "position": with_unit(log, "position", one, 0.0)}
        )
        with suppress(CurveError):
            if (other := _read(log, guess)).n_rows == measured.n_rows:
                off = other.position_mm - measured.position_mm
                force = np.linalg.norm(measured.force_N - rest_of(measured.force_N), axis=1)
                loaded = off[force >= 0.9 * force.max()]
                off_mm = float(np.linalg.norm(np.median(loaded, axis=0) - rest_of(off)))
                yield (
                    f"commanded and measured position differ by {off_mm:.2g} mm under load, as of an arm "
                    "that yields: the measured one is taken"
                )


def _cycles(recording: Recording) -> Iterator[str]:
    """Finding on the presses of a log that holds several, with the largest force of each."""
    contacts = contacts_of(recording)
    force = rotated(recording.quaternion, recording.force_N)
    size = np.linalg.norm(force - np.median(force[: contacts[0].first], axis=0), axis=1)
    peaks = [float(size[each.rows].max()) for each in contacts]
    each = ", ".join(f"{peak:.3g} N ({100.0 * (peak / peaks[0] - 1.0):+.1f} %)" for peak in peaks[1:])
    which = 'the last counts, unless cycle = 1 (or another number, or "all") is under [experiment.settings]'
    if each:
        yield f"{len(peaks)} presses, of {peaks[0]:.3g} N, {each}: {which}"


def _described(log: RawLog, stream: Stream, proposal: LogGuess) -> dict[str, Any]:
    """Clock and columns of a stream in plain values."""
    guesses = [(what, guess) for what, guess in proposal.guesses.items() if guess.stream == stream.name]
    if time := proposal.time.get(stream.name):
        guesses.append(("counter" if time.is_counter else "time", time))
    roles = {name: what for what, guess in guesses for name in guess.names}
    finite = stream.frame.select(pl.when(pl.all().is_finite()).then(pl.all()))
    extremes = zip(finite.min().row(0), finite.max().row(0), finite.null_count().row(0), strict=True)
    return {
        "name": stream.name,
        "n_rows": int(stream.rows.size),
        "time": _clock(log, stream, time) if time and not time.is_counter else None,
        "columns": [
            {
                "name": column.name,
                "unit": column.shown_unit if kind_of(column.shown_unit) or column.unit else "",
                "least": least,
                "largest": largest,
                "n_missing": n_missing,
                "taken_for": roles.get(column.name),
                "note": column.note or "not used" * (column.name in proposal.unused),
            }
            for column, (least, largest, n_missing) in zip(stream.columns.values(), extremes, strict=True)
        ],
    }


def _clock(log: RawLog, stream: Stream, guess: Guess) -> dict[str, Any]:
    time_s, _ = seconds_of(log, stream, Time.model_validate(guess.entry))
    is_there = np.isfinite(time_s)
    time, rows = time_s[is_there], stream.rows[is_there]
    steps = np.diff(time)
    usual = float(np.median(steps))
    wide = np.flatnonzero(steps > longest_step_s(usual))
    return {
        "column": guess.names[0],
        "begin_s": float(time[0]),
        "end_s": float(time[-1]),
        "rate_hz": 1.0 / usual if usual > 0.0 else float("nan"),
        "n_repeated": int((steps == 0.0).sum()),
        "n_backwards": int((steps < 0.0).sum()),
        "gaps": [
            {"row": int(rows[i]), "time_s": float(time[i]), "seconds": float(steps[i])} for i in wide[:20]
        ],
    }


def _gap_findings(log: RawLog, streams: Sequence[Mapping[str, Any]]) -> Iterable[str]:
    for stream, described in zip(log.streams, streams, strict=True):
        clock = described["time"]
        if clock is None:
            if not any(column["taken_for"] == "counter" for column in described["columns"]):
                yield f"{stream.label}: no column looks like time"
            continue
        for gap in clock["gaps"][:3]:
            after = f"{log.row_word} {gap['row']} (t = {gap['time_s']:.4f} s)"
            yield f"{stream.label}: no rows for {gap['seconds']:.4g} s after {after}"
        if clock["n_repeated"]:
            yield f"{stream.label}: {clock['n_repeated']} rows repeat the time of the row before"
        if clock["n_backwards"]:
            yield f"{stream.label}: time goes back {clock['n_backwards']} times"


def _tables(log: RawLog, streams: Sequence[Mapping[str, Any]]) -> tuple[InspectedTable, InspectedTable]:
    """Clock of each stream, and each column."""
    clocks, columns = list[tuple[str, ...]](), list[tuple[str, ...]]()
    for stream in streams:
        shown, name = ("–",) * 4, stream["name"] or "–"
        if clock := stream["time"]:
            gap = f"{max(gap['seconds'] for gap in clock['gaps']):.3f}" if clock["gaps"] else "none"
            shown = (f"{clock['begin_s']:.3f}", f"{clock['end_s']:.3f}", f"{clock['rate_hz']:.4g}", gap)
        clocks.append((name, str(stream["n_rows"]), *shown))
        for column in stream["columns"]:
            role, ends = column["taken_for"] or "", (column["least"], column["largest"])
            unit = column["unit"] or ("–" if role == "orientation" else "?")
            numbers = ("–" if number is None else f"{number:.4g}" for number in ends)
            columns.append(
                (name, column["name"], unit, *numbers, str(column["n_missing"]), role, column["note"])
            )
    of_clocks = ("stream", f"{log.row_word}s", "from (s)", "to (s)", "rate (Hz)", "longest gap (s)")
    of_columns = ("stream", "column", "unit", "least", "largest", "missing", "taken for", "note")
    return (
        InspectedTable(title=f"{log.source}: {log.format}", columns=of_clocks, rows=tuple(clocks)),
        InspectedTable(title="Columns", columns=of_columns, rows=tuple(columns)),
    )


# ------------------------------------------------- readings that agree with the motion


class _Motion(NamedTuple):
    """Press and twist of a recording by one reading, and its push as written and in the base frame.

    ``tilt_deg`` is between twist and press, NaN where the tool hardly turns. Pushes are cosines to the press.
    The resistance to the twist is a correlation of turn and moment, NaN without a twist. It is negative where
    the moment turns the tool on, as of an orientation of the other sense.
    """

    tilt_deg: float
    resistance: float
    push_as_written: float
    push_turned: float

    @property
    def is_against(self) -> bool:
        return self.resistance < -0.3


def judged(log: RawLog, proposal: LogGuess) -> LogGuess:
    """Guess with the orientation, the frame and the side of the wrench that the motion agrees with.

    What it does not tell, such as without a twist, stays as the names have it.
    """
    if not {*QUANTITIES} <= {*proposal.guesses}:
        return proposal
    first = proposal.guesses["orientation"]
    turns = [replace(first, also=()), *first.also]
    motions = [_motion(log, _with_orientation(proposal, one)) for one in turns]
    known = {k: motion for k, motion in enumerate(motions) if motion is not None}
    fitting = [k for k, motion in known.items() if motion.tilt_deg <= LARGEST_TURN_AXIS_ANGLE_DEG]
    # Of two that fit alike the likelier one is taken.
    best = min(fitting, key=lambda k: (round(known[k].tilt_deg / 5.0), known[k].is_against, k), default=0)
    others = tuple(one for k, one in enumerate(turns) if k != best)
    reason = "the order and the axes of the orientation: those are taken about which the tool twists"
    if first.also and not fitting:
        reason = "the order and the axes of the orientation: no twist tells"
    to_check = (*first.to_check, reason) if first.also else first.to_check
    chosen = _with_orientation(proposal, replace(turns[best], also=others, to_check=to_check))
    return chosen if (motion := motions[best]) is None else _with_side(chosen, motion)


def _with_orientation(proposal: LogGuess, orientation: Guess) -> LogGuess:
    return replace(proposal, guesses={**proposal.guesses, "orientation": orientation})


def _with_side(proposal: LogGuess, motion: _Motion) -> LogGuess:
    pushes: Mapping[str, float] = {"sensor": motion.push_turned, "base": motion.push_as_written}
    frames = sorted(pushes, key=lambda frame: frame != proposal.wrench_frame)
    frame = next((name for name in frames if abs(pushes[name]) >= _ALONG), None)
    if frame is None:
        return proposal
    is_alone = min(map(abs, pushes.values())) < _ALONG
    how = "the force is along the press only in this frame" if is_alone else "the names decide the frame"
    return replace(
        proposal,
        wrench_frame=frame,
        acts_on="tool" if pushes[frame] < 0.0 else "tissue",
        wrench_reason=f"acts_on and wrench_frame (guessed: the sign from the direction of the press; {how})",
    )


def _motion(log: RawLog, proposal: LogGuess) -> _Motion | None:
    """Motion by this reading; None where it cannot be read, or has no press."""
    try:
        recording = _read(log, replace(proposal, acts_on="tool", wrench_frame="sensor"))
    except CurveError:
        return None
    air = rest_of(recording.force_N)
    free, loaded = pressed_rows(np.linalg.norm(recording.force_N - air, axis=1))
    press = recording.position_mm[loaded] - recording.position_mm[free]
    if (length := float(np.linalg.norm(press))) < 0.3:
        return None
    press = press / length
    force = np.mean(recording.force_N[loaded : loaded + 5], axis=0) - air
    force = force / np.linalg.norm(force)
    turned = rotated(recording.quaternion[[loaded]], force)[0]
    push = float(turned @ press)
    pose = Rotation.from_quat(recording.quaternion[loaded:])
    turns = (pose * pose[0].inv()).as_rotvec()
    sizes, about = np.linalg.norm(turns, axis=1), turns @ press
    largest = int(np.argmax(sizes))
    tilt_deg = float("nan")
    if sizes[largest] >= np.radians(_LEAST_TURN_DEG):
        tilt_deg = float(np.degrees(np.arccos(min(abs(about[largest]) / sizes[largest], 1.0))))
    moment = rotated(recording.quaternion[loaded:], recording.moment_Nmm[loaded:]) @ press
    resistance = float("nan")
    if abs(push) >= _ALONG and np.ptp(about) >= np.radians(_LEAST_TURN_DEG) and np.ptp(moment):
        # The tissue's push on the tool is against the press, and its moment against the turn.
        resistance = float(np.sign(push) * np.corrcoef(about, moment)[0, 1])
    return _Motion(tilt_deg, resistance, float(force @ press), push)
