"""Limbs from coloured scans and bone models."""

from typing import TYPE_CHECKING

from palpate import hookimpl

if TYPE_CHECKING:
    import typer


@hookimpl
def palpate_commands(app: "typer.Typer") -> None:
    """Add ``palpate limb SCAN`` to the stage that reads a study's limbs."""
    from palpate_limb.cli import scan

    for group in app.registered_groups:
        if group.name == "limb" and group.typer_instance is not None:
            group.typer_instance.command()(scan)
