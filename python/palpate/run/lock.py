"""One runner in a folder: a lock that a dead runner cannot keep and a living one cannot lose.

Two things say that somebody is at work. ``.lock`` is locked by the operating system, which
lets go of it the moment the runner ends, however it ends. ``runner.json`` says who it is and
is rewritten every :data:`BEAT_S`; it serves people, and it serves file systems, such as some
network ones, whose locks do not reach other machines. There a runner of another machine is
taken for dead once its beat has stood still for :data:`LEASE_S` of the observer's own
monotonic clock: no clock is ever compared with that of another machine.
"""

import contextlib
import json
import os
import secrets
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType

from palpate.errors import LedgerError
from palpate.run.result_files import write_whole

try:
    import fcntl as _fcntl

    fcntl: ModuleType | None = _fcntl
except ImportError:  # not a POSIX system: runner.json alone decides
    fcntl = None

BEAT_S = 2.0
"""Seconds between two signs of life."""

LEASE_S = 20.0
"""Seconds without a sign of life after which a runner of another machine is taken for dead."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Runner:
    """Who works in a folder.

    Parameters
    ----------
    since : str
        When it began, in UTC; for people, never compared.
    token : str
        Drawn at random, so that two runs of one process id stay apart.
    beat : int
        Grows for as long as the runner lives.
    """

    host: str
    pid: int
    since: str
    token: str
    beat: int = 0

    @property
    def is_here(self) -> bool:
        """Whether it runs, or ran, on this machine."""
        return self.host == _host()

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host}, since {self.since}"


class RunLock:
    """Lock on a run directory, held between :meth:`acquire` and :meth:`release`.

    Parameters
    ----------
    folder : Path
        Exists.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._record = folder / "runner.json"
        self._descriptor: int | None = None
        self._is_sure = False
        self._me = Runner(
            host=_host(),
            pid=os.getpid(),
            since=datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S UTC"),
            token=secrets.token_hex(8),
        )
        self._ended = threading.Event()
        self._lost: Runner | None = None
        self._beats = threading.Thread(target=self._keep_beating, daemon=True)

    def acquire(self) -> None:
        """Take the lock.

        Raises
        ------
        LedgerError
            Another runner holds it, named by host, process and start.
        """
        self._descriptor = self._os_lock()
        try:
            self._await_lease()
            self._write()
        except BaseException:
            self._close()
            raise
        self._beats.start()

    def release(self) -> None:
        """Let go of the folder."""
        self._ended.set()
        self._beats.join()
        if self._lost is None:
            self._record.unlink(missing_ok=True)
        self._close()

    def check(self) -> None:
        """Refuse to go on where another runner took over while this one stood still.

        Raises
        ------
        LedgerError
        """
        if self._lost is not None:
            raise LedgerError(
                f"{self.folder}: {self._lost} took over while this process stood still; "
                "nothing is lost, let that one finish"
            )

    def _os_lock(self) -> int:
        flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
        descriptor = os.open(self.folder / ".lock", flags, 0o644)
        if fcntl is None:
            return descriptor
        # Whoever looks whether the lock is held holds it for a moment: not a reason to give up.
        for _ in range(10):
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                time.sleep(0.02)
            except OSError:
                return descriptor  # a file system without locks: runner.json decides
            else:
                self._is_sure = True
                return descriptor
        os.close(descriptor)
        raise _refusal(self.folder, runner_of(self.folder))

    def _await_lease(self) -> None:
        """Refuse where the runner on record lives; go on where it is dead."""
        other = runner_of(self.folder)
        if other is None:
            return
        if other.is_here and (self._is_sure or not is_alive(other.pid)):
            return
        deadline = time.monotonic() + LEASE_S
        while time.monotonic() < deadline:
            time.sleep(min(BEAT_S, LEASE_S) / 4.0)
            now = runner_of(self.folder)
            if now is None:
                return
            if now != other:
                raise _refusal(self.folder, now)

    def _write(self, beat: int = 0) -> None:
        content = {**asdict(self._me), "beat": beat}
        write_whole(self._record, json.dumps(content).encode(), durable=False)

    def _keep_beating(self) -> None:
        beat = 0
        while not self._ended.wait(BEAT_S):
            holder = runner_of(self.folder)
            if holder is not None and holder.token != self._me.token:
                self._lost = holder
                return
            beat += 1
            # A full disk stops the run where results are stored, not here.
            with contextlib.suppress(OSError):
                self._write(beat)

    def _close(self) -> None:
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[Callable[[], None]]:
    """Hold the lock on a folder; yields what refuses to go on once the lock is lost.

    Raises
    ------
    LedgerError
        Another runner holds it.
    """
    lock = RunLock(folder)
    lock.acquire()
    try:
        yield lock.check
    finally:
        lock.release()


def runner_of(folder: Path) -> Runner | None:
    """Who says to be working in a folder; None where nobody does."""
    try:
        runner = Runner(**json.loads((folder / "runner.json").read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError, RecursionError):
        return None
    texts, numbers = (runner.host, runner.since, runner.token), (runner.pid, runner.beat)
    is_whole = all(isinstance(text, str) for text in texts) and all(type(n) is int for n in numbers)
    return runner if is_whole and 0 < runner.pid < 2**31 else None


def living_runner_of(folder: Path) -> Runner | None:
    """Who works in a folder, as far as can be seen at once: of another machine only what it says."""
    runner = runner_of(folder)
    if runner is not None and runner.is_here and not (is_alive(runner.pid) and _is_locked(folder)):
        return None
    return runner


def is_alive(pid: int) -> bool:
    """Whether a process of this machine exists."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
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
        f"{folder}: in use by {who}; wait for it, or watch it with `palpate status {folder} --watch`"
    )


def _host() -> str:
    return socket.gethostname()
