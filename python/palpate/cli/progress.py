"""Progress on stderr: a bar for people, lines for the log of a batch system."""

import signal
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Any

from palpate.cli.session import Session
from palpate.errors import StoppedError
from palpate.progress import Progress, RunningJob, about, duration

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress, TaskID

SIMULATING = ("simulate", "fit", "surface", "fit again", "candidates", "rank")
"""Stages of simulations: asked to stop, they finish those that are running."""

LINE_S = 50.0
"""Time after which a log gets a line at the next look, so that it gets one every minute."""

WARNING = "warning: "
"""How a note begins that also goes to ``--json``."""

LOOK_S = 5.0
"""Time between two looks at the clock."""

SLOW, SLOW_S = 8.0, 20.0
"""Time of a simulation over the usual one, and in any case, from which it is reported as slow."""


class StageProgress(Progress):
    """A :class:`palpate.progress.Progress` that shows one stage after the other.

    Parameters
    ----------
    keeps : bool
        Whether the simulations of a sweep are kept when it is stopped.
    """

    def __init__(self, session: Session, *, keeps: bool = True) -> None:
        self._keeps = keeps
        self._console = session.stderr
        self.began_processor_s = session.began_processor_s
        self._bars: RichProgress | None = None
        self._stage = ""
        self._shown = self._run = _Steps()
        self._tasks: dict[_Steps, TaskID] = {}
        self._running: Sequence[RunningJob] = ()
        self._slow: set[tuple[str, float]] = set()
        self._last_line = time.monotonic()
        self.warnings: list[str] = []
        """Every note so far that begins with ``warning:``, without that."""
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self._begun = time.monotonic()
        self._place = ""
        self._stopping = self._is_interrupted = False
        self._handlers: dict[signal.Signals, Any] = {}
        self._ended = threading.Event()
        self._clock = threading.Thread(target=self._look_at_clock, daemon=True)

    def __enter__(self) -> "StageProgress":
        if self._console.is_terminal:
            self._bars = _bars(self._console, self._second_line)
            self._bars.start()
        self._clock.start()
        if threading.current_thread() is threading.main_thread():
            self._handlers = {
                each: signal.signal(each, self._stop) for each in (signal.SIGINT, signal.SIGTERM)
            }
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._ended.set()
        if self._clock.is_alive():
            self._clock.join()
        self._note_time()
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        if self._bars is not None:
            self._bars.stop()
        if kind is not None and issubclass(kind, KeyboardInterrupt):
            kept = "; finished simulations are kept, and the same command continues from there"
            raise StoppedError(f"stopped in stage '{self._stage}'{kept if self._keeps else ''}")

    def begin(self, stage: str, total: int) -> None:
        """Show a new stage of ``total`` steps; stages whose simulations are forecast share one bar."""
        if self._is_interrupted:  # a library may have swallowed the exception in a callback of its own
            raise KeyboardInterrupt
        self._note_time()
        self._stage, self._running, self._place = stage, (), ""
        self._last_line = time.monotonic()
        is_of_run = self._run.is_forecast and stage in SIMULATING
        # Of a sweep the pace counts from its first simulation: what is done before was done by another run.
        first = None if stage == "simulate" else (self._last_line, 0)
        self._shown = self._run if is_of_run else _Steps(total=total, first=first)
        steps = self._shown
        if self._bars is None:
            count = f": {total} steps" if total > 1 else ""
            if is_of_run:
                left, more = steps.total - steps.done, "more " if steps.done else ""
                count = f": about {left} {more}simulation{'s' * (left > 1)}" if left > 0 else ""
            self._console.print(f"{stage}{count or ' …'}", markup=False)
        elif steps not in self._tasks:
            self._tasks[steps] = self._bars.add_task(stage, total=steps.total or None, steps=steps)
        else:
            self._bars.update(self._tasks[steps], description=stage, total=steps.total)

    def step(self, note: str = "") -> None:
        """Count one step, and how it ended."""
        steps = self._shown
        steps.done += 1
        steps.total = max(steps.total, steps.done) if steps.is_forecast else steps.total
        if note:
            steps.notes[note] += 1
        if self._bars is not None and steps in self._tasks:
            steps.failed = self._failed()
            self._bars.update(self._tasks[steps], completed=steps.done, total=steps.total or None)
        elif self._is_line_due():
            self._print_line()

    def running(self, jobs: Sequence[RunningJob]) -> None:
        """Show which simulations are running."""
        self._running = jobs
        if self._shown.first is None:
            self._shown.first = (time.monotonic(), self._shown.done)

    def expect(self, n_left: int, seconds_left: float | None) -> None:
        """Show how many simulations are to come in the whole command."""
        run = self._run
        run.is_forecast, run.total = True, run.done + n_left
        run.left = None if seconds_left is None else (time.monotonic(), seconds_left)

    def at(self, text: str) -> None:
        """Show where in the stage the work is."""
        self._place = text

    def note(self, text: str) -> None:
        """Print a message during a stage."""
        if text.startswith(WARNING):
            self.warnings.append(text.removeprefix(WARNING))
        self._console.print(text, markup=False)

    def should_continue(self) -> bool:
        """Go on until the user asks to stop."""
        return not self._stopping

    @property
    def spent(self) -> str:
        """Time of all stages, and of those that took part of it."""
        parts = [f"{stage} {duration(s)}" for stage, s in self._seconds.items() if s >= 0.5]
        total = duration(sum(self._seconds.values()))
        return f"{total} ({', '.join(parts)})" if len(parts) > 1 else total

    def _note_time(self) -> None:
        """Add the time that has passed to the time of the running stage."""
        now = time.monotonic()
        self._seconds[self._stage or "start"] += now - self._begun
        self._begun = now

    def _look_at_clock(self) -> None:
        """Print a line where nothing has ended for a while, until the end of the command."""
        while not self._ended.wait(LOOK_S):
            self._note_slow()
            if self._bars is None and self._stage and self._is_late():
                self._print_line()

    def _note_slow(self) -> None:
        """Report once each simulation that takes many times as long as usual."""
        now = time.monotonic()
        for job in self._running:
            passed = now - job.since_s
            which = (job.name, job.since_s)
            if job.usual_s and passed > max(SLOW_S, SLOW * job.usual_s) and which not in self._slow:
                self._slow.add(which)
                self.note(
                    f"slow: {job.name} has taken {duration(passed)}, where {about(job.usual_s)} is usual. "
                    "The solver probably shortens its steps. `time_limit` in [solver] ends it."
                )

    def _print_line(self) -> None:
        self._last_line, steps = time.monotonic(), self._shown
        done = f"{steps.done} of {steps.total}" if steps.total > 1 else ""
        line = ": ".join(filter(None, (self._stage, done, self._counts())))
        line = _joined(line, steps.time_left(), self._place)
        if line != self._stage:  # it was named when it began
            self._console.print(line, markup=False)

    def _second_line(self) -> str:
        """Part of a line that a narrow terminal may cut."""
        return _joined(self._counts(), self._place)

    def _failed(self) -> str:
        notes = self._shown.notes
        n_failed = notes.total() - notes["ok"] if self._stage in SIMULATING else 0
        return f"{n_failed} failed" if n_failed else ""

    def _counts(self) -> str:
        """Counts by how steps ended, failures first, and the simulation that runs for longest."""
        ended = sorted(self._shown.notes.items(), key=lambda each: (each[0] == "ok", -each[1]))
        counts = [f"{count} {name}" for name, count in ended]
        if jobs := self._running:
            longest = min(jobs, key=lambda job: job.since_s)
            passed = duration(time.monotonic() - longest.since_s)
            counts.append(f"{len(jobs)} running ({longest.name}, {passed})")
        return ", ".join(counts)

    def _is_line_due(self) -> bool:
        steps = self._shown
        tenth = max(1, steps.total // 10)
        is_end = steps.done == steps.total and not steps.is_forecast
        if steps.total >= 10 and (steps.done % tenth == 0 or is_end):
            return True
        return self._is_late()

    def _is_late(self) -> bool:
        return time.monotonic() - self._last_line > LINE_S

    def _stop(self, number: int, frame: FrameType | None) -> None:
        """Finish what runs when asked once, stop at once when asked again."""
        if self._stopping or self._stage not in SIMULATING:
            self._is_interrupted = True
            raise KeyboardInterrupt
        self._stopping = True
        self._console.print(
            "finishing the simulations that are running; once more (Ctrl-C) stops at once", markup=False
        )


@dataclass(slots=True, eq=False)
class _Steps:
    """Steps of a stage, or simulations of a whole command whose number is forecast.

    Parameters
    ----------
    first : (float, int), optional
        When the pace begins to count, and the steps done by then.
    left : (float, float), optional
        When the time to come was forecast, and that time.
    """

    total: int = 0
    first: tuple[float, int] | None = None
    done: int = 0
    is_forecast: bool = False
    left: tuple[float, float] | None = None
    notes: Counter[str] = field(default_factory=Counter)
    failed: str = ""

    @property
    def count(self) -> str:
        """Steps that ended of all; empty for a stage of one step."""
        return "" if self.total == 1 else f"{self.done}/{self.total or '?'}"

    def time_left(self) -> str:
        """Time to come: as it was forecast, else at the pace so far."""
        now = time.monotonic()
        if self.is_forecast:
            seconds = self.left[0] + self.left[1] - now if self.left else 0.0
            return f"{about(seconds)} left" if seconds > 0.0 else ""  # one that takes longer than usual
        started_s, n_before = self.first or (now, self.done)
        n_left, n_done = self.total - self.done, self.done - n_before
        if n_left <= 0 or not n_done:
            return ""
        return f"{about((now - started_s) / n_done * n_left)} left"


def _joined(*parts: str) -> str:
    return "; ".join(part for part in parts if part)


def _bars(console: Any, side: Callable[[], str]) -> "RichProgress":  # noqa: ANN401 - rich's, imported only here
    """Bars with count, time left and failures at any width, and the ``side`` on a line below them."""
    from rich.progress import BarColumn, Progress as RichProgress, TextColumn, TimeElapsedColumn
    from rich.table import Column
    from rich.text import Text

    class Bars(RichProgress):
        def get_renderables(self) -> Iterable[Any]:
            yield self.make_tasks_table(self.tasks)
            if text := side():
                yield Text(f"  {text}", no_wrap=True, overflow="ellipsis")

    class TimeColumn(TimeElapsedColumn):
        """Time to come where it is known, else what has passed."""

        def render(self, task: Any) -> Text:  # noqa: ANN401 - rich's, imported only here
            left = task.fields["steps"].time_left()
            return Text(left, style="progress.remaining") if left else super().render(task)

    return Bars(
        TextColumn("{task.description}"),
        TextColumn("{task.fields[steps].count}"),
        TimeColumn(),
        TextColumn("{task.fields[steps].failed}", style="red"),
        BarColumn(bar_width=None, table_column=Column(ratio=1, max_width=20)),
        console=console,
        expand=True,
    )
