"""Reading in a process of its own, with bounded memory and time."""

import json
import tempfile
from pathlib import Path

from palpate.errors import CurveError
from palpate.sandbox import Child, child
from palpate_experiments.reading.child import receive
from palpate_experiments.reading.formats import Request, check_size
from palpate_experiments.reading.raw import RawLog

_LONGEST_HEAD = 1 << 24


def read_log(path: Path, request: Request) -> RawLog:
    """Read a file in a process that may do nothing else.

    Whatever the bytes of the file lead a parser to, what comes back is a log or an
    error that names the file: also when that process is killed, hangs, or asks for
    more memory than ``request.limits`` allows.

    Parameters
    ----------
    path : Path
    request : Request

    Raises
    ------
    CurveError
    """
    check_size(path, request.limits)
    with tempfile.TemporaryDirectory(prefix="palpate-") as scratch:
        return _ask(path, request, scratch)


def _ask(path: Path, request: Request, scratch: str) -> RawLog:
    asked = {
        "path": str(path),
        "scratch": scratch,
        "columns": request.columns,
        "streams": request.streams,
        "text": request.text.model_dump(),
        "limits": request.limits.model_dump(),
    }
    with child("palpate_experiments.reading.child", request.limits.time_s, scratch) as process:
        try:
            process.stdin.write(json.dumps(asked).encode())
            process.stdin.close()
            line = process.stdout.readline(_LONGEST_HEAD)
            head = json.loads(line) if line.endswith(b"\n") else None
            if isinstance(head, dict) and "error" in head:
                raise CurveError(str(head["error"]))
            if isinstance(head, dict):
                _check_answer(path, head, request)
                return receive(process.stdout, head)
        except (EOFError, OSError, json.JSONDecodeError):
            pass
        raise CurveError(_how_it_ended(path, process, request))


def _check_answer(path: Path, head: dict[str, object], request: Request) -> None:
    streams = head.get("streams")
    assert isinstance(streams, list)
    n_values = sum(int(s["n_rows"]) * (1 + len(s["columns"])) for s in streams)
    request.limits.check_values(str(path), n_values, "the log")


def _how_it_ended(path: Path, process: Child, request: Request) -> str:
    if process.took_too_long():
        return (
            f"{path}: reading took longer than {request.limits.time_s:g} s and was stopped; the file is "
            "damaged or too large: export fewer columns, or raise time_s under limits in the loader's "
            "settings"
        )
    how = process.how_it_ended()
    return f"{path}: its reader ended without an answer ({how}); the file is damaged: save it again"
