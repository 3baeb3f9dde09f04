"""Commands that a plugin adds to the command line, of their own or under a stage."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from palpate.errors import PluginError

if TYPE_CHECKING:
    import typer


def name_of(command: Callable[..., object]) -> str:
    """Name of a command: its function's, with hyphens."""
    return command.__name__.strip("_").replace("_", "-")


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """A command such as ``palpate predict``, or one under a stage, such as ``palpate limb scan``.

    Parameters
    ----------
    function : callable
        A Typer command; its name is that of the command.
    stage : str
        "experiment" or "limb"; empty for a command of its own.
    panel : str
        Heading in the list of commands, for a command of its own.
    suffixes : frozenset of str
        Files whose name alone calls the command: with ``.ply``, ``palpate limb arm.ply`` is
        ``palpate limb scan arm.ply``.
    epilog : str
        End of its help, such as examples.
    output : str
        ``module:name`` of the type of what it prints with ``--json``, imported for `palpate schema` alone.
    """

    function: Callable[..., None]
    stage: str = ""
    panel: str = "More"
    suffixes: frozenset[str] = frozenset()
    epilog: str = ""
    output: str = ""

    @property
    def name(self) -> str:
        """Name of the command."""
        return name_of(self.function)

    def add_to(self, app: "typer.Typer") -> None:
        """Add it to the application, or to its stage.

        Raises
        ------
        PluginError
            The stage takes no commands.
        """
        from typer.core import TyperCommand

        if not self.stage:
            app.command(self.name, rich_help_panel=self.panel, epilog=self.epilog)(self.function)
            return
        groups = {group.name: group.typer_instance for group in app.registered_groups}
        if (group := groups.get(self.stage)) is None:
            raise PluginError(
                f"stage '{self.stage}' takes no commands; use one of {', '.join(map(str, groups))}"
            )
        kind = type("StageCommand", (TyperCommand,), {"suffixes": self.suffixes})
        group.command(cls=kind, epilog=self.epilog)(self.function)


def command_names(app: "typer.Typer") -> list[str]:
    """Names of commands and groups, and of the commands in groups: ``limb scan``."""
    names = [
        command.name or getattr(command.callback, "__name__", "").replace("_", "-")
        for command in app.registered_commands
    ]
    for group in app.registered_groups:
        inner = command_names(group.typer_instance) if group.typer_instance else []
        names += [str(group.name), *(f"{group.name} {name}" for name in inner)]
    return names


def refuse_command_clashes(app: "typer.Typer") -> None:
    """Raise a PluginError where two commands have one name."""
    names = command_names(app)
    double = sorted({name for name in names if names.count(name) > 1})
    if double:
        raise PluginError(f"command '{double[0]}' already exists; rename it")
