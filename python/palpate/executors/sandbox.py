"""Programs and functions in processes with limits: they cannot hang this process, nor outlive it.

:func:`run_program` runs a program in a folder; :func:`run_function` calls a Python function in a process
of its own, such as a reader of files that may be damaged.
"""

import contextlib
import math
import os
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, ParamSpec, TypeVar, cast

from palpate.errors import PalpateError, PluginError

P = ParamSpec("P")
T = TypeVar("T")

TAIL_CHARACTERS = 32_000

_IS_POSIX = os.name == "posix"


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessLimits:
    """Limits at which a process is stopped.

    Parameters
    ----------
    stall_s : float
        Longest time in which it writes nothing.
    memory_mb : float
        Largest address space [MB]; kept on Linux alone.
    grace_s : float
        Between asking it to end and killing it.
    output_bytes : int
        Most that it may print and write into its folder.
    """

    time_s: float
    stall_s: float = math.inf
    memory_mb: float = math.inf
    grace_s: float = 5.0
    output_bytes: int = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """End of a process.

    ``exit_code`` is negative where a signal ended it; ``stopped`` names the limit
    that it exceeded, and is empty where it ended by itself. ``tail`` is the last of what
    it printed.
    """

    exit_code: int
    stopped: str
    tail: str
    seconds: float

    def __str__(self) -> str:
        """Limit, signal, or last line and exit code."""
        if self.stopped or self.exit_code < 0:
            return self.stopped or f"ended by {how_it_ended(self.exit_code)}"
        last = (self.tail.strip().splitlines() or ["nothing printed"])[-1][:300]
        return f"{how_it_ended(self.exit_code)}: {last}"


def how_it_ended(exit_code: int | None) -> str:
    """Exit code of a process, or the name of the signal that ended it."""
    if not exit_code or exit_code > 0:
        return f"exit code {exit_code}"
    with contextlib.suppress(ValueError):  # a real-time signal
        name = signal.Signals(-exit_code).name
        return f"signal {name}{' (killed from outside, or for its memory)' if name == 'SIGKILL' else ''}"
    return f"signal {-exit_code}"


def run_program(
    command: Sequence[str],
    folder: Path,
    limits: ProcessLimits,
    environment: Mapping[str, str] | None = None,
    *,
    is_scratch: bool = False,
    working_directory: Path | None = None,
) -> Ended:
    """Run a program in a folder, in a process group of its own and without input.

    Should this process be killed meanwhile, the program is killed too.

    Parameters
    ----------
    folder : Path
        Growth of the files there counts as progress.
    environment : mapping, optional
        Added to this process's own.
    is_scratch : bool
        The folder is removed if this process is killed.
    working_directory : Path, optional
        The folder when left out.

    A PluginError where the program cannot be started.
    """
    started = time.monotonic()
    # A file, not a pipe: it needs nobody to drain it, nor waits for a grandchild that holds it.
    with tempfile.TemporaryFile() as printed:
        with (
            _started(command, working_directory or folder, environment, limits, printed) as process,
            guarded(process.pid, folder if is_scratch else None),
        ):
            if process.stdin is not None:  # its guard knows its group now
                with contextlib.suppress(BrokenPipeError), process.stdin as gate:  # it may have been killed
                    gate.write(b"\n")
            stopped = _watched(process, folder, limits, printed)
            if stopped:
                end_group(process, limits.grace_s)
            code = process.wait()
        printed.seek(max(0, printed.seek(0, os.SEEK_END) - TAIL_CHARACTERS))
        tail = printed.read(TAIL_CHARACTERS).decode("utf-8", "replace")
    return Ended(exit_code=code, stopped=stopped, tail=tail, seconds=time.monotonic() - started)


