"""Every hook a plugin may implement, in pipeline order.

A plugin is an entry point of the group ``palpate`` (or a file given with
``--plugin``): a module, or an object, with some of these functions marked
``@palpate.hookimpl``. Each is called once, when the catalogues are built, and
returns classes or values; nothing is computed here.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import pluggy

if TYPE_CHECKING:
    import typer

    from palpate.domain import Channel, Scenario, StudyTemplate
    from palpate.interfaces import (
        Executor,
        ExperimentLoader,
        LimbSource,
        Material,
        Sampler,
        SetFilter,
        Solver,
    )

hookspec = pluggy.HookspecMarker("palpate")


@hookspec
def palpate_studies() -> "Iterable[StudyTemplate]":  # type: ignore[empty-body]
    """Ready studies for ``palpate init`` and ``palpate demo``."""


@hookspec
def palpate_channels() -> "Iterable[Channel]":  # type: ignore[empty-body]
    """Channels that curves may have, with the units and labels of their axes."""


@hookspec
def palpate_experiment_loaders() -> "Iterable[type[ExperimentLoader]]":  # type: ignore[empty-body]
    """Readers of measured curves."""


@hookspec
def palpate_limb_sources() -> "Iterable[type[LimbSource]]":  # type: ignore[empty-body]
    """Makers of meshes with regions."""


@hookspec
def palpate_materials() -> "Iterable[type[Material]]":  # type: ignore[empty-body]
    """Hyperelastic materials."""


@hookspec
def palpate_samplers() -> "Iterable[type[Sampler]]":  # type: ignore[empty-body]
    """Ways to draw a design."""


@hookspec
def palpate_set_filters() -> "Iterable[type[SetFilter]]":  # type: ignore[empty-body]
    """Keepers of the parameter sets that make sense."""


@hookspec
def palpate_solvers() -> "Iterable[type[Solver]]":  # type: ignore[empty-body]
    """Solvers."""


@hookspec
def palpate_executors() -> "Iterable[type[Executor]]":  # type: ignore[empty-body]
    """Places where jobs can run."""


@hookspec
def palpate_scenarios() -> "Iterable[Scenario]":  # type: ignore[empty-body]
    """Named choices of channels and weights."""


@hookspec
def palpate_commands(app: "typer.Typer") -> None:
    """Add commands to the command line; called when it starts, with the Typer application."""
