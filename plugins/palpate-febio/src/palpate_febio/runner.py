"""Runs a program that may hang, flood, crash or lie, and leaves nothing of it behind."""

import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from palpate.errors import PluginError

TAIL_CHARACTERS = 32_000
POLL_S = 0.05
GRACE_S = 5.0
"""Between asking a program to end and ending it."""

LARGEST_OUTPUT_BYTES = 1_000_000_000

GUARD = ("/bin/sh", "-c", 'read -r _; kill -9 -"$0"; [ -z "$1" ] || /bin/rm -rf -- "$1"')
"""Waits for the end of its input, which this process holds open, then ends a group and removes a folder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """When a run is given up: after ``time_s``, or when nothing was written for ``stall_s``."""

    time_s: float
    stall_s: float
    grace_s: float = GRACE_S
    output_bytes: int = LARGEST_OUTPUT_BYTES


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """How a run ended.

    ``exit_code`` is negative where a signal ended it; ``stopped`` says why it was
    stopped, and is empty where it ended by itself. ``tail`` is the last of what
    it printed.
    """

    exit_code: int
    stopped: str
    tail: str
    seconds: float


class _Tail:
    """Drains a pipe, so that its writer never waits, and keeps the end of it."""

    def __init__(self, stream: int) -> None:
        self.stream = os.dup(stream)  # its own: a child that escaped may hold the pipe for ever
        self.kept = b""
        self.n_bytes = 0
        self.thread = threading.Thread(target=self.drain, daemon=True)
        self.thread.start()

    def drain(self) -> None:
        with open(self.stream, "rb", buffering=0) as stream:
            while chunk := stream.read(65536):
                self.n_bytes += len(chunk)
                self.kept = (self.kept + chunk)[-TAIL_CHARACTERS:]

    def text(self) -> str:
        self.thread.join(1.0)
        return self.kept.decode("utf-8", "replace")


def run_program(
    command: Sequence[str],
    folder: Path,
    limits: Limits,
    environment: Mapping[str, str] | None = None,
    *,
    is_scratch: bool = False,
) -> Ended:
    """Run a program in a folder, in a process group of its own and without input.

    Should this process be killed meanwhile, the program is ended all the same.

    Parameters
    ----------
    command : sequence of str
    folder : Path
        Its working directory; growth of the files there counts as progress.
    limits : Limits
    environment : mapping, optional
        Added to this process's own.
    is_scratch : bool
        Nobody will want the folder if this process is killed.

    Raises
    ------
    PluginError
        The program cannot be started.
    """
    started = time.monotonic()
    with (
        _started(command, folder, environment, limits.grace_s) as process,
        _guarded(process.pid, folder if is_scratch else None),
    ):
        assert process.stdout is not None
        tail = _Tail(process.stdout.fileno())
        stopped = _watched(process, folder, limits, tail)
        if stopped:
            end_group(process, limits.grace_s)
        code = process.wait()
    return Ended(exit_code=code, stopped=stopped, tail=tail.text(), seconds=time.monotonic() - started)


@contextmanager
def _started(
    command: Sequence[str], folder: Path, environment: Mapping[str, str] | None, grace_s: float
) -> Iterator[subprocess.Popen[bytes]]:
    try:
        process = subprocess.Popen(
            list(command),
            cwd=folder,
            env={**os.environ, **(environment or {})},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    except OSError as error:
        raise PluginError(
            f"{command[0]}: cannot be started ({error.strerror}); check the setting executable"
        ) from None
    try:
        yield process
    finally:
        # Children of it that still hold the pipe would keep running, and be waited for.
        end_group(process, grace_s if process.poll() is None else 0.0)
        if process.stdout is not None:
            process.stdout.close()


@contextmanager
def _guarded(group: int, scratch: Path | None) -> Iterator[None]:
    """Have a shell, in a group of its own, end a process group should this process be gone."""
    if os.name != "posix":
        yield
        return
    guard = subprocess.Popen(
        [*GUARD, str(group), "" if scratch is None else str(scratch)],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        yield
    finally:
        guard.kill()  # first, so that the end of its input means nothing any more
        guard.wait()
        assert guard.stdin is not None
        guard.stdin.close()


def end_group(process: "subprocess.Popen[bytes]", grace_s: float) -> None:
    """Ask a process and its children to end, and end them where they do not."""
    if os.name != "posix":
        process.kill()
        process.wait()
        return
    for sign in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, sign)
        except (ProcessLookupError, PermissionError):
            break
        try:
            process.wait(grace_s)
        except subprocess.TimeoutExpired:
            continue
    process.wait()


def _watched(process: "subprocess.Popen[bytes]", folder: Path, limits: Limits, tail: _Tail) -> str:
    """Wait for the end; says why it has to be stopped, or nothing when it ended by itself."""
    started = grown = time.monotonic()
    size = -1
    while process.poll() is None:
        time.sleep(POLL_S)
        now = time.monotonic()
        current = tail.n_bytes + _size(folder)
        if current != size:
            size, grown = current, now
        if now - started > limits.time_s:
            return f"stopped after {limits.time_s:g} s, its time limit"
        if now - grown > limits.stall_s:
            return f"stopped: nothing written for {limits.stall_s:g} s"
        if size > limits.output_bytes:
            return f"stopped: more than {limits.output_bytes:,} bytes written"
    return ""


def _size(folder: Path) -> int:
    total = 0
    for file in os.scandir(folder):
        try:
            total += file.stat().st_size
        except OSError:
            continue
    return total