def run_function(limits: ProcessLimits, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Call a function in a process of its own; its ``tempfile.gettempdir()`` is removed afterwards.

    Parameters
    ----------
    function : callable
        At the top level of a module. It, its arguments and what it returns are pickled.

    Raises
    ------
    PalpateError, ImportError, MemoryError
        As the function raises them.
    ChildProcessError
        The process ended otherwise, or exceeded a limit other than memory; the message gives how.
    """
    with tempfile.TemporaryDirectory(prefix="palpate-") as scratch:
        folder = Path(scratch)
        (folder / _REQUEST).write_bytes(pickle.dumps((function, args, kwargs)))
        environment = {"PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path)), "TMPDIR": scratch}
        if math.isfinite(limits.memory_mb):
            from palpate.executors.machine import thread_limits  # here: it takes long to import

            environment |= thread_limits(1)  # each thread reserves memory
            del environment["POLARS_MAX_THREADS"]
        command = [sys.executable, "-P", "-c", f"from {__name__} import _answer; _answer()", scratch]
        ended = run_program(
            command, folder, limits, environment, is_scratch=True, working_directory=Path.cwd()
        )
        if ended.stopped or ended.exit_code:
            raise ChildProcessError(str(ended))
        with (folder / _ANSWER).open("rb") as stream:
            is_error, answer = pickle.load(stream)
    if is_error:
        raise answer
    return cast("T", answer)


_REQUEST, _ANSWER = "request.pickle", "answer.pickle"


def _answer() -> None:
    """Call the function that the request in a folder names."""
    folder = Path(sys.argv[1])
    try:
        function, args, kwargs = pickle.loads((folder / _REQUEST).read_bytes())
        answer = (False, function(*args, **kwargs))
    except (PalpateError, ImportError, MemoryError) as error:
        answer = (True, error)
    with (folder / _ANSWER).open("wb") as stream:
        pickle.dump(answer, stream, protocol=pickle.HIGHEST_PROTOCOL)


@contextmanager
def _started(
    command: Sequence[str],
    folder: Path,
    environment: Mapping[str, str] | None,
    limits: ProcessLimits,
    printed: IO[bytes],
) -> Iterator[subprocess.Popen[bytes]]:
    variables = {**os.environ, **(environment or {})}
    try:
        # Becomes a program once a line comes in; ends where none can come any more.
        process = subprocess.Popen(
            [
                *(("/bin/sh", "-c", 'read -r _ && exec "$@" </dev/null', "sh") if _IS_POSIX else ()),
                _located(command[0], folder, variables),
                *command[1:],
            ],
            cwd=folder,
            env=variables,
            stdin=subprocess.PIPE if _IS_POSIX else subprocess.DEVNULL,
            stdout=printed,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    except OSError as error:
        raise PluginError(f"{command[0]}: cannot be started ({error.strerror}); check its path") from None
    try:
        _limit_memory(process.pid, limits.memory_mb)
        yield process
    finally:
        # Processes that it started would keep running.
        end_group(process, limits.grace_s if process.poll() is None else 0.0)
        if process.stdin is not None:
            process.stdin.close()


def _limit_memory(pid: int, memory_mb: float) -> None:
    if sys.platform == "linux" and math.isfinite(memory_mb):
        import resource

        n_bytes = int(memory_mb * 1e6)
        with contextlib.suppress(OSError):  # it may have ended, or have a lower limit already
            resource.prlimit(pid, resource.RLIMIT_AS, (n_bytes, n_bytes))


def _located(program: str, folder: Path, variables: Mapping[str, str]) -> str:
    """Path of a program that is relative to a folder, or on the search path of its variables."""
    name = str(folder.absolute() / program) if os.path.dirname(program) else program
    found = shutil.which(name, path=variables.get("PATH"))
    if found is None:
        raise PluginError(f"{program}: cannot be started (no such program); check its path")
    return found


@contextmanager
def guarded(group: int, scratch: Path | None = None) -> Iterator[None]:
    """Have a shell, in a group of its own, kill a process group if this process is killed."""
    if not _IS_POSIX:
        yield
        return
    # Waits for the end of its input, which this process holds open, then kills a group and removes a
    # folder.
    guard = subprocess.Popen(
        [
            *("/bin/sh", "-c", 'read -r _; kill -9 -"$0"; [ -z "$1" ] || /bin/rm -rf -- "$1"'),
            str(group),
            "" if scratch is None else str(scratch),
        ],
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
    """Ask a process group to end, and kill it where it does not."""
    if _IS_POSIX:
        with contextlib.suppress(ProcessLookupError, PermissionError, subprocess.TimeoutExpired):
            os.killpg(process.pid, signal.SIGTERM)
            process.wait(grace_s)
    kill_group(process)
    process.wait()


def kill_group(process: "subprocess.Popen[bytes]") -> None:
    """Kill a process with everything that it started."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        if _IS_POSIX:
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()


def _watched(
    process: "subprocess.Popen[bytes]", folder: Path, limits: ProcessLimits, printed: IO[bytes]
) -> str:
    """Wait for the end; returns why it has to be stopped, empty when it ended by itself."""
    started = grown = time.monotonic()
    size = -1
    while True:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(0.05)
            return ""
        now = time.monotonic()
        current = os.fstat(printed.fileno()).st_size + _size(folder)
        if current != size:
            size, grown = current, now
        if now - started > limits.time_s:
            return f"stopped after {limits.time_s:g} s, its time limit"
        if now - grown > limits.stall_s:
            return f"stopped: nothing written for {limits.stall_s:g} s"
        if size > limits.output_bytes:
            return f"stopped: more than {limits.output_bytes:,} bytes written"


def _size(folder: Path) -> int:
    total = 0
    for file in os.scandir(folder):
        with contextlib.suppress(OSError):
            total += file.stat().st_size
    return total
