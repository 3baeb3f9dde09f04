"""Commands that a plugin adds to the command line, of their own or under a stage."""

from collections.abc import Callable, Iterable
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
        A Typer command; its name is the name of the command.
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
        """Add it to the application, or to its stage, which is one of the application's groups."""
        from typer.core import TyperCommand

        if not self.stage:
            app.command(self.name, rich_help_panel=self.panel, epilog=self.epilog)(self.function)
            return
        groups = {each.name: each.typer_instance for each in app.registered_groups if each.typer_instance}
        kind = type("StageCommand", (TyperCommand,), {"suffixes": self.suffixes})
        groups[self.stage].command(cls=kind, epilog=self.epilog)(self.function)


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


def new_names(app: "typer.Typer", commands: Iterable[Command], stages: Iterable[str]) -> list[str]:
    """Names, such as ``limb scan``, of commands and stages that an application can get.

    A PluginError where a stage takes no commands, or a name is taken.
    """
    names, groups = list(stages), [str(group.name) for group in app.registered_groups]
    for command in commands:
        if command.stage and command.stage not in groups:
            raise PluginError(f"stage '{command.stage}' takes no commands; use one of {', '.join(groups)}")
        names.append(f"{command.stage} {command.name}".lstrip())
    taken = command_names(app)
    for k, name in enumerate(names):
        if name in taken or name in names[:k]:
            raise PluginError(f"command '{name}' already exists; rename it")
    return names
