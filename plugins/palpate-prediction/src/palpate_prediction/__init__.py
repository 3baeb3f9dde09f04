"""Predictions of a fitted limb under another tool, motion or at another spot; and cards of its materials."""

from typing import TYPE_CHECKING

from palpate.api import hookimpl

if TYPE_CHECKING:
    from palpate.api.cli import Command


@hookimpl
def palpate_commands() -> "list[Command]":
    """``palpate predict`` and ``palpate card``."""
    from palpate.api.cli import RUN, Command, examples
    from palpate_prediction.commands import card, predict

    return [
        Command(
            function=predict,
            panel=RUN,
            output="palpate_prediction.files:PredictOutput",
            epilog=examples("palpate predict runs/arm --tool cuff.toml"),
        ),
        Command(
            function=card,
            panel=RUN,
            output="palpate_prediction.files:CardOutput",
            epilog=examples(
                "palpate card runs/arm --for abaqus", "palpate card runs/arm --for febio --into arm.feb"
            ),
        ),
    ]
