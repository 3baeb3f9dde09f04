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
from palpate.progress import RunningJob
from palpate.run.lock import locked

pytestmark = pytest.mark.usefixtures("one_figure")


def jobs(n, since_s=0.0, usual_s=None):
    """Running simulations, the first on a finer mesh."""
    return [RunningJob(f"fine mesh p{i}" if i == 1 else f"p{i}", since_s, usual_s) for i in range(1, n + 1)]


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
            following.running(jobs(2))
            following.step("crashed" if i % 10 == 9 else "ok")
    lines = text.getvalue().splitlines()
    assert lines[0] == "simulate: 40 steps"
    assert len(lines) == 11
    assert re.fullmatch(
        r"simulate: 20 of 40: 2 crashed, 18 ok, 2 running \(fine mesh p1, \d+ \w+\); about \d+ \w+ left",
        lines[5],
    ), lines
    assert lines[-1].startswith("simulate: 40 of 40: 4 crashed, 36 ok, 2 running (")
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
        following.at("all spots, scenario I: step 4, Fopt 0.002")
        until(lambda: text.getvalue().count("\n") >= 3)
    lines = text.getvalue().splitlines()
    assert lines[0] == "fit …"
    assert lines[1].startswith("fit; all spots, scenario I: step 4, Fopt 0.002")


def test_a_log_names_a_stage_of_one_step_once(follow, monkeypatch):
    session, text = follow(is_terminal=False)
    clock = iter(range(0, 10**7, 90))
    monkeypatch.setattr(shown.time, "monotonic", lambda: next(clock))
    with StageProgress(session) as following:
        following.begin("report", 1)
        following.step()
    assert text.getvalue().splitlines() == ["report …"]


def test_a_terminal_counts_no_single_step(follow):
    session, text = follow(is_terminal=True)
    with StageProgress(session) as following:
        following.begin("report", 1)
        following.step()
    assert "report" in text.getvalue()
    assert not re.search("[01]/1", text.getvalue())


def test_a_terminal_shows_where_a_fit_is(follow):
    session, text = follow(is_terminal=True)
    with StageProgress(session) as following:
        following.begin("fit", 0)
        following.at("p1, scenario II: step 2, Fopt 0.01")
        following.step("ok")
    assert "1/?" in text.getvalue()
    assert "p1, scenario II: step 2, Fopt 0.01" in text.getvalue()


def test_a_terminal_gets_a_bar_and_respects_no_color(follow):
    session, text = follow(is_terminal=True)
    with StageProgress(session) as following:
        following.begin("simulate", 3)
        following.running(jobs(2))
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
        following.running(jobs(2))
        for i in range(200):
            following.step(("ok", "timed_out", "diverged")[i % 3])
            following.running(jobs(2))
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text.getvalue())
    first, second = plain.splitlines()[-2:]
    assert re.match(r"simulate +9200/10000 about \d+ h \d+ min left +133 failed ", first), first
    assert second.startswith("  67 timed_out, 66 diverged, 9067 ok, 2 running"), second
    assert max(len(first.rstrip()), len(second.rstrip())) <= width


def test_a_run_has_one_bar_with_what_is_left_of_all_its_stages(follow, monkeypatch):
    session, text = follow(is_terminal=True)
    now = [100.0]
    monkeypatch.setattr(shown.time, "monotonic", lambda: now[0])
    with StageProgress(session) as following:
        following.expect(58, None)
        following.begin("fit", 0)
        for i in range(14):
            following.step("ok")
            following.expect(57 - i, 120.0)
        following.running(jobs(2, since_s=100.0))
        now[0] += 41.0
        assert following._second_line() == "14 ok, 2 running (fine mesh p1, 41 s)"
        assert following._shown.time_left() == "about 79 s left"
        now[0] += 80.0
        assert following._shown.time_left() == ""
        following.begin("report", 1)
        following.step()
        following.begin("surface", 4)
        following.expect(2, 5.0)
        following.step("ok")
        assert (following._shown.done, following._shown.total) == (15, 16)
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text.getvalue())
    bars = [line.split()[:2] for line in plain.splitlines()[-3:]]
    assert ["surface", "15/16"] in bars
    assert "report" in [stage for stage, _ in bars]
    assert "fit" not in [name for name, *_ in bars]


def test_a_log_says_what_is_left_of_a_whole_run(follow, monkeypatch):
    session, text = follow(is_terminal=False)
    monkeypatch.setattr(shown.time, "monotonic", lambda: 0.0)
    with StageProgress(session) as following:
        following.expect(20, None)
        following.begin("fit", 0)
        for i in range(21):
            following.step("ok")
            following.expect(max(0, 19 - i), 10.0)
        following.expect(4, 10.0)
        following.begin("surface", 4)
    lines = text.getvalue().splitlines()
    assert lines[0] == "fit: about 20 simulations"
    assert lines.pop() == "surface: about 4 more simulations"
    assert "fit: 10 of 20: 10 ok; about 10 s left" in lines
    assert lines[-1].startswith("fit: 20 of 20: ")
    assert len(lines) == 1 + 10  # the forecast was one too few


def test_a_simulation_that_takes_many_times_as_long_as_usual_is_reported_once(follow, monkeypatch):
    session, text = follow(is_terminal=False)
    now = [0.0]
    monkeypatch.setattr(shown.time, "monotonic", lambda: now[0])
    with StageProgress(session) as following:
        following.begin("fit", 0)
        following.running([*jobs(2, usual_s=6.0), RunningJob("p7", 0.0, None)])
        for now[0] in (30.0, 47.0, 49.0, 60.0):
            following._note_slow()
    slow = [line for line in text.getvalue().splitlines() if line.startswith("slow:")]
    assert slow[0].startswith("slow: fine mesh p1 has taken 49 s, where about 6 s is usual. ")
    assert "time_limit" in slow[0]
    assert [line.split(" has")[0] for line in slow] == ["slow: fine mesh p1", "slow: p2"]


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
        assert following._shown.time_left() == ""
        following.running(jobs(1))
        for _ in range(5):
            now[0] += 10.0
            following.step("ok")
        assert following._shown.time_left() == f"{status_command.about(10.0 * (95 - n_reused))} left"


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
    assert ran.err.index("free disk space") < ran.err.index(" of 6")
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
    assert len(re.findall(r"\d+ simulations \(\d+ ok\)", seen.err)) == 1
    assert "running: process" in seen.err
    assert "Conclusion" in seen.out
