"""Presses of living limbs with an ultrasound probe: layered finite elements, and a fit to all people."""

from typing import TYPE_CHECKING

from palpate.api import deferred, hookimpl

if TYPE_CHECKING:
    import typer

    from palpate_multis.layered_block import simulate_press as simulate_press
    from palpate_multis.population import (
        Population as Population,
        bootstrap as bootstrap,
        fit as fit,
        left_out as left_out,
        person_factor as person_factor,
        with_sites as with_sites,
    )
    from palpate_multis.presses import Presses as Presses, read_presses as read_presses

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)


@hookimpl
def palpate_commands(app: "typer.Typer") -> None:
    """``predict-press``."""
    from palpate.api import examples, name_of
    from palpate_multis.command import predict_press

    lines = (
        "palpate predict-press presses.csv",
        "palpate predict-press presses.csv --fitted-to measured.csv --json",
    )
    app.command(name_of(predict_press), rich_help_panel="Limbs", epilog=examples(*lines))(predict_press)
