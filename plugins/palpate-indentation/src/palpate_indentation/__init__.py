"""Indentation: channels, the three scenarios, indenters, loaders of curves and of meshes.

Names are imported when they are first used, so that loading the plugin is fast.
"""

from typing import TYPE_CHECKING

from palpate.api import deferred, hookimpl

if TYPE_CHECKING:
    from palpate.api import Channel, ExperimentLoader, Indenter, LimbSource, Motion, Scenario
    from palpate_indentation.csv_loader import CsvLoader as CsvLoader, CsvSettings as CsvSettings
    from palpate_indentation.indenters import (
        Box as Box,
        BoxSettings as BoxSettings,
        Capsule as Capsule,
        CapsuleSettings as CapsuleSettings,
        Cuff as Cuff,
        CuffSettings as CuffSettings,
        Punch as Punch,
        PunchSettings as PunchSettings,
        Ring as Ring,
        RingSettings as RingSettings,
    )
    from palpate_indentation.mesh_source import MeshioSettings as MeshioSettings, MeshioSource as MeshioSource
    from palpate_indentation.motions import Move as Move, Moves as Moves, MovesSettings as MovesSettings

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)


@hookimpl
def palpate_channels() -> "list[Channel]":
    """Provide the paper's two variables, and the variables of a slide and of a tilt."""
    from palpate.api import EQUILIBRIUM_CHANNELS

    return list(EQUILIBRIUM_CHANNELS)


@hookimpl
def palpate_scenarios() -> "list[Scenario]":
    """Provide the paper's three scenarios."""
    from palpate.api import Scenario

    return [
        Scenario(name="I", weights={"force": 1.0, "torque": 1.0}, description="force and torque"),
        Scenario(name="II", weights={"torque": 1.0}, description="torque alone"),
        Scenario(name="III", weights={"force": 1.0}, description="force alone"),
    ]


@hookimpl
def palpate_experiment_loaders() -> "list[type[ExperimentLoader]]":
    """Provide the loader of processed curves."""
    from palpate_indentation.csv_loader import CsvLoader

    return [CsvLoader]


@hookimpl
def palpate_limb_sources() -> "list[type[LimbSource]]":
    """Provide the reader of mesh files."""
    from palpate_indentation.mesh_source import MeshioSource

    return [MeshioSource]


@hookimpl
def palpate_indenters() -> "list[type[Indenter]]":
    """Provide rigid tools in closed form."""
    from palpate_indentation.indenters import Box, Capsule, Cuff, Punch, Ring

    return [Punch, Capsule, Box, Ring, Cuff]


@hookimpl
def palpate_motions() -> "list[type[Motion]]":
    """Provide moves to places and loads."""
    from palpate_indentation.motions import Moves

    return [Moves]
