"""Ctrl-C on a real run with worker processes: once drains, twice stops at once, no process stays."""

import os
import re
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

TOY_PLUGIN = Path(__file__).parents[1] / "data" / "toy" / "toy_plugin.py"
SLOW = """
        Path(f"began-{job.spot}-{job.set_id}").touch()
        while len(list(Path().glob("began-*"))) > int(os.environ["N_FREE"]) and not Path("go").exists():
            time.sleep(0.02)
        assert isinstance(job.protocol"""


@pytest.fixture
def slow_study(study, tmp_path):
    """Toy study on two workers; its solver answers ``N_FREE`` jobs, the others once ``go`` is there."""
    plugin = tmp_path / "slow.py"
    source = TOY_PLUGIN.read_text().replace("        assert isinstance(job.protocol", SLOW)
    plugin.write_text(source.replace("\nfrom pathlib", "\nimport os, time\nfrom pathlib", 1))
    path = study / "study.toml"
    text = path.read_text().replace('[executor]\nname = "in_process"\n', "")
    path.write_text(text.replace("n_workers = 1", "n_workers = 2"))
    return [str(plugin), str(study)]


@pytest.fixture
def start(slow_study, tmp_path):
    """Start a run of the study, in a session of its own."""
    plugin, study = slow_study
    started = []

    def run(n_free):
        command = [sys.executable, "-m", "palpate", "--plugin", plugin, "run", study, "--out", "run"]
        process = subprocess.Popen(
            command,
            cwd=tmp_path,
            env={**os.environ, "N_FREE": str(n_free), "PALPATE_TEST": str(tmp_path)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        started.append(process)
        return process

    yield run
    for process in started:
        process.kill()
        process.communicate()


def n_finished(folder):
    try:
        connection = sqlite3.connect(f"file:{folder / 'ledger.sqlite'}?mode=ro", uri=True)
    except sqlite3.OperationalError:
        return 0
    try:
        return connection.execute("SELECT count(*) FROM simulations").fetchone()[0]
    except sqlite3.OperationalError:
        return 0
    finally:
        connection.close()


def processes_of(folder):
    """Ids of the processes that a run in ``folder`` has started, its own included."""
    mark, found = f"PALPATE_TEST={folder}".encode(), []
    for environ in Path("/proc").glob("[0-9]*/environ"):
        try:
            if mark in environ.read_bytes().split(b"\0"):
                found.append(int(environ.parent.name))
        except OSError:
            continue
    return found


def read_to(process, words):
    """What the process writes to stderr, to the end of the line that has these words."""
    lines = [""]
    while words not in lines[-1]:
        lines.append(process.stderr.readline())
        assert lines[-1], f"ended without: {words}"
    return "".join(lines)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for processes in /proc")
def test_ctrl_c_once_drains_and_leaves_no_process(start, tmp_path, until):
    process = start(n_free=2)
    until(lambda: n_finished(tmp_path / "run") >= 2, still=lambda: process.poll() is None)
    assert len(processes_of(tmp_path)) == 1 + 2 * 2, "a run, two workers, and a guard of each"
    until(lambda: len(list(tmp_path.glob("began-*"))) == 4, still=lambda: process.poll() is None)
    process.send_signal(signal.SIGINT)
    before = read_to(process, "finishing the simulations that are running; once more (Ctrl-C) stops at once")
    (tmp_path / "go").touch()
    out, after = process.communicate()
    err = before + after
    assert process.returncode == 130, err
    kept = int(re.search(r"stopped with (\d+) simulations finished and kept", err)[1])
    assert 4 <= kept == n_finished(tmp_path / "run") < 20
    assert not processes_of(tmp_path)
    assert out == ""
    assert not re.search(r"[\r\x1b]", err), "a pipe gets lines, and nothing that moves a cursor"


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for processes in /proc")
def test_ctrl_c_twice_stops_jobs_that_would_take_forever(start, tmp_path, until):
    process = start(n_free=0)
    until(lambda: len(list(tmp_path.glob("began-*"))) == 2, still=lambda: process.poll() is None)
    process.send_signal(signal.SIGTERM)  # what a batch system sends first
    read_to(process, "finishing the simulations")
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    _, err = process.communicate()
    assert process.returncode == 130, err
    assert "stopped in stage 'simulate'; finished simulations are kept" in err
    assert not processes_of(tmp_path)
