"""A process of its own for reading a file that somebody else made.

Limits of the operating system bound its memory, time and written files; an audit hook
refuses to start programs, to reach the network, to unpickle, and to open files
outside the folder of the file. The hook sees what Python does, not what a C library
does by itself: there the readers refuse every reference to another file.
"""

import os
import subprocess
import sys
import sysconfig
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from palpate.executors.machine import thread_limits

_REFUSED = (
    "subprocess.Popen",
    "os.system",
    "os.exec",
    "os.fork",
    "os.forkpty",
    "os.posix_spawn",
    "os.spawn",
    "os.startfile",
    "os.rename",
    "os.link",
    "os.symlink",
    "os.truncate",
    "pickle.find_class",
    "marshal.load",
    "socket.__new__",
    "socket.connect",
    "socket.bind",
    "urllib.Request",
    "webbrowser.open",
)
_REMOVAL = ("os.remove", "os.rmdir", "shutil.rmtree")


_START_S = 60.0
_PIPE_BYTES = 1 << 20


class NotAllowedError(PermissionError):
    """The file led its reader to something that reading needs not."""


@dataclass(frozen=True, slots=True, eq=False)
class Child:
    """A reading process.

    Parameters
    ----------
    stdin, stdout : binary streams
        What it is asked, and what it answers.
    """

    stdin: IO[bytes]
    stdout: IO[bytes]
    _process: "subprocess.Popen[bytes]"
    _messages: IO[bytes]
    _late: threading.Event

    def took_too_long(self) -> bool:
        """Whether it was stopped for the time it took."""
        return self._late.is_set() or self._code() == -24  # SIGXCPU

    def how_it_ended(self) -> str:
        """Its last words, or the signal or code that it ended with."""
        code = self._code()
        self._messages.seek(0)
        lines = self._messages.read(65536).decode("utf-8", "replace").strip().splitlines()
        return f"signal {-code}" if code < 0 else (lines[-1] if lines else f"exit code {code}")

    def _code(self) -> int:
        try:
            return self._process.wait(timeout=10.0)
        except subprocess.TimeoutExpired:
            return 0


@contextmanager
def child(module: str, time_s: float, scratch: str) -> Iterator[Child]:
    """A Python process that runs ``main`` of a module, ended with the block or when its time is up.

    Parameters
    ----------
    module : str
        Its ``main`` calls :func:`limit_resources` and :func:`allow_only` before it opens the file.
    time_s : float
    scratch : str
        Folder for temporary files.
    """
    late = threading.Event()
    with tempfile.TemporaryFile() as messages:
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", f"from {module} import main; main()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=messages,
            pipesize=_PIPE_BYTES,
            env={**os.environ, **_environment(), "TMPDIR": scratch},
        )
        assert process.stdin is not None
        assert process.stdout is not None

        def stop() -> None:
            late.set()
            process.kill()

        timer = threading.Timer(time_s + _START_S, stop)
        timer.start()
        try:
            yield Child(process.stdin, process.stdout, process, messages, late)
        finally:
            timer.cancel()
            process.kill()
            process.wait()
            for stream in (process.stdin, process.stdout):
                if not stream.closed:
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


def limit_resources(memory_mb: float, time_s: float, written_mb: float) -> None:
    """Hold this process to so much memory, time of the processor and size of a written file. Unix only."""
    try:
        import resource
    except ImportError:
        return
    n_bytes = int(memory_mb * 1e6)
    for kind, most in (
        (resource.RLIMIT_AS, n_bytes),
        (resource.RLIMIT_CPU, int(time_s * (os.cpu_count() or 1)) + 1),
        (resource.RLIMIT_FSIZE, int(written_mb * 1e6)),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(kind)
        value = most if hard == resource.RLIM_INFINITY else min(most, hard)
        try:
            resource.setrlimit(kind, (value, value))
        except (ValueError, OSError):
            continue  # some systems know a limit by name and do not let it be set


def allow_only(folders: Sequence[Path], scratch: Path) -> None:
    """From here on refuse what reading a file in ``folders`` needs not. It cannot be undone.

    Parameters
    ----------
    folders : sequence of Path
        Only what is inside may be read, besides what Python itself is made of.
    scratch : Path
        Only what is inside may be written, or removed.
    """
    libraries = [sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    sys.addaudithook(_guard(_readable_places(folders), libraries, os.path.realpath(scratch)))


def _readable_places(folders: Sequence[Path]) -> tuple[str, ...]:
    """Return the file's folders, and where Python and its packages are imported from."""
    places = {*map(str, folders), sys.prefix, sys.base_prefix, *sysconfig.get_paths().values()}
    places |= {path for path in sys.path if path}
    real = {os.path.realpath(place) for place in places}
    return (*sorted(real), "/proc/self", "/sys/fs/cgroup", "/dev/null")


def _guard(
    places: Sequence[str], libraries: Sequence[str], scratch: str
) -> Callable[[str, tuple[Any, ...]], None]:
    write = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC

    def guard(event: str, arguments: tuple[Any, ...]) -> None:
        if event in _REFUSED:
            raise NotAllowedError(f"reading a file needs no {event}")
        if event in _REMOVAL:
            # Relative to an open folder: that one was checked when it was opened.
            if arguments[-1] in (None, -1) and not _is_in(arguments[0], (scratch,)):
                raise NotAllowedError(f"reading a file removes no file, such as {arguments[0]}")
        elif event == "open":
            path, _, flags = arguments
            if isinstance(path, int) or path is None or _is_in(path, (scratch,)):
                return
            if isinstance(flags, int) and flags & write:
                raise NotAllowedError(f"reading a file writes no file, such as {os.fsdecode(path)}")
            if not (_is_in(path, places) or _is_installed(path, libraries)):
                raise NotAllowedError(f"{os.fsdecode(path)} lies outside of the file's folder")

    return guard


def _is_installed(path: str | bytes, libraries: Sequence[str]) -> bool:
    """Whether a file is among the packages by its name: some installers put links to a cache there."""
    name = os.fsdecode(path)
    return ".." not in Path(name).parts and _is_below(os.path.abspath(name), libraries)


def _is_in(path: str | bytes, places: Sequence[str]) -> bool:
    return _is_below(os.path.realpath(os.fsdecode(path)), places)


def _is_below(path: str, places: Sequence[str]) -> bool:
    return any(path == place or path.startswith(place + os.sep) for place in places)
