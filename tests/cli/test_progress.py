"""Progress of a run: bars on a terminal, lines in logs, and what is next to the counts."""

import io
import itertools
import re
import threading
from types import SimpleNamespace

import pytest
from rich.console import Console

from palpate.cli import progress as shown, status as status_command
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session
from palpate.run.lock import locked

pytestmark = pytest.mark.usefixtures("one_figure")


@pytest.fixture
def follow(monkeypatch):
    """A session whose stderr is kept, as a terminal's or as a log."""

    def make(*, is_terminal, colour=False, width=200):
        session, text = Session(), io.StringIO()
        console = Console(
            file=text, force_terminal=is_terminal, width=width, soft_wrap=True, no_color=not colour
        )
        monkeypatch.setattr(Session, "stderr", console)
        return session, text

    return make


def test_a_log_gets_lines_with_counts_and_the_time_left(follow, monkeypatch):
    session, text = follow(is_terminal=False)
    clock = iter(range(0, 10_000, 2))
    monkeypatch.setattr(shown.time, "monotonic", lambda: next(clock))
    with StageProgress(session) as following:
        following.begin("simulate", 40)
        for i in range(40):
            following.running(2)
            following.step("crashed" if i % 10 == 9 else "ok")
    lines = text.getvalue().splitlines()
    assert lines[0] == "simulate: 40 steps"
    assert len(lines) == 11
    assert re.fullmatch(r"simulate: 20 of 40 2 crashed, 18 ok, 1 running; about \d+ s left", lines[5]), lines
    assert lines[-1] == "simulate: 40 of 40 4 crashed, 36 ok, 1 running"
    assert not re.search(r"[\r\x1b]", text.getvalue())


def test_a_log_hears_of_a_slow_sweep_every_minute(follow, monkeypatch):
    session, text = follow(is_terminal=False)
    clock = iter(range(0, 10**7, 45))
    monkeypatch.setattr(shown.time, "monotonic", lambda: next(clock))
    with StageProgress(session) as following:
        following.begin("measure", 1000)
        for _ in range(9):
            following.step("ok")
    assert len(text.getvalue().splitlines()) > 3


def test_a_log_hears_of_a_fit_whose_simulations_take_long(follow, monkeypatch, until):
    session, text = follow(is_terminal=False)
    monkeypatch.setattr(shown, "LINE_S", 0.0)
    monkeypatch.setattr(shown, "LOOK_S", 0.02)
    with StageProgress(session) as following:
        following.begin("fit", 0)
        following.at("all spots, scenario I: step 4, Fopt 0.002; 0 of 9 fits ended, 12 simulations")
        until(lambda: text.getvalue().count("\n") >= 3)
    lines = text.getvalue().splitlines()
    assert lines[0] == "fit …"
    assert lines[1].startswith("fit; all spots, scenario I: step 4, Fopt 0.002; 0 of 9 fits ended")


def test_a_terminal_shows_where_a_fit_is(follow):
    session, text = follow(is_terminal=True)
    with StageProgress(session) as following:
        following.begin("fit", 0)
        following.at("p1, scenario II: step 2, Fopt 0.01; 3 of 9 fits ended, 20 simulations")
        following.step("ok")
    assert "1/?" in text.getvalue()
    assert "p1, scenario II: step 2, Fopt 0.01; 3 of 9 fits ended" in text.getvalue()


def test_a_terminal_gets_a_bar_and_respects_no_color(follow):
    session, text = follow(is_terminal=True)
    with StageProgress(session) as following:
        following.begin("simulate", 3)
        following.running(2)
        following.step("ok")
        following.step("timed_out")
    assert "2/3" in text.getvalue()
    assert "1 failed" in text.getvalue()
    assert "1 timed_out, 1 ok" in text.getvalue()
    assert not re.search(r"\x1b\[[0-9;]*3[0-9]m", text.getvalue())


@pytest.mark.parametrize("width", [60, 80, 120])
def test_a_narrow_terminal_keeps_count_time_left_and_failures(follow, monkeypatch, width):
    session, text = follow(is_terminal=True, width=width)
    clock = itertools.count()
    monkeypatch.setattr(shown.time, "monotonic", lambda: next(clock) * 600.0)
    with StageProgress(session) as following:
        following.begin("simulate", 10_000)
        for _ in range(9000):
            following.step("ok")
        following.running(2)
        for i in range(200):
            following.step(("ok", "timed_out", "diverged")[i % 3])
            following.running(2)
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text.getvalue())
    first, second = plain.splitlines()[-2:]
    assert re.match(r"simulate +9200/10000 about \d+ h \d+ min left +133 failed ", first), first
    assert second.startswith("  67 timed_out, 66 diverged, 9067 ok, 2 running"), second
    assert max(len(first.rstrip()), len(second.rstrip())) <= width


@pytest.mark.parametrize("n_reused", [0, 20, 90])
def test_the_time_left_counts_nothing_that_was_reused(follow, monkeypatch, n_reused):
    """Ten seconds each, whatever was there before the first simulation began."""
    session, _ = follow(is_terminal=False)
    now = [0.0]
    monkeypatch.setattr(shown.time, "monotonic", lambda: now[0])
    with StageProgress(session) as following:
        following.begin("simulate", 100)
        for _ in range(n_reused):
            following.step("ok")
        now[0] += 7.0  # spent on reading what was there
        assert following._left() == ""
        following.running(1)
        for _ in range(5):
            now[0] += 10.0
            following.step("ok")
        assert following._left() == f"{status_command.about(10.0 * (95 - n_reused))} left"


@pytest.mark.slow
def test_a_disk_that_is_too_small_is_reported_before_the_first_simulation(call, study, monkeypatch):
    import shutil

    usual = shutil.disk_usage
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usual(path)._replace(free=100_000))
    ran = call("run", study)
    assert ran.code == 0
    reason = (
        r"runs/toy: 0\.1 MB are free, but the 20 remaining simulations need about 0\.3 MB; free disk space"
    )
    assert re.search(reason, ran.err), ran.err
    assert ran.err.index("free disk space") < ran.err.index("4 of 40")
    monkeypatch.undo()


def test_watching_ends_with_the_run_and_a_log_hears_of_changes_only(call, ran, monkeypatch):
    held, ended, pauses = threading.Event(), threading.Event(), iter(range(1, 100))

    def hold():
        with locked(ran):
            held.set()
            ended.wait(60.0)

    def pause(_):
        if next(pauses) == 3:  # the run ends after three looks
            ended.set()
            runner.join()

    monkeypatch.setattr(status_command, "time", SimpleNamespace(sleep=pause))
    runner = threading.Thread(target=hold)
    runner.start()
    held.wait()
    seen = call("status", "runs/toy", "--watch")
    runner.join()
    assert seen.code == 0
    assert seen.err.count("20 of 20 simulations (20 ok)") == 1
    assert "running: process" in seen.err
    assert "Conclusion" in seen.out
