"""One runner in a folder: a lock that ends with its process, and a record of who holds it.

``.lock`` is locked by the operating system, which releases it when the runner ends, however it
ends. ``runner.json`` names the runner for messages and `palpate status`. It is rewritten every
:data:`BEAT_S`, for file systems whose locks do not reach other machines (some NFS and Lustre
mounts): there a runner of another machine is taken for dead once its record has not changed for
:data:`LEASE_S` of the observer's own clock. No clock is compared with the clock of another machine.
"""

import contextlib
import json
import os
import secrets
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType
from typing import Annotated

from pydantic import Field, TypeAdapter

from palpate.errors import LedgerError, typed
from palpate.run.atomic_files import write_whole

try:
    import fcntl as _fcntl

    fcntl: ModuleType | None = _fcntl
except ImportError:  # not a POSIX system: runner.json alone decides
    fcntl = None

BEAT_S = 2.0
"""Seconds between two changes of the record."""

LEASE_S = 20.0
"""Seconds without a change after which a runner of another machine is taken for dead."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Runner:
    """Process that works in a folder."""

    host: str
    pid: Annotated[int, Field(gt=0, lt=2**31)]
    since: str
    """Start in UTC; for people, never compared."""
    token: str
    """Random, so that two runs of one process id are distinct."""
    beat: int = 0
    """Grows for as long as the runner lives."""

    @property
    def is_here(self) -> bool:
        """Whether it runs, or ran, on this machine."""
        return self.host == socket.gethostname()

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host}, since {self.since}"


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[Callable[[], None]]:
    """Hold the lock on a folder that exists; yields a check that raises once the lock is lost.

    A LedgerError where another runner holds it, named by host, process and start.
    """
    descriptor, has_os_lock = _os_lock(folder)
    try:
        _wait_for_lease(folder, has_os_lock=has_os_lock)
        since = datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
        me = Runner(host=socket.gethostname(), pid=os.getpid(), since=since, token=secrets.token_hex(8))
        lost, ended = list[Runner](), threading.Event()
        _write(folder, me)
        beats = threading.Thread(target=_keep_beating, args=(folder, me, lost, ended), daemon=True)
        beats.start()

        def check() -> None:
            if lost:
                raise LedgerError(
                    f"{folder}: {lost[0]} took over while this process was suspended; "
                    "nothing is lost, let that one finish"
                )

        try:
            yield check
        finally:
            ended.set()
            beats.join()
            if not lost:
                _record(folder).unlink(missing_ok=True)
    finally:
        os.close(descriptor)


def _os_lock(folder: Path) -> tuple[int, bool]:
    """Open and lock ``.lock``; also whether the file system has locks."""
    flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
    descriptor = os.open(folder / ".lock", flags, 0o644)
    if fcntl is None:
        return descriptor, False
    # Whoever looks whether the lock is held holds it for a moment: not a reason to give up.
    for _ in range(10):
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(0.02)
        except OSError:
            return descriptor, False
        else:
            return descriptor, True
    os.close(descriptor)
    raise _refusal(folder, runner_of(folder))


def _wait_for_lease(folder: Path, *, has_os_lock: bool) -> None:
    """Refuse where the runner on record lives; return where it is dead."""
    other = runner_of(folder)
    if other is None or (other.is_here and (has_os_lock or not _is_alive(other.pid))):
        return
    deadline = time.monotonic() + LEASE_S
    while time.monotonic() < deadline:
        time.sleep(min(BEAT_S, LEASE_S) / 4.0)
        now = runner_of(folder)
        if now is None:
            return
        if now != other:
            raise _refusal(folder, now)


def _keep_beating(folder: Path, me: Runner, lost: list[Runner], ended: threading.Event) -> None:
    beat = 0
    while not ended.wait(BEAT_S):
        holder = runner_of(folder)
        if holder is not None and holder.token != me.token:
            lost.append(holder)
            return
        beat += 1
        # A full disk stops the run where results are stored, not here.
        with contextlib.suppress(OSError):
            _write(folder, replace(me, beat=beat))


def _record(folder: Path) -> Path:
    return folder / "runner.json"


def _write(folder: Path, runner: Runner) -> None:
    write_whole(_record(folder), json.dumps(asdict(runner)).encode(), durable=False)


def runner_of(folder: Path) -> Runner | None:
    """Runner on record in a folder; None where there is none."""
    try:
        return TypeAdapter(Runner).validate_json(_record(folder).read_bytes(), strict=True)
    except (OSError, ValueError):
        return None


def living_runner_of(folder: Path) -> Runner | None:
    """Process that works in a folder, without waiting: one of another machine as it is on record."""
    runner = runner_of(folder)
    if runner is not None and runner.is_here and not (_is_alive(runner.pid) and _is_locked(folder)):
        return None
    return runner


def _is_alive(pid: int) -> bool:
    """True if a process of this machine runs: a zombie does not."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    with contextlib.suppress(OSError):  # only Linux has it
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return True


def _is_locked(folder: Path) -> bool:
    if fcntl is None:
        return True
    try:
        descriptor = os.open(folder / ".lock", os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    else:
        return False
    finally:
        os.close(descriptor)


def _refusal(folder: Path, other: Runner | None) -> LedgerError:
    who = str(other) if other else "another process"
    return LedgerError(
        f"{folder}: in use by {who}; wait for it, or watch it with `palpate status {typed(folder)} --watch`"
    )
