"""Hyperelastic materials, their relaxation, the Drucker filter, and studies of measured rubber and silicone.

Names are imported when they are first used, so that loading the plugin is fast.
"""

from importlib.resources import files
from typing import TYPE_CHECKING

from palpate.api import deferred, hookimpl

if TYPE_CHECKING:
    from palpate.api import Channel, Material, SetFilter, Stage, StudyTemplate
    from palpate.api.cli import Command
    from palpate.api.fit import Parametrisation
    from palpate_materials.fibres import HolzapfelGasserOgden as HolzapfelGasserOgden
    from palpate_materials.neo_hookean import NeoHookean as NeoHookean
    from palpate_materials.stability import Drucker as Drucker
    from palpate_materials.uncoupled import (
        ArrudaBoyce as ArrudaBoyce,
        Demiray as Demiray,
        Gent as Gent,
        MooneyRivlin as MooneyRivlin,
        Ogden as Ogden,
        VerondaWestmann as VerondaWestmann,
        Yeoh as Yeoh,
    )

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)


@hookimpl
def palpate_materials() -> "list[type[Material]]":
    """Provide the paper's three materials, five more that are isotropic, and one with fibres."""
    from palpate_materials import (
        ArrudaBoyce,
        Demiray,
        Gent,
        HolzapfelGasserOgden,
        MooneyRivlin,
        NeoHookean,
        Ogden,
        VerondaWestmann,
        Yeoh,
    )

    powers: list[type[Material]] = [Ogden, Yeoh, NeoHookean, MooneyRivlin]
    return [*powers, VerondaWestmann, Demiray, Gent, ArrudaBoyce, HolzapfelGasserOgden]


@hookimpl
def palpate_set_filters() -> "list[type[SetFilter]]":
    """Provide the Drucker filter."""
    from palpate_materials.stability import Drucker

    return [Drucker]


@hookimpl
def palpate_channels() -> "list[Channel]":
    """Provide force and torque over time."""
    from palpate_materials.relaxation import FORCE_OVER_TIME, TORQUE_OVER_TIME

    return [FORCE_OVER_TIME, TORQUE_OVER_TIME]


@hookimpl
def palpate_parametrisations() -> "list[type[Parametrisation]]":
    """Provide the relaxing tissue."""
    from palpate_materials.relaxation import Relaxing

    return [Relaxing]


@hookimpl
def palpate_stages() -> "list[type[Stage]]":
    """Provide the relaxation that a fit has found."""
    from palpate_materials.relaxation_over_time import RelaxationOverTime

    return [RelaxationOverTime]


@hookimpl
def palpate_commands() -> "list[Command]":
    """Provide the command of the stage."""
    from palpate.api.cli import STAGES, Command, examples, stage_command

    function = stage_command("relaxation", "Find how far the moduli relax in time, with a band.")
    return [Command(function=function, panel=STAGES, epilog=examples("palpate relaxation arm"))]


@hookimpl
def palpate_studies() -> "list[StudyTemplate]":
    """Provide two studies on measured data."""
    from palpate.api import StudyTemplate

    return [
        StudyTemplate(
            name="treloar",
            summary="Treloar's rubber in three modes; half a minute (measured)",
            directory=_directory("treloar"),
        ),
        StudyTemplate(
            name="ecoflex",
            summary="compression of five Ecoflex 00-50 cylinders (measured)",
            directory=_directory("ecoflex"),
        ),
    ]


def _directory(name: str) -> str:
    return str(files("palpate_materials") / "studies" / name)
