"""Limbs from coloured scans and bone models."""

from typing import TYPE_CHECKING

from palpate.api import hookimpl

if TYPE_CHECKING:
    import typer


@hookimpl
def palpate_commands(app: "typer.Typer") -> None:
    """Add ``palpate limb SCAN`` to the stage that reads a study's limbs."""
    from palpate.api import examples
    from palpate_limb.cli import scan

    calls = examples(
        "palpate limb scan.ply --bones radius.stl --bones ulna.stl",
        'palpate limb scan.ply --mark p1=red --skin "2 mm" --layer fat=5mm',
    )
    for group in app.registered_groups:
        if group.name == "limb" and group.typer_instance is not None:
            group.typer_instance.command(epilog=calls)(scan)
