"""The application: global options, the commands, and what becomes of an error.

Exit codes: 0 done, 1 no set could be selected, in all or in one of the scenarios,
2 a mistake in the input, 70 a bug, with its traceback, 130 stopped by the user.
"""

import errno
import os
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import typer

from palpate import __version__
from palpate.cli.check import check
from palpate.cli.doctor import doctor
from palpate.cli.experiment import experiment, experiment_commands
from palpate.cli.init import init, synthesise
from palpate.cli.limb import limb, limb_commands
from palpate.cli.options import (
    EXAMPLES,
    RUN,
    STAGES as STAGES_PANEL,
    START,
    GroupedCommands,
    examples,
    name_of,
)
from palpate.cli.plugins import new_plugin, plugins
from palpate.cli.run import run
from palpate.cli.schema import schema
from palpate.cli.session import Session, visible
from palpate.cli.stages import STAGE_COMMANDS, add_stage
from palpate.cli.status import status
from palpate.errors import NothingSelectableError, PalpateError, StoppedError
from palpate.plugins.guard import line_of

PANELS: Mapping[str, tuple[Callable[..., object], ...]] = MappingProxyType(
    {
        START: (init, check, doctor, plugins, new_plugin, schema),
        RUN: (run, status, synthesise),
        STAGES_PANEL: (experiment, limb, *STAGE_COMMANDS),
    }
)
"""Commands by the heading under which help lists them."""

COMMANDS = (*PANELS[START], *PANELS[RUN])
STAGES = PANELS[STAGES_PANEL]
GROUPS = MappingProxyType({experiment: experiment_commands, limb: limb_commands})
"""Stages with commands of their own, some of which plugins add."""


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"palpate {__version__}")
        raise typer.Exit


def _options(
    context: typer.Context,
    plugin: Annotated[
        list[Path] | None,
        typer.Option("--plugin", metavar="FILE", help="A one-file plugin; repeat for more."),
    ] = None,
    no_plugin: Annotated[
        list[str] | None,
        typer.Option(
            "--no-plugin", metavar="NAME", help="An installed plugin to leave out; repeat for more."
        ),
    ] = None,
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Identify material parameters of soft tissue from indentation force and torque."""
    if context.obj is None:
        context.obj = Session(plugin or (), no_plugin or (), build_app)


def build_app() -> typer.Typer:
    """Build the application with the core's own commands."""
    app = typer.Typer(
        name="palpate",
        cls=GroupedCommands,
        no_args_is_help=True,
        add_completion=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    app.callback()(_options)
    for panel, commands in PANELS.items():
        for command in commands:
            name, epilog = name_of(command), examples(*EXAMPLES[name_of(command)])
            if command in GROUPS:
                app.add_typer(GROUPS[command](), name=name, rich_help_panel=panel, epilog=epilog)
            else:
                app.command(name, rich_help_panel=panel, epilog=epilog)(command)
    return app


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    _reserve_stdout()
    given, files = split_option("--plugin", sys.argv[1:] if arguments is None else arguments)
    given, without = split_option("--no-plugin", given)
    app = build_app()
    session = Session([Path(file) for file in files], without, build_app)
    session.arguments = tuple(given)
    if arguments is None:  # the whole process is this command's
        session.began_processor_s = 0.0
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads of small matrices wait for each other
    try:
        return _run(app, session, given)
    except Exception as error:
        traceback.print_exc()
        bug = f"a bug of palpate or of a plugin{line_of(error)}; tell its author, with the lines above"
        return _fail(PalpateError(bug), 70)


def _run(app: typer.Typer, session: Session, given: Sequence[str]) -> int:
    try:
        if not _is_core_command(given):
            from palpate.plugins.registry import add_commands

            adding = partial(add_stage, app, STAGES_PANEL)
            session.refuse_broken(add_commands(app, session.files, session.without, adding))
        app(list(given), obj=session, prog_name="palpate")
    except NothingSelectableError as error:
        return _fail(error, 1)
    except StoppedError as error:
        return _fail(error, 130)
    except PalpateError as error:
        return _fail(PalpateError(session.addressed(str(error))), 2)
    except OSError as error:
        return _fail(_of_file(error), 2)
    except SystemExit as stop:
        if stop.code is None or isinstance(stop.code, int):
            return stop.code or 0
        return _fail(PalpateError(str(stop.code)), 2)
    return 0


def _of_file(error: OSError) -> PalpateError:
    """Advice on a file that cannot be used; anything else is a bug and stays one."""
    from palpate.run.ownership import is_of_disk, reason

    if error.errno == errno.ENAMETOOLONG:
        return PalpateError(f"{str(error.filename)[:60]}…: a file name that is too long; shorten it")
    if not is_of_disk(error):
        raise error
    return PalpateError(f"{error.filename or 'a file'}: {reason(error)}")


def _reserve_stdout() -> None:
    """Let what a library writes to file descriptor 1 go to stderr: stdout is for results."""
    if sys.stdout is not sys.__stdout__ or sys.stdout is None or sys.stdout.fileno() != 1:
        return
    sys.stdout.flush()
    results = os.fdopen(os.dup(1), "w", encoding=sys.stdout.encoding, errors=sys.stdout.errors)
    os.dup2(2, 1)
    sys.stdout = results


def split_option(option: str, arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Take an option and its values, such as ``--plugin FILE``, out of the arguments wherever it is."""
    rest: list[str] = []
    values: list[str] = []
    waiting = iter(arguments)
    for argument in waiting:
        if argument == "--":
            return [*rest, argument, *waiting], values
        name, equals, value = argument.partition("=")
        if name != option:
            rest.append(argument)
        elif equals:
            values.append(value)
        elif (following := next(waiting, None)) is not None:
            values.append(following)
        else:
            rest.append(argument)  # typer reports that its value is missing
    return rest, values


def _is_core_command(arguments: Sequence[str]) -> bool:
    # Plugins' commands, groups that they add to and the list of all commands need plugins this early.
    own = {name_of(command) for command in {*COMMANDS, *STAGES} - set(GROUPS)}
    return bool(arguments) and (arguments[0] in own or arguments[0] == "--version")


def _fail(error: PalpateError, code: int) -> int:
    typer.echo(visible(f"palpate: {error}"), err=True)
    return code
