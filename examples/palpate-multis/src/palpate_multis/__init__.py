"""Presses of living limbs with an ultrasound probe: layered finite elements, and a fit to all people."""

from importlib.resources import files
from typing import TYPE_CHECKING

from palpate.api import deferred, hookimpl

if TYPE_CHECKING:
    from palpate.api import StudyTemplate
    from palpate.api.cli import Command
    from palpate_multis.layered_block import simulate_press as simulate_press
    from palpate_multis.person_study import write_study as write_study
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
def palpate_commands() -> "list[Command]":
    """``predict-press``."""
    from palpate.api.cli import Command, examples
    from palpate_multis.command import predict_press

    lines = (
        "palpate predict-press presses.csv",
        "palpate predict-press presses.csv --fitted-to measured.csv --json",
    )
    return [Command(function=predict_press, panel="Limbs", epilog=examples(*lines))]


@hookimpl
def palpate_studies() -> "list[StudyTemplate]":
    """Provide the presses of one person as a study."""
    from palpate.api import StudyTemplate

    summary = "one living person pressed by hand at four sites; slopes only (measured; MULTIS)"
    directory = str(files("palpate_multis") / "studies" / "multis")
    return [StudyTemplate(name="multis", summary=summary, directory=directory)]
