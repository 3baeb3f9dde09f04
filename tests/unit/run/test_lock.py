"""One runner in a folder, on any file system."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from palpate.errors import LedgerError
from palpate.run import lock as locking
from palpate.run.lock import living_runner_of, locked, runner_of

HOLD = (
    "import sys, pathlib\n"
    "from palpate.run.lock import locked\n"
    "with locked(pathlib.Path(sys.argv[1])):\n"
    "    print('held', flush=True)\n"
    "    sys.stdin.read()\n"
)


@pytest.fixture
def other_process(tmp_path):
    """Another process that holds the lock on tmp_path."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    assert process.stdout.readline() == b"held\n"
    yield process
    process.kill()
    process.communicate()


@pytest.fixture
def clock(monkeypatch):
    """Time that passes by sleeping alone; the times slept [s]."""
    slept = []
    time = SimpleNamespace(monotonic=lambda: sum(slept), sleep=slept.append)
    monkeypatch.setattr(locking, "time", time)
    return slept


def test_a_second_runner_is_refused_by_host_pid_and_start(tmp_path, other_process):
    reason = (
        rf"in use by process {other_process.pid} on \S+, since \d{{4}}-.* UTC; .*palpate status .*--watch"
    )
    with pytest.raises(LedgerError, match=reason), locked(tmp_path):
        pass
    assert living_runner_of(tmp_path).pid == other_process.pid


def test_a_killed_runner_holds_nothing(tmp_path, other_process, clock):
    os.kill(other_process.pid, signal.SIGKILL)
    other_process.wait()
    assert runner_of(tmp_path).pid == other_process.pid
    assert living_runner_of(tmp_path) is None
    with locked(tmp_path) as check:
        check()
        assert runner_of(tmp_path).pid == os.getpid()
    assert not clock, "waited for a runner that had ended"
    assert runner_of(tmp_path) is None


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the state of a process is read there")
def test_a_killed_runner_holds_nothing_before_its_parent_asks_for_it(
    tmp_path, other_process, until, has_ended, clock, monkeypatch
):
    """Its process id still exists: without locks of the operating system its state alone decides."""
    os.kill(other_process.pid, signal.SIGKILL)
    until(lambda: has_ended(other_process.pid))
    os.kill(other_process.pid, 0)
    monkeypatch.setattr(locking, "fcntl", None)
    assert living_runner_of(tmp_path) is None
    with locked(tmp_path):
        assert runner_of(tmp_path).pid == os.getpid()
    assert not clock, "waited for a runner that had ended"


def test_a_lock_is_taken_and_let_go_again_and_again(tmp_path):
    for _ in range(3):
        with locked(tmp_path):
            with pytest.raises(LedgerError, match="in use by"), locked(tmp_path):
                pass
            assert living_runner_of(tmp_path) is not None
        assert living_runner_of(tmp_path) is None


# ------------------------------------- a file system whose locks reach no other machine


@pytest.fixture
def network(monkeypatch):
    """Locks of the operating system that are granted to everyone, and frequent beats."""
    monkeypatch.setattr(locking, "BEAT_S", 0.05)
    monkeypatch.setattr(locking.fcntl, "flock", lambda *_: None)


def elsewhere(folder, beat=0, pid=1):
    """Leave the record of a runner of another machine."""
    record = {"host": "node7", "pid": pid, "since": "2026-01-01 00:00:00 UTC", "token": "t", "beat": beat}
    (folder / "runner.json").write_text(json.dumps(record))


@pytest.mark.usefixtures("network")
def test_a_runner_of_another_machine_that_beats_is_refused(tmp_path, monkeypatch):
    elsewhere(tmp_path)
    slept = iter(range(1, 1000))
    monkeypatch.setattr(locking.time, "sleep", lambda _: elsewhere(tmp_path, beat=next(slept)))
    who = re.escape("process 1 on node7, since 2026-01-01 00:00:00 UTC")
    with pytest.raises(LedgerError, match=who), locked(tmp_path):
        pass


@pytest.mark.usefixtures("network")
def test_a_silent_runner_of_another_machine_is_dead_for_any_clock(tmp_path, clock):
    elsewhere(tmp_path)
    os.utime(tmp_path / "runner.json", (4e9, 4e9))  # a clock far ahead
    with locked(tmp_path):
        assert locking.LEASE_S <= sum(clock) < locking.LEASE_S + locking.BEAT_S
        assert runner_of(tmp_path).pid == os.getpid()


@pytest.mark.usefixtures("network")
def test_who_was_taken_for_dead_stops_when_it_wakes(tmp_path, until):
    """Also where the other one has the same process id, as in containers."""
    with locked(tmp_path) as check:
        elsewhere(tmp_path, beat=3, pid=os.getpid())
        with pytest.raises(LedgerError, match=rf"process {os.getpid()} on node7.* took over while this"):
            until(check)  # which returns None until it raises
    assert runner_of(tmp_path).host == "node7"
