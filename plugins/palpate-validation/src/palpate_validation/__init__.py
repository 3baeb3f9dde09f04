"""Comparison of solvers with each other and with recorded results."""

from typing import TYPE_CHECKING

from palpate.api import hookimpl

if TYPE_CHECKING:
    from palpate.api.cli import Command

__version__ = "0.1.0"


@hookimpl
def palpate_commands() -> "list[Command]":
    """``certify``."""
    from palpate.api.cli import Command, examples
    from palpate_validation.certify import certify

    lines = (
        "palpate certify",
        "palpate certify yeoh --mesh limb.vtu --into runs/arm/solver-comparison.json",
        "palpate certify --solver my_solver",
        "palpate certify --study arm --out /scratch/arm",
    )
    return [Command(function=certify, panel="Verification", epilog=examples(*lines))]
