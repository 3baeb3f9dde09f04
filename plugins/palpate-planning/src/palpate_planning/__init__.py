"""Presses to make, first or next, that reduce the error of a fit."""

from typing import TYPE_CHECKING

from palpate.api import hookimpl

if TYPE_CHECKING:
    from palpate.api.cli import Command


@hookimpl
def palpate_commands() -> "list[Command]":
    """``palpate next`` and ``palpate extend``."""
    from palpate.api.cli import RUN, Command, examples
    from palpate_planning.commands import extend, next_

    return [
        Command(
            function=next_,
            panel=RUN,
            output="palpate_planning.tables:ProposalOutput",
            epilog=examples(
                "palpate next runs/arm",
                "palpate next runs/arm --for soft_tissue.c1 --presses 3",
                "palpate next arm --presses 4 --allowed allowed.toml",
            ),
        ),
        Command(
            function=extend,
            panel=RUN,
            output="palpate.api.cli:RunOutput",
            epilog=examples("palpate extend runs/arm --with p2-9.csv"),
        ),
    ]
