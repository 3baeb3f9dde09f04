"""Certainty of identified parameters: intervals, their causes, posteriors, and what a sweep allows."""

from typing import TYPE_CHECKING

from palpate.api import hookimpl

if TYPE_CHECKING:
    from palpate.api import Stage
    from palpate.api.cli import Command

__version__ = "0.1.0"


@hookimpl
def palpate_stages() -> "list[type[Stage]]":
    """``intervals``, ``contours``, ``validate``, ``certainty`` and ``identifiability``."""
    from palpate_certainty.stages import Identifiability, Intervals, Posteriors, ProfilePlanes, Validation

    return [Intervals, ProfilePlanes, Validation, Posteriors, Identifiability]


@hookimpl
def palpate_commands() -> "list[Command]":
    """Provide the commands of the stages."""
    from palpate.api.cli import STAGES, Command, examples, stage_command

    does = {
        "intervals": "Compute 95 % intervals of the fitted parameters and their error sources.",
        "contours": "Compute Fopt in the planes of two parameters, the others fitted again.",
        "validate": "Predict each press, or each channel of one press, from the others, and compare.",
        "certainty": "Draw the posteriors of the joint fits; simulates some more sets.",
        "identifiability": "Find how well the curves of the sweep identify each parameter.",
    }
    return [
        Command(function=stage_command(name, text), panel=STAGES, epilog=examples(f"palpate {name} arm"))
        for name, text in does.items()
    ]
