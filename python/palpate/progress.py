"""How a stage tells its caller how far it is; the library itself prints nothing."""

from typing import Protocol


class Progress(Protocol):
    """What a caller hands in to follow a run."""

    def begin(self, stage: str, total: int) -> None:
        """Begin a stage that has ``total`` steps."""

    def step(self, note: str = "") -> None:
        """Count one step of the running stage; ``note`` says how it ended where that matters."""


class Silent:
    """A :class:`Progress` that keeps quiet."""

    def begin(self, stage: str, total: int) -> None:
        """Say nothing."""

    def step(self, note: str = "") -> None:
        """Say nothing."""


SILENT = Silent()
