"""Commands and subcommands that plugins add: all of a plugin, or none."""

import pytest
import typer

from .conftest import Write
from .test_plugins import BROKEN, COMMAND, load


def test_a_plugin_adds_a_command(write: Write) -> None:
    app = typer.Typer()
    broken = load(write("cmd", COMMAND.format(name="hello", then=""))).add_commands(app)
    assert broken == ()
    assert [command.name for command in app.registered_commands] == ["hello"]


@pytest.mark.parametrize(
    ("name", "then", "reason"),
    [
        ("hello", "raise RuntimeError('half way')", "RuntimeError: half way"),
        ("run", "", "command 'run' already exists"),
    ],
)
def test_a_plugin_with_broken_commands_adds_none(write: Write, name: str, then: str, reason: str) -> None:
    app = typer.Typer()

    @app.command()
    def run() -> None: ...

    (broken,) = load(write("cmd", COMMAND.format(name=name, then=then))).add_commands(app)
    assert reason in broken.reason
    assert len(app.registered_commands) == 1


SUBCOMMAND = """
from palpate.api import hookimpl
from palpate.api.cli import Command

def {name}() -> None:
    pass

@hookimpl
def palpate_commands():
    return [Command(stage="limb", function={name}), Command(stage="{stage}", function={name})]
"""


@pytest.mark.parametrize(
    ("name", "stage", "reason"),
    [
        ("cast", "run", "stage 'run' takes no commands; use one of experiment, limb"),
        ("cast", "limb", "command 'limb cast' already exists"),
        ("cast", "experiment", ""),
    ],
)
def test_subcommands_are_added_to_their_stages_all_or_none(
    write: Write, name: str, stage: str, reason: str
) -> None:
    app = typer.Typer()
    groups = {key: typer.Typer() for key in ("experiment", "limb")}
    for key, group in groups.items():
        app.add_typer(group, name=key)
    broken = load(write("sub", SUBCOMMAND.format(name=name, stage=stage))).add_commands(app)
    assert [reason in one.reason for one in broken] == [True] * bool(reason)
    assert [len(group.registered_commands) for group in groups.values()] == ([0, 0] if reason else [1, 1])


def test_a_plugin_that_is_left_out_adds_no_command(write: Write) -> None:
    app = typer.Typer()
    half = COMMAND.format(name="hello", then="") + BROKEN["raises in hook"][0]
    assert load(write("half", half)).add_commands(app) == ()
    assert app.registered_commands == []
