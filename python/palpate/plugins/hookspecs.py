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
    from palpate.domain import Channel, Scenario, StudyTemplate
    from palpate.domain.component import Component
    from palpate.domain.indenter import Indenter
    from palpate.domain.material import Material
    from palpate.plugins.commands import Command
    from palpate.plugins.execution import Executor
    from palpate.plugins.interfaces import ExperimentLoader, LimbSource, Sampler, SetFilter, Solver
    from palpate.plugins.motion import Motion
    from palpate.plugins.parametrisation import Parametrisation
    from palpate.plugins.score import Score
    from palpate.plugins.search import Search
    from palpate.plugins.sections import Section

hookspec = pluggy.HookspecMarker("palpate")


@hookspec
def palpate_studies() -> "Iterable[StudyTemplate]":  # type: ignore[empty-body]
    """Ready studies for ``palpate init``.

    Each is a folder inside the plugin, with a ``study.toml`` and the data that it names; it is
    copied whole.
    """


@hookspec
def palpate_channels() -> "Iterable[Channel]":  # type: ignore[empty-body]
    """Channels that curves may have, with the units and labels of their axes.

    A study may hold only curves of declared channels. The names of abscissa and ordinate end in
    the unit that loaders and solvers keep to: ``depth_mm``, ``force_N``. Where both are columns of a
    solver's equilibrium states, or ``observe`` makes the ordinate of such columns, the solver computes it.
    What a channel declares beyond its names is checked on every measured curve, whichever loader has read it.
    """


@hookspec
def palpate_experiment_loaders() -> "Iterable[type[ExperimentLoader]]":  # type: ignore[empty-body]
    """Readers of measured curves.

    A study names one under ``[experiment]``; its ``load`` is called for each file of each spot
    before anything is simulated.
    """


@hookspec
def palpate_limb_sources() -> "Iterable[type[LimbSource]]":  # type: ignore[empty-body]
    """Makers of meshes with regions.

    A study names one under ``[limb]``; its ``load`` is called once for each spot. The limb is
    checked (elements, regions, fixed nodes) before the first simulation.
    """


@hookspec
def palpate_indenters() -> "Iterable[type[Indenter]]":  # type: ignore[empty-body]
    """Rigid bodies that are pressed into the limb.

    A study names one as the ``shape`` of ``[protocol.indenter]``, whose other keys are its settings. It is
    given by its signed distance; normals and curvature follow.
    """


@hookspec
def palpate_motions() -> "Iterable[type[Motion]]":  # type: ignore[empty-body]
    """Motions of the indenter.

    A study names one as ``motion`` of ``[protocol]``, whose other keys are its settings. It gives the
    waypoints of a rigid motion, or loads to be reached.
    """


@hookspec
def palpate_materials() -> "Iterable[type[Material]]":  # type: ignore[empty-body]
    """Hyperelastic materials.

    A study gives each region one, with each parameter fixed or searched. An isotropic material is an
    energy of the principal stretches, an anisotropic one an energy of the deformation gradient.
    Stress, tangent and stability follow. ``palpate.api.Material`` is the type of both. The ``kind`` of a
    ``Parameter`` is ``modulus``, in a unit of pressure, or ``shape``, without unit or a time constant in s.
    """


@hookspec
def palpate_samplers() -> "Iterable[type[Sampler]]":  # type: ignore[empty-body]
    """Ways to draw a design.

    ``draw`` is called once for a study, for points of the unit cube that are then spread over the
    ranges of the parameters.
    """


@hookspec
def palpate_set_filters() -> "Iterable[type[SetFilter]]":  # type: ignore[empty-body]
    """Keepers of the parameter sets that make sense.

    Those that a study names under ``[sampling.filters]`` judge the whole design at once; a set is
    kept where all of them accept it.
    """


@hookspec
def palpate_solvers() -> "Iterable[type[Solver]]":  # type: ignore[empty-body]
    """Solvers.

    A study names one under ``[solver]``. It is pickled into worker processes; a job that fails is
    a status with a message, and its name, version, code and settings are part of each result's key.
    """


@hookspec
def palpate_scores() -> "Iterable[type[Score]]":  # type: ignore[empty-body]
    """Residuals of a simulated curve against a measured one.

    A study names one as ``score`` of ``[scoring]``, whose other keys are its settings; without a name it is
    ``nmse``. The sweep ranks its sets by Σ r², and the fit makes it least.
    """


@hookspec
def palpate_executors() -> "Iterable[type[Executor]]":  # type: ignore[empty-body]
    """Places where jobs can run.

    A study names one under ``[executor]``. Results are stored by the process that asks for them,
    so an executor only hands results back, one for each job, in any order.
    """


@hookspec
def palpate_parametrisations() -> "Iterable[type[Parametrisation]]":  # type: ignore[empty-body]
    """Parametrisations: names that a fit searches, and their meaning at each spot.

    A study names one under ``[fit]``; without a name it is the searched parameters of the materials
    and the names of ``[fit.searched]``.
    """


@hookspec
def palpate_searches() -> "Iterable[type[Search]]":  # type: ignore[empty-body]
    """Ways to find the parameters for which curves fit best.

    A study names one under ``[fit]``. It asks for points of the unit box and is given their
    residuals; these points are simulated where the study runs, and kept.
    """


@hookspec
def palpate_scenarios() -> "Iterable[Scenario]":  # type: ignore[empty-body]
    """Named choices of weights, of channels or of phases such as ``torque/unload``.

    A study lists the names of those to rank by under ``[selection]``; one sweep serves all.
    """


@hookspec
def palpate_stages() -> "Iterable[type[Component]]":  # type: ignore[empty-body]
    """Stages, from tables to tables: subclasses of ``palpate.api.Stage``.

    Each is a command; ``palpate run`` includes those that a study asks for with ``[stages.NAME]``, each after
    the stages that it needs. The core's come through this hook too. A plugin whose ``palpate_commands``
    has commands of their own lists its stages' commands there, with ``palpate.api.cli.stage_command``.
    """


@hookspec
def palpate_sections() -> "Iterable[type[Section]]":  # type: ignore[empty-body]
    """Sections of the report's page.

    A section is paragraphs, tables, figures as data, pictures and warnings: no markup and no script. Every
    one that is provided is shown where it has something to show; palpate-report's come through this hook too.
    Its ``palpate_report.testing.SectionContract`` tests one.
    """


@hookspec
def palpate_commands() -> "Iterable[Command]":  # type: ignore[empty-body]
    """Commands of their own, or of a stage, with the type of their ``--json`` output.

    A ``palpate.api.cli.Command`` is a Typer command with its place. Stages that take commands are
    ``palpate experiment`` and ``palpate limb``; a command of theirs that names suffixes is also called by a
    file alone: ``palpate limb arm.ply``.
    """
