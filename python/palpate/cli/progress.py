"""Progress on stderr: a bar for people, lines for the log of a batch system."""

import signal
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Any

from palpate.cli.session import Session
from palpate.errors import StoppedError
from palpate.progress import about, duration

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

_ASKING = (signal.SIGINT, signal.SIGTERM)
"""Signals that ask to stop; batch systems send the second before they kill."""

SIMULATING = ("simulate", "fit", "surface")
"""Stages of simulations: asked to stop, they finish those that are running."""

LINE_S = 50.0
"""Time after which a log gets a line at the next look, so that it gets one every minute."""

WARNING = "warning: "
"""How a note begins that also goes to ``--json``."""

LOOK_S = 5.0
"""Time between two looks at the clock."""


class StageProgress:
    """A :class:`palpate.progress.Progress` that shows one stage after the other.

    Parameters
    ----------
    keeps : bool
        Whether the simulations of a sweep are kept when it is stopped.
    """

    def __init__(self, session: Session, *, keeps: bool = True) -> None:
        self._keeps = keeps
        self._console = session.stderr
        self._bars: Progress | None = None
        self._task: TaskID | None = None
        self._stage = ""
        self._total = self._done = self._n_running = 0
        self._last_line = time.monotonic()
        self._first: tuple[float, int] | None = None
        self.warnings: list[str] = []
        """Every note so far that begins with ``warning:``, without that."""
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self._begun = time.monotonic()
        self._notes: Counter[str] = Counter()
        self._place = ""
        self._stopping = self._is_interrupted = False
        self._handlers: dict[signal.Signals, Any] = {}
        self._ended = threading.Event()
        self._clock = threading.Thread(target=self._look_at_clock, daemon=True)

    def __enter__(self) -> "StageProgress":
        if self._console.is_terminal:
            self._bars = _bars(self._console, self._second_line)
            self._bars.start()
        else:
            self._clock.start()
        if threading.current_thread() is threading.main_thread():
            self._handlers = {each: signal.signal(each, self._stop) for each in _ASKING}
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
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
        """Show a new stage of ``total`` steps."""
        if self._is_interrupted:  # a library may have swallowed the exception in a callback of its own
            raise KeyboardInterrupt
        self._note_time()
        self._stage, self._total, self._done, self._n_running = stage, total, 0, 0
        # Of a sweep the pace counts from its first simulation: what is done before was done by another run.
        self._last_line = time.monotonic()
        self._first = None if stage == "simulate" else (self._last_line, 0)
        self._notes, self._place = Counter(), ""
        if self._bars is not None:
            self._task = self._bars.add_task(stage, total=total or None, left="", failed="")
        else:
            self._console.print(f"{stage}: {total} steps" if total > 1 else f"{stage} …", markup=False)

    def step(self, note: str = "") -> None:
        """Count one step, and how it ended."""
        self._done += 1
        self._n_running = max(0, self._n_running - 1)
        if note:
            self._notes[note] += 1
        if self._bars is not None and self._task is not None:
            self._bars.update(self._task, advance=1, left=self._left(), failed=self._failed())
        elif self._is_line_due():
            self._print_line()

    def running(self, n_running: int) -> None:
        """Show how many simulations are running."""
        self._n_running = n_running
        if self._first is None:
            self._first = (time.monotonic(), self._done)

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
        """Add the time that has passed to that of the running stage."""
        now = time.monotonic()
        self._seconds[self._stage or "start"] += now - self._begun
        self._begun = now

    def _look_at_clock(self) -> None:
        """Print a line where nothing has ended for a while, until the end of the command."""
        while not self._ended.wait(LOOK_S):
            if self._stage and self._is_late():
                self._print_line()

    def _print_line(self) -> None:
        self._last_line = time.monotonic()
        done = f"{self._done} of {self._total} " if self._total else ""
        line = f"{self._stage}: {done}{self._counts()}"
        self._console.print(_joined(line.rstrip(" :"), self._left(), self._place), markup=False)

    def _second_line(self) -> str:
        """Part of a line that a narrow terminal may cut."""
        return _joined(self._counts(), self._place)

    def _failed(self) -> str:
        n_failed = self._notes.total() - self._notes["ok"] if self._stage in SIMULATING else 0
        return f"{n_failed} failed" if n_failed else ""

    def _counts(self) -> str:
        """Counts by how steps ended, failures first."""
        ended = sorted(self._notes.items(), key=lambda each: (each[0] == "ok", -each[1]))
        running = [f"{self._n_running} running"] if self._n_running else []
        return ", ".join([*(f"{count} {name}" for name, count in ended), *running])

    def _left(self) -> str:
        """Time to come, at the pace so far."""
        started_s, n_before = self._first or (time.monotonic(), self._done)
        n_left, n_done = self._total - self._done, self._done - n_before
        if n_left <= 0 or not n_done:
            return ""
        return f"{about((time.monotonic() - started_s) / n_done * n_left)} left"

    def _is_line_due(self) -> bool:
        tenth = max(1, self._total // 10)
        if self._total >= 10 and (self._done % tenth == 0 or self._done == self._total):
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


def _joined(*parts: str) -> str:
    return "; ".join(part for part in parts if part)


def _bars(console: Any, side: Callable[[], str]) -> "Progress":  # noqa: ANN401 - rich's, imported only here
    """Bars with count, time left and failures at any width, and the ``side`` on a line below them."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.table import Column
    from rich.text import Text

    class Bars(Progress):
        def get_renderables(self) -> Iterable[Any]:
            yield self.make_tasks_table(self.tasks)
            if text := side():
                yield Text(f"  {text}", no_wrap=True, overflow="ellipsis")

    class TimeColumn(TimeElapsedColumn):
        """Time to come where it is known, else what has passed."""

        def render(self, task: Any) -> Text:  # noqa: ANN401 - rich's, imported only here
            return (
                Text(task.fields["left"], style="progress.remaining")
                if task.fields["left"]
                else super().render(task)
            )

    return Bars(
        TextColumn("{task.description}"),
        MofNCompleteColumn(),
        TimeColumn(),
        TextColumn("{task.fields[failed]}", style="red"),
        BarColumn(bar_width=None, table_column=Column(ratio=1, max_width=20)),
        console=console,
        expand=True,
    )
