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
from palpate.sandbox import Limits, run_function, run_program

LIMITS = Limits(time_s=30.0, stall_s=30.0, grace_s=0.5)


def alive(pid: int) -> bool:
    """Whether a process runs (a zombie does not)."""
    try:
        os.kill(pid, 0)
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except (ProcessLookupError, FileNotFoundError):
        return False
    return state != "Z"


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
    limits = Limits(time_s=30.0, stall_s=30.0, grace_s=0.5, output_bytes=1_000_000)
    ended = python(tmp_path, "while True: print('x' * 10000)", limits)
    assert "bytes written" in ended.stopped


def test_a_time_limit_ends_it(tmp_path):
    ended = python(tmp_path, "import time; time.sleep(60)", Limits(time_s=0.3, stall_s=9.0, grace_s=0.5))
    assert "time limit" in ended.stopped
    assert ended.exit_code == -15


def test_a_program_that_ignores_the_request_is_killed(tmp_path):
    code = (
        "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "print('x' * 10_000, flush=True); time.sleep(60)"
    )
    ended = python(tmp_path, code, Limits(time_s=60.0, stall_s=60.0, grace_s=0.2, output_bytes=1000))
    assert ended.exit_code == -9


def test_silence_is_no_progress_and_a_growing_file_is(tmp_path):
    quiet = python(tmp_path, "import time; time.sleep(60)", Limits(time_s=30.0, stall_s=0.5, grace_s=0.5))
    assert "nothing written for 0.5 s" in quiet.stopped
    code = (
        "import time\nwith open('log', 'w') as f:\n"
        "    for k in range(12): f.write('x'); f.flush(); time.sleep(0.3)"
    )
    assert python(tmp_path, code, Limits(time_s=60.0, stall_s=3.0)).exit_code == 0


def test_children_end_with_it(tmp_path):
    code = "import os, time, sys\npid = os.fork()\nif pid == 0: time.sleep(600)\nprint(pid, flush=True)"
    began = time.monotonic()
    ended = python(tmp_path, code)
    assert ended.exit_code == 0
    while alive(int(ended.tail)) and time.monotonic() - began < 20.0:
        time.sleep(0.01)
    assert time.monotonic() - began < 20.0


def test_an_exception_here_ends_it_there(tmp_path, monkeypatch):
    from palpate import sandbox

    def interrupted(*_):
        while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
            time.sleep(0.01)
        raise KeyboardInterrupt

    monkeypatch.setattr(sandbox, "_watched", interrupted)
    code = "import os, time; open('pid', 'w').write(str(os.getpid())); time.sleep(600)"
    with pytest.raises(KeyboardInterrupt):
        python(tmp_path, code)
    assert not alive(int((tmp_path / "pid").read_text()))


GUARDED = """
import sys, time
from pathlib import Path
from palpate.sandbox import Limits, run_program
code = "import os, time; open('pid', 'w').write(str(os.getpid())); time.sleep(600)"
run_program(
    [sys.executable, "-c", code], Path(sys.argv[1]), Limits(time_s=600.0, stall_s=600.0), is_scratch=True
)
"""


def test_a_runner_that_is_killed_leaves_neither_program_nor_folder(tmp_path):
    folder = tmp_path / "it's scratch"
    folder.mkdir()
    runner = subprocess.Popen(
        [sys.executable, "-c", GUARDED, str(folder)], env={**os.environ, "PYTHONPATH": ":".join(sys.path)}
    )
    while not (folder / "pid").exists() or not (pid := (folder / "pid").read_text()):
        time.sleep(0.02)
    runner.kill()
    runner.wait()
    until = time.monotonic() + 120.0
    while (alive(int(pid)) or folder.exists()) and time.monotonic() < until:
        time.sleep(0.02)
    assert not alive(int(pid))
    assert not folder.exists()


# ------------------------------------------------------------------- functions


def test_a_function_returns_its_value_and_raises_its_errors():
    assert run_function(LIMITS, divmod, 7, 2) == (3, 1)
    array = run_function(LIMITS, np.arange, 5.0)
    np.testing.assert_array_equal(array, np.arange(5.0))
    with pytest.raises(CurveError, match="abscissa never moves"):
        run_function(LIMITS, Curve, channel="force", abscissa=np.zeros(2), ordinate=np.zeros(2))
    with pytest.raises(ImportError, match="no_such_module"):
        run_function(LIMITS, importlib.import_module, "no_such_module")


@pytest.mark.parametrize(
    ("function", "argument", "message"),
    [
        (time.sleep, 60, "stopped after 1.5 s, its time limit"),
        (signal.raise_signal, signal.SIGSEGV, "ended by signal 11"),
        (sys.exit, "broken", "exit code 1: broken"),
        (int, "x", "exit code 1: ValueError: invalid literal"),
    ],
)
def test_a_function_that_hangs_or_ends_its_process_is_an_error(function, argument, message):
    limits = Limits(time_s=1.5 if function is time.sleep else 60.0, grace_s=0.5)
    with pytest.raises(ChildProcessError, match=message):
        run_function(limits, function, argument)


@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are kept on Linux")
def test_a_function_that_needs_more_memory_than_its_limit_is_an_error():
    with pytest.raises(MemoryError):
        run_function(Limits(time_s=60.0, memory_mb=1000.0), bytearray, 2_000_000_000)


def test_temporary_files_of_a_function_are_removed():
    folder = run_function(LIMITS, tempfile.mkdtemp)
    assert not Path(folder).exists()


def test_a_module_in_the_working_directory_is_not_imported(tmp_path, monkeypatch):
    (tmp_path / "numpy.py").write_text("raise SystemExit('imported')")
    monkeypatch.chdir(tmp_path)
    assert run_function(LIMITS, np.zeros, 3).size == 3
    assert run_function(LIMITS, os.getcwd) == str(tmp_path)


def test_a_program_that_cannot_start_is_named(tmp_path):
    with pytest.raises(PluginError, match="no_such_program"):
        run_program(["no_such_program"], tmp_path, LIMITS)
