"""Progress on stderr: a bar for people, a few lines for a log."""

import signal
import threading
from collections import Counter
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Any

from palpate.cli.session import Session
from palpate.errors import StoppedError

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID


_ASKING = (signal.SIGINT, signal.SIGTERM)
"""Signals that ask to stop; batch systems send the second before they kill."""


class StageProgress:
    """A :class:`palpate.progress.Progress` that shows one stage after the other."""

    def __init__(self, session: Session) -> None:
        self._console = session.stderr
        self._bars: Progress | None = None
        self._task: TaskID | None = None
        self._stage = ""
        self._total = 0
        self._done = 0
        self._notes: Counter[str] = Counter()
        self._stopping = False
        self._handlers: dict[signal.Signals, Any] = {}

    def __enter__(self) -> "StageProgress":
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

        if self._console.is_terminal:
            self._bars = Progress(
                TextColumn("{task.description:<14}"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                TextColumn("left"),
                TimeRemainingColumn(),
                TextColumn("{task.fields[notes]}"),
                console=self._console,
            )
            self._bars.start()
        if threading.current_thread() is threading.main_thread():
            self._handlers = {each: signal.signal(each, self._stop) for each in _ASKING}
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        if self._bars is not None:
            self._bars.stop()
        if kind is not None and issubclass(kind, KeyboardInterrupt):
            raise StoppedError("stopped; what is simulated is kept, and the same command goes on from there")

    def begin(self, stage: str, total: int) -> None:
        """Show a new stage of ``total`` steps."""
        self._stage, self._total, self._done = stage, total, 0
        self._notes = Counter()
        if self._bars is not None:
            self._task = self._bars.add_task(stage, total=total, notes="")
        else:
            self._console.print(f"{stage}: {total} steps", markup=False)

    def step(self, note: str = "") -> None:
        """Count one step, and how it ended."""
        self._done += 1
        if note:
            self._notes[note] += 1
        notes = ", ".join(f"{count} {name}" for name, count in self._notes.most_common())
        if self._bars is not None and self._task is not None:
            self._bars.update(self._task, advance=1, notes=notes)
        elif self._tenth_done():
            self._console.print(
                f"{self._stage}: {self._done} of {self._total} {notes}".rstrip(), markup=False
            )

    def _tenth_done(self) -> bool:
        tenth = max(1, self._total // 10)
        return self._total >= 10 and (self._done % tenth == 0 or self._done == self._total)

    def note(self, text: str) -> None:
        """Tell of something on the way."""
        self._console.print(text, markup=False)

    def going_on(self) -> bool:
        """Go on until the user asks to stop."""
        return not self._stopping

    def _stop(self, number: int, frame: FrameType | None) -> None:
        """Finish what runs when asked once, stop at once when asked again."""
        if self._stopping or self._stage != "simulate":
            raise KeyboardInterrupt
        self._stopping = True
        self._console.print(
            "finishing the simulations that are running; once more (Ctrl-C) stops at once", markup=False
        )
