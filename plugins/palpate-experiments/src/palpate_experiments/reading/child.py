"""The process that reads a stranger's file, and the form in which it answers.

The answer is one line of JSON and then the numbers, as doubles in the order named
there: nothing that the other side would have to trust.
"""

import json
import shutil
import sys
from pathlib import Path
from typing import IO, Any

import numpy as np

from palpate.errors import CurveError
from palpate.sandbox import NotAllowedError, allow_only, limit_resources
from palpate_experiments.reading.formats import Request, read_here
from palpate_experiments.reading.limits import Limits
from palpate_experiments.reading.raw import Column, RawLog, Stream
from palpate_experiments.reading.text_layout import TextFormat


def main() -> None:
    """Read the file that the request on stdin names, and answer on stdout.

    The scratch folder is removed here too: who asked may have been killed by then.
    """
    asked = json.load(sys.stdin)
    try:
        _answer(asked, sys.stdout.buffer)
    finally:
        shutil.rmtree(asked["scratch"], ignore_errors=True)


def _answer(asked: dict[str, Any], out: IO[bytes]) -> None:
    limits = Limits.model_validate(asked["limits"])
    limit_resources(limits.memory_mb, limits.time_s, limits.file_mb)
    path = Path(asked["path"])
    allow_only([path if path.is_dir() else path.resolve().parent], Path(asked["scratch"]))
    request = Request(
        columns=_names(asked["columns"]),
        streams=_names(asked["streams"]),
        text=TextFormat.model_validate(asked["text"]),
        limits=limits,
    )
    try:
        send(out, read_here(path, request))
    except CurveError as error:
        _refuse(out, str(error))
    except NotAllowedError as error:
        _refuse(out, f"{path}: refused, for reading it led elsewhere: {error}")


def _names(given: list[str] | None) -> tuple[str, ...] | None:
    return None if given is None else tuple(given)


def _refuse(out: IO[bytes], message: str) -> None:
    out.write(json.dumps({"error": message}).encode() + b"\n")
    out.flush()


def send(out: IO[bytes], log: RawLog) -> None:
    """Write a log."""
    head = {
        "source": log.source,
        "format": log.format,
        "row_word": log.row_word,
        "notes": list(log.notes),
        "layout": dict(log.layout),
        "streams": [
            {
                "name": stream.name,
                "n_rows": int(stream.rows.size),
                "columns": [[c.name, c.unit, c.note] for c in stream.columns.values()],
            }
            for stream in log.streams
        ],
    }
    out.write(json.dumps(head).encode() + b"\n")
    for stream in log.streams:
        out.write(np.ascontiguousarray(stream.rows, dtype="<i8").data)
        for column in stream.columns.values():
            out.write(np.ascontiguousarray(column.values, dtype="<f8").data)
    out.flush()


def receive(source: IO[bytes], head: dict[str, Any]) -> RawLog:
    """Read the numbers of a log after its first line.

    Raises
    ------
    EOFError
        There are fewer than the first line says.
    """
    return RawLog(
        source=str(head["source"]),
        format=str(head["format"]),
        row_word=str(head["row_word"]),
        notes=tuple(map(str, head["notes"])),
        layout=dict(head["layout"]),
        streams=tuple(_receive_stream(source, stream) for stream in head["streams"]),
    )


def _receive_stream(source: IO[bytes], head: dict[str, Any]) -> Stream:
    n_rows = int(head["n_rows"])
    rows = _receive_array(source, np.empty(n_rows, dtype="<i8"))
    columns = {}
    for name, unit, note in head["columns"]:
        values = _receive_array(source, np.empty(n_rows, dtype="<f8"))
        columns[str(name)] = Column(name=str(name), values=values, unit=str(unit), note=str(note))
    return Stream(name=str(head["name"]), rows=rows, columns=columns)


def _receive_array(source: IO[bytes], array: np.ndarray) -> np.ndarray:
    view = array.view(np.uint8)
    filled = 0
    while filled < view.size:
        n_bytes = source.readinto(view[filled:])  # type: ignore[attr-defined]
        if not n_bytes:
            raise EOFError
        filled += n_bytes
    return array
