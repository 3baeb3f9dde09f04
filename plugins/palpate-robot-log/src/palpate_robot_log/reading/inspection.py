"""``palpate experiment inspect``: what is in a log, and a map that may read it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from palpate.api import CurveError
from palpate.api.files import Column, InspectedTable, Inspection, kind_of
from palpate_robot_log.reading.assembly import assemble
from palpate_robot_log.reading.channel_map import ChannelMap, LogFiles
from palpate_robot_log.reading.checks import longest_step_s
from palpate_robot_log.reading.formats import Request, read_log
from palpate_robot_log.reading.judgement import judged
from palpate_robot_log.reading.processed_curves import curves_text
from palpate_robot_log.reading.proposal import QUANTITIES, Proposal, channel_map, propose, study_text
from palpate_robot_log.reading.raw import RawLog, Stream
from palpate_robot_log.reading.two_files import read_both

_MOST_GAPS = 20
_TO_SECONDS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def inspect_log(path: Path, wrench: Path | None = None, request: Request | None = None) -> Inspection:
    """Contents of a log of unknown columns, and a study that may read it.

    Parameters
    ----------
    path : Path
        Of any format that is read.
    wrench : Path, optional
        The file of the wrench where ``path`` has the pose alone.
    request : Request, optional
        How text is laid out, and limits; columns and streams are left open.

    Raises
    ------
    CurveError
        The file cannot be read at all. What is merely wrong in it is among the findings.
    """
    request = request or Request()
    if wrench is None:
        log = read_log(path, request)
        proposal = propose(log)
    else:
        log = read_both(path, wrench, request)
        proposal = replace(propose(log), files=LogFiles.of(path, wrench).model_dump())
    proposal = judged(log, proposal)
    # A force of three components is a sensor's, whatever else the log has of depth.
    text = "" if "force" in proposal.guesses else curves_text(log)
    if text:
        proposal, problem = Proposal(guesses={}, time={}), ""
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
    streams = [_described(stream, proposal) for stream in log.streams]
    findings = (*log.notes, *(() if text else _gap_findings(log, streams)), *new)
    tables = () if text else (_streams_table(log, streams),)
    text = text or study_text(log, proposal)
    return Inspection(
        tables=(*tables, _columns_table(streams)),
        findings=findings,
        study_text=text,
        record={
            "file": str(path),
            "wrench_file": wrench and str(wrench),
            "format": log.format,
            "layout": dict(log.layout),
            "streams": streams,
            "channels": channel_map(proposal),
            "findings": list(findings),
            "problem": problem,
            "study_toml": text,
        },
    )


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


def _described(stream: Stream, proposal: Proposal) -> dict[str, Any]:
    """Clock and columns of a stream in plain values."""
    guesses = {what: guess for what, guess in proposal.guesses.items() if guess.stream == stream.name}
    roles = {name: what for what, guess in guesses.items() for name in guess.columns}
    time = proposal.time.get(stream.name)
    roles |= {time.columns[0]: "time"} if time else {}
    return {
        "name": stream.name,
        "n_rows": int(stream.rows.size),
        "time": time and _clock(stream, stream.columns[time.columns[0]], time.unit),
        "columns": [_of_column(column, roles.get(column.name)) for column in stream.columns.values()],
    }


def _clock(stream: Stream, column: Column, unit: str) -> dict[str, Any]:
    is_there = np.isfinite(column.values)
    time = column.values[is_there] * _TO_SECONDS.get(unit or column.shown_unit, 1.0)
    rows = stream.rows[is_there]
    steps = np.diff(time)
    usual = float(np.median(steps))
    wide = np.flatnonzero(steps > longest_step_s(usual))
    return {
        "column": column.name,
        "begin_s": float(time[0]),
        "end_s": float(time[-1]),
        "rate_hz": 1.0 / usual if usual > 0.0 else float("nan"),
        "n_repeated": int((steps == 0.0).sum()),
        "n_backwards": int((steps < 0.0).sum()),
        "gaps": [
            {"row": int(rows[i]), "time_s": float(time[i]), "seconds": float(steps[i])}
            for i in wide[:_MOST_GAPS]
        ],
    }


def _of_column(column: Column, role: str | None) -> dict[str, Any]:
    there = column.values[np.isfinite(column.values)]
    return {
        "name": column.name,
        "unit": column.shown_unit if kind_of(column.shown_unit) or column.unit else "",
        "least": float(there.min()) if there.size else None,
        "largest": float(there.max()) if there.size else None,
        "n_missing": int(column.values.size - there.size),
        "taken_for": role,
        "note": column.note,
    }


def _gap_findings(log: RawLog, streams: Sequence[Mapping[str, Any]]) -> Iterable[str]:
    for stream, described in zip(log.streams, streams, strict=True):
        clock = described["time"]
        if clock is None:
            yield f"{stream.label}: no column looks like time"
            continue
        for gap in clock["gaps"][:3]:
            after = f"{log.row_word} {gap['row']} (t = {gap['time_s']:.4f} s)"
            yield f"{stream.label}: no rows for {gap['seconds']:.4g} s after {after}"
        if clock["n_repeated"]:
            yield f"{stream.label}: {clock['n_repeated']} rows repeat the time of the row before"
        if clock["n_backwards"]:
            yield f"{stream.label}: time goes back {clock['n_backwards']} times"


def _streams_table(log: RawLog, streams: Sequence[Mapping[str, Any]]) -> InspectedTable:
    rows = []
    for stream in streams:
        shown = ("–",) * 4
        if clock := stream["time"]:
            gap = f"{max(gap['seconds'] for gap in clock['gaps']):.3f}" if clock["gaps"] else "none"
            shown = (f"{clock['begin_s']:.3f}", f"{clock['end_s']:.3f}", f"{clock['rate_hz']:.4g}", gap)
        rows.append((stream["name"] or "–", str(stream["n_rows"]), *shown))
    return InspectedTable(
        title=f"{log.source}: {log.format}",
        columns=("stream", f"{log.row_word}s", "from [s]", "to [s]", "rate [Hz]", "longest gap [s]"),
        rows=tuple(rows),
    )


def _columns_table(streams: Sequence[Mapping[str, Any]]) -> InspectedTable:
    rows = []
    for stream in streams:
        for column in stream["columns"]:
            role = column["taken_for"] or ""
            unit = column["unit"] or ("–" if role == "orientation" else "?")
            extremes = (column["least"], column["largest"])
            numbers = ("–" if number is None else f"{number:.6g}" for number in extremes)
            missing, name = str(column["n_missing"]), stream["name"] or "–"
            rows.append((name, column["name"], unit, *numbers, missing, role, column["note"]))
    return InspectedTable(
        title="Columns",
        columns=("stream", "column", "unit", "least", "largest", "missing", "taken for", "note"),
        rows=tuple(rows),
    )
