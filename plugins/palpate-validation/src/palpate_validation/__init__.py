"""Comparison of solvers with each other and with recorded results, and friction without history."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from palpate.api import hookimpl

if TYPE_CHECKING:
    import typer

__version__ = "0.1.0"


@hookimpl
def palpate_commands(app: "typer.Typer") -> None:
    """``certify`` and ``friction-memory``."""
    from palpate.api import examples, name_of
    from palpate_validation.certify import certify
    from palpate_validation.friction_command import friction_memory

    calls: dict[Callable[..., None], tuple[str, ...]] = {
        certify: (
            "palpate certify",
            "palpate certify yeoh --mesh limb.vtu --into runs/arm/solver-comparison.json",
            "palpate certify --solver my_solver",
        ),
        friction_memory: ("palpate friction-memory", "palpate friction-memory --steps 5 --steps 40"),
    }
    for command, lines in calls.items():
        app.command(name_of(command), rich_help_panel="Verification", epilog=examples(*lines))(command)
