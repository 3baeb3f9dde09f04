"""Reading in a process of its own, with bounded memory and time."""

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from palpate.errors import CurveError
from palpate.executors import thread_limits
from palpate_experiments.reading.child import receive
from palpate_experiments.reading.formats import Request, check_size
from palpate_experiments.reading.raw import RawLog

_LONGEST_HEAD = 1 << 24
_START_S = 60.0
_PIPE_BYTES = 1 << 20


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
    with _child(request.limits.time_s, scratch) as (process, messages, late):
        assert process.stdin is not None
        assert process.stdout is not None
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
        raise CurveError(_how_it_ended(path, process, messages, late, request))


def _check_answer(path: Path, head: dict[str, object], request: Request) -> None:
    streams = head.get("streams")
    assert isinstance(streams, list)
    n_values = sum(int(s["n_rows"]) * (1 + len(s["columns"])) for s in streams)
    request.limits.check_values(str(path), n_values, "the log")


@contextmanager
def _child(
    time_s: float, scratch: str
) -> Iterator[tuple["subprocess.Popen[bytes]", IO[bytes], threading.Event]]:
    late = threading.Event()
    with tempfile.TemporaryFile() as messages:
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", "from palpate_experiments.reading.child import main; main()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=messages,
            pipesize=_PIPE_BYTES,
            env={**os.environ, **_environment(), "TMPDIR": scratch},
        )

        def stop() -> None:
            late.set()
            process.kill()

        timer = threading.Timer(time_s + _START_S, stop)
        timer.start()
        try:
            yield process, messages, late
        finally:
            timer.cancel()
            process.kill()
            process.wait()
            for stream in (process.stdin, process.stdout):
                if stream is not None and not stream.closed:
                    stream.close()


def _environment() -> dict[str, str]:
    search_path = os.pathsep.join(path or os.getcwd() for path in sys.path)
    one_thread = {key: value for key, value in thread_limits(1).items() if key != "POLARS_MAX_THREADS"}
    # HDF5 would load filters as shared libraries from wherever the environment says.
    return {
        **one_thread,
        "PYTHONPATH": search_path,
        "HDF5_PLUGIN_PRELOAD": "::",
        "PYTHONDONTWRITEBYTECODE": "1",
    }


def _how_it_ended(
    path: Path,
    process: "subprocess.Popen[bytes]",
    messages: IO[bytes],
    late: threading.Event,
    request: Request,
) -> str:
    try:
        code = process.wait(timeout=10.0)
    except subprocess.TimeoutExpired:
        code = 0
    if late.is_set() or code == -24:  # SIGXCPU
        return (
            f"{path}: reading took longer than {request.limits.time_s:g} s and was stopped; the file is "
            "damaged or too large: export fewer columns, or raise time_s under limits in the loader's "
            "settings"
        )
    messages.seek(0)
    lines = messages.read(65536).decode("utf-8", "replace").strip().splitlines()
    why = f"signal {-code}" if code < 0 else (lines[-1] if lines else f"exit code {code}")
    return f"{path}: its reader ended without an answer ({why}); the file is damaged: save it anew"
