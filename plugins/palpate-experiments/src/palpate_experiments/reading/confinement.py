"""What a process that reads a stranger's file gives up before it opens it.

Limits of the operating system hold memory, time and written files; an audit hook
refuses to start programs, to reach the network, to unpickle, and to open files
outside the folder of the log. The hook sees what Python does, not what a C library
does by itself: there the readers refuse every reference to another file.
"""

import os
import sys
import sysconfig
from collections.abc import Callable
from pathlib import Path
from typing import Any

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


class NotAllowedError(PermissionError):
    """The file led its reader to something that reading needs not."""


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


def allow_only(folder: Path, scratch: Path) -> None:
    """From here on refuse what reading a file in ``folder`` needs not. It cannot be undone.

    Parameters
    ----------
    folder : Path
        Only what is inside may be read, beside what Python itself is made of.
    scratch : Path
        Only what is inside may be written, or removed.
    """
    sys.addaudithook(_guard(_readable_places(folder), os.path.realpath(scratch)))


def _readable_places(folder: Path) -> tuple[str, ...]:
    """Return the log's folder, and where Python and its packages are imported from."""
    places = {str(folder.resolve()), sys.prefix, sys.base_prefix, *sysconfig.get_paths().values()}
    places |= {path for path in sys.path if path}
    real = {os.path.realpath(place) for place in places}
    return (*sorted(real), "/proc/self", "/sys/fs/cgroup", "/dev/null")


def _guard(places: tuple[str, ...], scratch: str) -> Callable[[str, tuple[Any, ...]], None]:
    write = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC

    def guard(event: str, arguments: tuple[Any, ...]) -> None:
        if event in _REFUSED:
            raise NotAllowedError(f"reading a log needs no {event}")
        if event in _REMOVAL:
            # Relative to an open folder: that one was checked when it was opened.
            if arguments[-1] in (None, -1) and not _is_in(arguments[0], (scratch,)):
                raise NotAllowedError(f"reading a log removes no file, such as {arguments[0]}")
        elif event == "open":
            path, _, flags = arguments
            if isinstance(path, int) or path is None or _is_in(path, (scratch,)):
                return
            if isinstance(flags, int) and flags & write:
                raise NotAllowedError(f"reading a log writes no file, such as {os.fsdecode(path)}")
            if not _is_in(path, places):
                raise NotAllowedError(f"{os.fsdecode(path)} lies outside of the log's folder")

    return guard


def _is_in(path: str | bytes, places: tuple[str, ...]) -> bool:
    real = os.path.realpath(os.fsdecode(path))
    return any(real == place or real.startswith(place + os.sep) for place in places)
