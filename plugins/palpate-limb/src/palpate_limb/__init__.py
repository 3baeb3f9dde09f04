"""Limbs from scans and models with their bones, and tools from files of their surface."""

from typing import TYPE_CHECKING

from palpate.api import hookimpl

if TYPE_CHECKING:
    from palpate.api import Indenter
    from palpate.api.cli import Command


@hookimpl
def palpate_indenters() -> "list[type[Indenter]]":
    """Provide tools from files of their surface."""
    from palpate_limb.stl_indenter import StlIndenter

    return [StlIndenter]


@hookimpl
def palpate_commands() -> "list[Command]":
    """``palpate limb SCAN`` and ``palpate limb inspect FILE``."""
    from palpate.api.cli import Command, examples
    from palpate_limb.cli import SCAN_SUFFIXES, inspect, scan

    calls = examples(
        "palpate limb scan.ply --bones radius.stl --bones ulna.stl",
        'palpate limb scan.ply --options limb.toml --mark p1=red --size "2 mm"',
    )
    looks = examples("palpate limb inspect limb.feb", "palpate limb inspect limb.inp --json")
    return [
        Command(stage="limb", function=scan, suffixes=SCAN_SUFFIXES, epilog=calls),
        Command(stage="limb", function=inspect, epilog=looks),
    ]
