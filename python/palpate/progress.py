"""Progress that a stage reports to its caller; the library itself prints nothing."""

from collections.abc import Sequence
from typing import NamedTuple

LONG_S = 60.0
"""Time of a sweep from which a smaller first look is offered."""

FIRST_LOOK = 12
"""Sets of a first look."""


class RunningJob(NamedTuple):
    """A simulation that is running.

    Parameters
    ----------
    name : str
        Spot, or "fine mesh" and the spot.
    since_s : float
        Time of its start, by :func:`time.monotonic`.
    usual_s : float or None
        Usual time of such a simulation; None where it is not known.
    """

    name: str
    since_s: float
    usual_s: float | None


class Progress:
    """Follower of a run, which a caller hands in; by itself it prints nothing, and goes on to the end."""

    began_processor_s: float | None = None
    """Processor time of this process when its command began; None of a run that no command makes."""

    def begin(self, stage: str, total: int) -> None:
        """Begin a stage that has ``total`` steps."""

    def step(self, note: str = "") -> None:
        """Count one step of the running stage; ``note`` is how it ended where that matters."""

    def note(self, text: str) -> None:
        """Take notice of something that happened on the way and was dealt with."""

    def at(self, text: str) -> None:
        """Show where in its stage the work is, such as a step of a search."""

    def running(self, jobs: Sequence[RunningJob]) -> None:
        """Take notice of the simulations that are running."""

    def expect(self, n_left: int, seconds_left: float | None) -> None:
        """Take notice of the simulations that the command has still to make, and their time."""

    def should_continue(self) -> bool:
        """Whether to begin another simulation; False finishes those started and stops."""
        return True


SILENT = Progress()


def about(seconds: float) -> str:
    """Estimate of a time in words, which is never "about 0 s"."""
    return "less than a second" if seconds < 1.0 else f"about {duration(seconds)}"


def duration(seconds: float) -> str:
    """Format a time in two units at most."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"
