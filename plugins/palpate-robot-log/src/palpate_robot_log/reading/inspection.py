"""``palpate experiment inspect``: what is in a log, and a map that may read it."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from palpate.api import CurveError, InspectedTable, Inspection
from palpate.delimited import Column, kind_of
from palpate_robot_log.reading import processed_curves
from palpate_robot_log.reading.assembly import assemble
from palpate_robot_log.reading.channel_map import ChannelMap
from palpate_robot_log.reading.formats import Request, read_log
from palpate_robot_log.reading.proposal import QUANTITIES, Proposal, propose
from palpate_robot_log.reading.proposal_toml import channel_map, study_text
from palpate_robot_log.reading.raw import RawLog, Stream
from palpate_robot_log.reading.time_checks import longest_step_s

_MOST_GAPS = 20
_TO_SECONDS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def inspect_log(path: Path, request: Request | None = None) -> Inspection:
    """Look into a log without knowing its columns.

    Parameters
    ----------
    path : Path
    request : Request, optional
        How text is laid out, and limits; columns and streams are left open.

    Raises
    ------
    CurveError
        The file cannot be read at all. What is merely wrong in it is among the findings.
    """
    log = read_log(path, request or Request())
    proposal = propose(log)
    problem, text = "", ""
    # A force of three components is a sensor's, whatever else the log has of depth.
    if "force" not in proposal.guesses and (text := processed_curves.study_text(log)):
        proposal = Proposal(guesses={}, time={})
        new = ["processed curves and no log: the loader csv reads them; check names and units"]
    else:
        problem, reads = _try(log, proposal)
        result = f"with this map: {problem}" if problem else f"this map reads the file: {reads}"
        guesses = [*proposal.guesses.values(), *proposal.time.values()]
        checks = dict.fromkeys(f"check {check}" for guess in guesses for check in guess.to_check)
        others = [
            f"{quantity} might also be: {'; '.join(', '.join(guess.columns) for guess in also)}"
            for quantity, also in proposal.others.items()
        ]
        new = [*checks, *others, result]
    clocks = {stream.name: _clock(stream, proposal) for stream in log.streams}
    findings = [*log.notes, *([] if text else _gap_findings(log, clocks)), *new]
    tables = () if text else (_streams_table(log, clocks),)
    text = text or study_text(log, proposal)
    return Inspection(
        tables=(*tables, _columns_table(log, proposal)),
        findings=tuple(findings),
        study_text=text,
        record={
            "file": str(path),
            "format": log.format,
            "layout": dict(log.layout),
            "streams": [_stream_record(stream, clocks[stream.name], proposal) for stream in log.streams],
            "channels": channel_map(proposal),
            "findings": findings,
            "problem": problem,
            "study_toml": text,
        },
    )


# -------------------------------------------------------------------------- clocks


@dataclass(frozen=True, slots=True, kw_only=True)
class _Clock:
    """Time of a stream, in seconds."""

    column: str
    begin_s: float
    end_s: float
    rate_hz: float
    n_repeated: int
    n_backwards: int
    gaps: tuple[dict[str, float], ...]


def _clock(stream: Stream, proposal: Proposal) -> _Clock | None:
    guess = proposal.time.get(stream.name)
    if guess is None:
        return None
    column = stream.columns[guess.columns[0]]
    unit = guess.unit or column.shown_unit
    is_there = np.isfinite(column.values)
    time = column.values[is_there] * _TO_SECONDS.get(unit, 1.0)
    rows = stream.rows[is_there]
    steps = np.diff(time)
    usual = float(np.median(steps))
    wide = np.flatnonzero(steps > longest_step_s(usual))
    return _Clock(
        column=column.name,
        begin_s=float(time[0]),
        end_s=float(time[-1]),
        rate_hz=1.0 / usual if usual > 0.0 else float("nan"),
        n_repeated=int((steps == 0.0).sum()),
        n_backwards=int((steps < 0.0).sum()),
        gaps=tuple(
            {"row": int(rows[i]), "time_s": float(time[i]), "seconds": float(steps[i])}
            for i in wide[:_MOST_GAPS]
        ),
    )


def _gap_findings(log: RawLog, clocks: Mapping[str, _Clock | None]) -> Iterable[str]:
    for stream in log.streams:
        clock = clocks[stream.name]
        if clock is None:
            yield f"{stream.label}: no column looks like time"
            continue
        for gap in clock.gaps[:3]:
            after = f"{log.row_word} {gap['row']} (t = {gap['time_s']:.4f} s)"
            yield f"{stream.label}: no rows for {gap['seconds']:.4g} s after {after}"
        if clock.n_repeated:
            yield f"{stream.label}: {clock.n_repeated} rows repeat the time of the row before"
        if clock.n_backwards:
            yield f"{stream.label}: time goes back {clock.n_backwards} times"


# ------------------------------------------------------------------------ proposal


def _try(log: RawLog, proposal: Proposal) -> tuple[str, str]:
    """Problem of reading the log by the proposal, or what comes of it."""
    chosen = channel_map(proposal)
    missing = [name for name in ("time", *QUANTITIES) if name not in chosen]
    if missing:
        return f"not found: {', '.join(missing)}; name their columns", ""
    try:
        recording = assemble(log, ChannelMap.model_validate(chosen)).recording
    except CurveError as error:
        return str(error), ""
    except ValidationError as error:
        return "; ".join(str(one["msg"]) for one in error.errors()), ""
    seconds = recording.time_s[-1] - recording.time_s[0]
    return "", f"{recording.n_rows} rows at {recording.rate_hz:.4g} Hz over {seconds:.4g} s"


def _roles(stream: Stream, proposal: Proposal) -> dict[str, str]:
    roles = {
        name: quantity
        for quantity, guess in proposal.guesses.items()
        if guess.stream == stream.name
        for name in guess.columns
    }
    time = proposal.time.get(stream.name)
    return roles | ({time.columns[0]: "time"} if time else {})


# -------------------------------------------------------------------------- showing


def _streams_table(log: RawLog, clocks: Mapping[str, _Clock | None]) -> InspectedTable:
    rows = []
    for stream in log.streams:
        clock = clocks[stream.name]
        begin, end, rate, gap = ("–",) * 4
        if clock is not None:
            begin, end, rate = f"{clock.begin_s:.3f}", f"{clock.end_s:.3f}", f"{clock.rate_hz:.4g}"
            gap = f"{max(gap['seconds'] for gap in clock.gaps):.3f}" if clock.gaps else "none"
        rows.append((stream.name or "–", str(stream.rows.size), begin, end, rate, gap))
    return InspectedTable(
        title=f"{log.source}: {log.format}",
        columns=("stream", f"{log.row_word}s", "from [s]", "to [s]", "rate [Hz]", "longest gap [s]"),
        rows=tuple(rows),
    )


def _columns_table(log: RawLog, proposal: Proposal) -> InspectedTable:
    rows = []
    for stream in log.streams:
        roles = _roles(stream, proposal)
        for column in stream.columns.values():
            facts = _facts(column)
            numbers = ("–" if facts[key] is None else f"{facts[key]:.6g}" for key in ("least", "largest"))
            role = roles.get(column.name, "")
            shown = _unit_shown(column) or ("–" if role == "orientation" else "?")
            missing = str(facts["n_missing"])
            rows.append((stream.name or "–", column.name, shown, *numbers, missing, role, column.note))
    return InspectedTable(
        title="Columns",
        columns=("stream", "column", "unit", "least", "largest", "missing", "taken for", "note"),
        rows=tuple(rows),
    )


def _unit_shown(column: Column) -> str:
    return column.shown_unit if kind_of(column.shown_unit) or column.unit else ""


def _facts(column: Column) -> dict[str, float | int | None]:
    there = column.values[np.isfinite(column.values)]
    return {
        "least": float(there.min()) if there.size else None,
        "largest": float(there.max()) if there.size else None,
        "n_missing": int(column.values.size - there.size),
    }


def _stream_record(stream: Stream, clock: _Clock | None, proposal: Proposal) -> dict[str, object]:
    roles = _roles(stream, proposal)
    return {
        "name": stream.name,
        "n_rows": int(stream.rows.size),
        "time": clock and asdict(clock) | {"gaps": list(clock.gaps)},
        "columns": [
            {
                "name": column.name,
                "unit": _unit_shown(column),
                **_facts(column),
                "taken_for": roles.get(column.name),
                "note": column.note,
            }
            for column in stream.columns.values()
        ],
    }
