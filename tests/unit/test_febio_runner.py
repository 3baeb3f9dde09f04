"""A program that hangs, floods, crashes or leaves children is ended, and nothing of it stays."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from palpate.errors import PluginError
from palpate_febio.binary import examine, find_binary
from palpate_febio.runner import Limits, run_program

from . import febio_fake

LIMITS = Limits(time_s=30.0, stall_s=30.0, grace_s=0.5)


def python(tmp_path, code, limits=LIMITS):
    return run_program([sys.executable, "-c", code], tmp_path, limits)


def test_the_end_of_what_was_printed_and_the_code_come_back(tmp_path):
    ended = python(tmp_path, "import sys; print('a' * 5); print('b', file=sys.stderr); sys.exit(3)")
    assert ended.exit_code == 3
    assert ended.stopped == ""
    assert set(ended.tail.split()) == {"aaaaa", "b"}


def test_there_is_no_input_to_wait_for(tmp_path):
    assert python(tmp_path, "import sys; print(repr(sys.stdin.read()))").tail.strip() == "''"


def test_it_leads_a_group_of_its_own_in_the_folder(tmp_path):
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
        "print(1, flush=True); time.sleep(60)"
    )
    ended = python(tmp_path, code, Limits(time_s=1.5, stall_s=9.0, grace_s=0.2))
    assert ended.exit_code == -9


def test_silence_is_no_progress_and_a_growing_file_is(tmp_path):
    quiet = python(tmp_path, "import time; time.sleep(60)", Limits(time_s=30.0, stall_s=0.5, grace_s=0.5))
    assert "nothing written for 0.5 s" in quiet.stopped
    code = (
        "import time\nwith open('log', 'w') as f:\n"
        "    for k in range(12): f.write('x'); f.flush(); time.sleep(0.1)"
    )
    assert python(tmp_path, code, Limits(time_s=30.0, stall_s=0.9)).exit_code == 0


def test_children_end_with_it(tmp_path):
    code = "import os, time, sys\npid = os.fork()\nif pid == 0: time.sleep(600)\nprint(pid, flush=True)"
    began = time.monotonic()
    ended = python(tmp_path, code)
    assert ended.exit_code == 0
    while febio_fake.alive(int(ended.tail)) and time.monotonic() - began < 20.0:
        time.sleep(0.01)
    assert time.monotonic() - began < 20.0


def test_an_exception_here_ends_it_there(tmp_path, monkeypatch):
    from palpate_febio import runner

    def interrupted(*_):
        while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
            time.sleep(0.01)
        raise KeyboardInterrupt

    monkeypatch.setattr(runner, "_watched", interrupted)
    code = "import os, time; open('pid', 'w').write(str(os.getpid())); time.sleep(600)"
    with pytest.raises(KeyboardInterrupt):
        python(tmp_path, code)
    assert not febio_fake.alive(int((tmp_path / "pid").read_text()))


GUARDED = """
import sys, time
from pathlib import Path
from palpate_febio.runner import Limits, run_program
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
    until = time.monotonic() + 20.0
    while (febio_fake.alive(int(pid)) or folder.exists()) and time.monotonic() < until:
        time.sleep(0.02)
    assert not febio_fake.alive(int(pid))
    assert not folder.exists()


def test_a_program_that_cannot_start_is_named(tmp_path):
    with pytest.raises(PluginError, match="no_such_program"):
        run_program(["no_such_program"], tmp_path, LIMITS)


# --------------------------------------------------------------------- binary


def test_found_by_setting_then_on_the_path(tmp_path, monkeypatch):
    on_path, named = febio_fake.install(tmp_path / "bin"), febio_fake.install(tmp_path / "other", "mine")
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    assert find_binary() == on_path
    assert find_binary(str(named)) == named


def test_found_in_the_usual_places(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setenv("HOME", str(tmp_path))
    there = febio_fake.install(tmp_path / "FEBioStudio2" / "bin")
    assert find_binary() == there


def test_missing_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setenv("HOME", str(tmp_path))
    with pytest.raises(PluginError, match=r"febio\.org"):
        find_binary()
    with pytest.raises(PluginError, match="setting executable"):
        find_binary("no_such_febio")


def test_version_and_remark(tmp_path, monkeypatch):
    program = febio_fake.install(tmp_path)
    monkeypatch.setenv("FAKE_FEBIO", "")
    binary = examine(program)
    assert binary.version == "4.11.0.65622b536"
    assert binary.remark == ""
    monkeypatch.setenv("FAKE_FEBIO", "version=4.20.1")
    assert "was not measured" in examine(program).remark


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("version=3.9.0", "FEBio 3.9.0.*4.0 deck"),
        ("version=5.0", "FEBio 5.0"),
        ("say_nothing", "does not say"),
    ],
)
def test_other_programs_are_refused(tmp_path, monkeypatch, words, message):
    monkeypatch.setenv("FAKE_FEBIO", words)
    program = Path("/bin/true") if words == "say_nothing" else febio_fake.install(tmp_path)
    with pytest.raises(PluginError, match=message):
        examine(program)


def test_the_digest_covers_the_libraries(tmp_path, monkeypatch):
    monkeypatch.setenv("FAKE_FEBIO", "")
    program = febio_fake.install(tmp_path / "bin")
    before = examine(program).digest
    assert examine(program).digest == before
    (tmp_path / "lib").mkdir()
    library = tmp_path / "lib" / "libfebiomech.so"
    library.write_bytes(b"one")
    with_library = examine(program).digest
    library.write_bytes(b"two")
    assert len({before, with_library, examine(program).digest}) == 3
    assert os.access(program, os.X_OK)
