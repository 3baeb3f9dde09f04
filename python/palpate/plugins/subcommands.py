"""Commands that a plugin adds under a stage of the command line."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from palpate.errors import PluginError

if TYPE_CHECKING:
    import typer


@dataclass(frozen=True, slots=True, kw_only=True)
class SubCommand:
    """A command under a stage, such as ``palpate limb scan``.

    Parameters
    ----------
    stage : str
        "experiment" or "limb".
    function : callable
        A Typer command; its name is that of the command.
    suffixes : frozenset of str
        Files whose name alone calls the command: with ``.ply``, ``palpate limb arm.ply`` is
        ``palpate limb scan arm.ply``.
    epilog : str
        End of its help, such as examples.
    """

    stage: str
    function: Callable[..., None]
    suffixes: frozenset[str] = frozenset()
    epilog: str = ""

    def add_to(self, app: "typer.Typer") -> None:
        """Add it to its stage.

        Raises
        ------
        PluginError
            The stage takes no commands.
        """
        from typer.core import TyperCommand

        groups = {group.name: group.typer_instance for group in app.registered_groups}
        if (group := groups.get(self.stage)) is None:
            raise PluginError(
                f"stage '{self.stage}' takes no commands; use one of {', '.join(map(str, groups))}"
            )
        kind = type("StageCommand", (TyperCommand,), {"suffixes": self.suffixes})
        group.command(cls=kind, epilog=self.epilog)(self.function)
