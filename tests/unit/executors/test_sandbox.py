"""A program that hangs, floods, crashes or leaves children is ended, and nothing of it stays."""

import importlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from palpate.domain import Curve
from palpate.errors import CurveError, PluginError
from palpate.executors import sandbox
from palpate.executors.sandbox import ProcessLimits, run_function, run_program

LIMITS = ProcessLimits(time_s=300.0, stall_s=300.0, grace_s=0.5)
HANGS = "import os, time\nwith open('pid', 'w') as file: print(os.getpid(), file=file)\ntime.sleep(600)"


def python(tmp_path, code, limits=LIMITS):
    return run_program([sys.executable, "-c", code], tmp_path, limits)


def test_the_end_of_the_output_and_the_code_are_returned(tmp_path):
    ended = python(tmp_path, "import sys; print('a' * 5); print('b', file=sys.stderr); sys.exit(3)")
    assert ended.exit_code == 3
    assert ended.stopped == ""
    assert set(ended.tail.split()) == {"aaaaa", "b"}


def test_there_is_no_input_to_wait_for(tmp_path):
    assert python(tmp_path, "import sys; print(repr(sys.stdin.read()))").tail.strip() == "''"


def test_it_leads_a_process_group_in_the_folder(tmp_path):
    tail = python(tmp_path, "import os; print(os.getpgrp() == os.getpid(), os.getcwd())").tail
    assert tail.strip() == f"True {tmp_path}"


def test_a_flood_is_drained_and_only_its_end_is_kept(tmp_path):
    ended = python(tmp_path, "print('x' * 3_000_000); print('end')")
    assert ended.exit_code == 0
    assert len(ended.tail) <= 32_000
    assert ended.tail.endswith("xend\n") or ended.tail.endswith("x\nend\n")


def test_an_endless_flood_is_stopped(tmp_path):
    limits = ProcessLimits(time_s=300.0, grace_s=0.5, output_bytes=1_000_000)
    ended = python(tmp_path, "while True: print('x' * 10000)", limits)
    assert "bytes written" in ended.stopped


def test_a_time_limit_ends_it(tmp_path):
    limits = ProcessLimits(time_s=0.3, grace_s=600.0)
    ended = run_program([sys.executable, "-S", "-c", "import time; time.sleep(600)"], tmp_path, limits)
    assert "time limit" in ended.stopped
    assert ended.exit_code == -15


def test_a_program_that_ignores_the_request_is_killed(tmp_path):
    code = (
        "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "print('x' * 10_000, flush=True); time.sleep(600)"
    )
    ended = python(tmp_path, code, ProcessLimits(time_s=600.0, grace_s=0.2, output_bytes=1000))
    assert ended.exit_code == -9


class Program:
    """Stands for a program that ends at the 12th look, and for the clock: looks are a second apart."""

    def __init__(self, log, *, grows):
        self.log, self.grows, self.now_s = log, grows, 0.0
        log.touch()

    def monotonic(self):
        return self.now_s

    def wait(self, timeout):
        self.now_s += 1.0
        if self.grows:
            with self.log.open("a") as file:
                file.write("x")
        if self.now_s < 12.0:
            raise subprocess.TimeoutExpired("program", timeout)


@pytest.mark.parametrize(
    ("grows", "limits", "why"),
    [
        (True, ProcessLimits(time_s=60.0, stall_s=3.0), ""),
        (False, ProcessLimits(time_s=60.0, stall_s=3.0), "stopped: nothing written for 3 s"),
        (True, ProcessLimits(time_s=6.0, stall_s=3.0), "stopped after 6 s, its time limit"),
    ],
)
def test_silence_is_no_progress_and_a_growing_file_is(tmp_path, monkeypatch, grows, limits, why):
    program = Program(tmp_path / "log", grows=grows)
    monkeypatch.setattr(sandbox, "time", program)
    with tempfile.TemporaryFile() as printed:
        assert sandbox._watched(program, tmp_path, limits, printed) == why


def test_children_end_with_it(tmp_path, until, has_ended):
    code = "import os, time, sys\npid = os.fork()\nif pid == 0: time.sleep(600)\nprint(pid, flush=True)"
    ended = python(tmp_path, code)
    assert ended.exit_code == 0
    until(lambda: has_ended(int(ended.tail)))


