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
    "os.remove",
    "os.rename",
    "os.rmdir",
    "os.link",
    "os.symlink",
    "os.truncate",
    "pickle.find_class",
    "marshal.load",
    "shutil.rmtree",
    "socket.__new__",
    "socket.connect",
    "socket.bind",
    "urllib.Request",
    "webbrowser.open",
)
_LARGEST_WRITTEN_BYTES = 1 << 20


class NotAllowedError(PermissionError):
    """The file led its reader to something that reading needs not."""


def limit_resources(memory_mb: float, time_s: float) -> None:
    """Hold this process to so much memory, time of the processor and written bytes. Unix only."""
    try:
        import resource
    except ImportError:
        return
    n_bytes = int(memory_mb * 1e6)
    for kind, most in (
        (resource.RLIMIT_AS, n_bytes),
        (resource.RLIMIT_CPU, int(time_s * (os.cpu_count() or 1)) + 1),
        (resource.RLIMIT_FSIZE, _LARGEST_WRITTEN_BYTES),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(kind)
        value = most if hard == resource.RLIM_INFINITY else min(most, hard)
        try:
            resource.setrlimit(kind, (value, value))
        except (ValueError, OSError):
            continue  # some systems know a limit by name and do not let it be set


def allow_only(folder: Path) -> None:
    """From here on refuse what reading a file in ``folder`` needs not. It cannot be undone."""
    sys.addaudithook(_guard(_readable_places(folder)))


def _readable_places(folder: Path) -> tuple[str, ...]:
    """Return the log's folder, and where Python and its packages are imported from."""
    places = {str(folder.resolve()), sys.prefix, sys.base_prefix, *sysconfig.get_paths().values()}
    places |= {path for path in sys.path if path}
    real = {os.path.realpath(place) for place in places}
    return (*sorted(real), "/proc/self", "/sys/fs/cgroup", "/dev/null")


def _guard(places: tuple[str, ...]) -> Callable[[str, tuple[Any, ...]], None]:
    write = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC

    def guard(event: str, arguments: tuple[Any, ...]) -> None:
        if event in _REFUSED:
            raise NotAllowedError(f"reading a log needs no {event}")
        if event == "open":
            path, _, flags = arguments
            if isinstance(path, int) or path is None:
                return
            if isinstance(flags, int) and flags & write:
                raise NotAllowedError(
                    f"reading a log writes no file, and {os.fsdecode(path)} was to be written"
                )
            real = os.path.realpath(os.fsdecode(path))
            if not any(real == place or real.startswith(place + os.sep) for place in places):
                raise NotAllowedError(f"{real} lies outside of the log's folder")

    return guard