def test_nothing_starts_whose_guard_does_not(tmp_path, monkeypatch):
    def fails(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(sandbox, "guarded", fails)
    with pytest.raises(KeyboardInterrupt):
        python(tmp_path, "open('ran', 'w')")
    assert not (tmp_path / "ran").exists()


def test_a_program_that_is_not_there_is_named(tmp_path):
    for name in ("no-such-program", "./no-such-program"):
        with pytest.raises(PluginError, match=rf"^{name}: cannot be started \(no such program\)"):
            run_program([name], tmp_path, LIMITS)


def written(path):
    """Content of a file of one line, once the line is whole."""
    text = path.read_text() if path.exists() else ""
    return text if text.endswith("\n") else ""


def test_an_exception_here_ends_it_there(tmp_path, monkeypatch, until, has_ended):
    def interrupted(*_):
        until(lambda: written(tmp_path / "pid"))
        raise KeyboardInterrupt

    monkeypatch.setattr(sandbox, "_watched", interrupted)
    with pytest.raises(KeyboardInterrupt):
        python(tmp_path, HANGS)
    assert has_ended(int((tmp_path / "pid").read_text()))


GUARDED = """
import sys
from pathlib import Path
from palpate.executors.sandbox import ProcessLimits, run_program
limits = ProcessLimits(time_s=600.0)
run_program([sys.executable, "-c", sys.argv[2]], Path(sys.argv[1]), limits, is_scratch=True)
"""


def test_a_runner_that_is_killed_leaves_neither_program_nor_folder(tmp_path, until, has_ended):
    folder = tmp_path / "it's scratch"
    folder.mkdir()
    runner = subprocess.Popen(
        [sys.executable, "-c", GUARDED, str(folder), HANGS],
        env={**os.environ, "PYTHONPATH": ":".join(sys.path)},
    )
    pid = int(until(lambda: written(folder / "pid")))
    runner.kill()
    runner.wait()
    until(lambda: has_ended(pid) and not folder.exists())


# ------------------------------------------------------------------- functions


def test_a_function_returns_its_value_and_raises_its_errors():
    assert run_function(LIMITS, divmod, 7, 2) == (3, 1)
    array = run_function(LIMITS, np.arange, 5.0)
    np.testing.assert_array_equal(array, np.arange(5.0))
    with pytest.raises(CurveError, match="abscissa never moves"):
        run_function(LIMITS, Curve, channel="force", abscissa=np.zeros(2), ordinate=np.zeros(2))
    with pytest.raises(ImportError, match="no_such_module"):
        run_function(LIMITS, importlib.import_module, "no_such_module")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("function", "argument", "message"),
    [
        (time.sleep, 600, "stopped after 1.5 s, its time limit"),
        (signal.raise_signal, signal.SIGSEGV, "ended by signal SIGSEGV"),
        (sys.exit, "broken", "exit code 1: broken"),
        (int, "x", "exit code 1: ValueError: invalid literal"),
    ],
)
def test_a_function_that_hangs_or_ends_its_process_is_an_error(function, argument, message):
    limits = ProcessLimits(time_s=1.5 if function is time.sleep else 300.0, grace_s=0.5)
    with pytest.raises(ChildProcessError, match=message):
        run_function(limits, function, argument)


@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are kept on Linux")
def test_a_function_that_needs_more_memory_than_its_limit_is_an_error():
    with pytest.raises(MemoryError):
        run_function(ProcessLimits(time_s=300.0, memory_mb=1000.0), bytearray, 2_000_000_000)


def test_temporary_files_of_a_function_are_removed():
    folder = run_function(LIMITS, tempfile.mkdtemp)
    assert not Path(folder).exists()


def test_a_module_in_the_working_directory_is_not_imported(tmp_path, monkeypatch):
    (tmp_path / "numpy.py").write_text("raise SystemExit('imported')")
    monkeypatch.chdir(tmp_path)
    assert run_function(LIMITS, np.zeros, 3).size == 3
    assert run_function(LIMITS, os.getcwd) == str(tmp_path)
