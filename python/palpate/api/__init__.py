"""Names that plugins may import, here and in the submodules. Nothing else of palpate is public.

Here are the values of a study, the base classes of what a plugin provides, and errors. Submodules:
:mod:`palpate.api.experiment`, :mod:`palpate.api.mesh`, :mod:`palpate.api.mechanics`,
:mod:`palpate.api.scores`, :mod:`palpate.api.executors`, :mod:`palpate.api.fit`, :mod:`palpate.api.runs`,
:mod:`palpate.api.report`, :mod:`palpate.api.files` and :mod:`palpate.api.cli`; and the contracts,
:mod:`palpate.testing`. Names are imported when they are first used: ``from palpate.api import Curve`` costs
what ``Curve`` needs.

A plugin that needs this version or a newer one sets ``palpate_api = (1, 0)`` in its module; an older palpate
leaves it out with that reason.
"""

from typing import TYPE_CHECKING

from palpate import __version__ as __version__, hookimpl as hookimpl
from palpate.lazy_imports import deferred as deferred
from palpate.plugins.versions import API_VERSION as API_VERSION

if TYPE_CHECKING:
    from palpate.domain import (
        COMPLIANCE as COMPLIANCE,
        DEEPER as DEEPER,
        FRICTION as FRICTION,
        BoolArray as BoolArray,
        Channel as Channel,
        Curve as Curve,
        Design as Design,
        FloatArray as FloatArray,
        HomogeneousTests as HomogeneousTests,
        Indentation as Indentation,
        IntArray as IntArray,
        Job as Job,
        Limb as Limb,
        Mesh as Mesh,
        MeshConvergence as MeshConvergence,
        Parameter as Parameter,
        ParameterName as ParameterName,
        ParameterSpace as ParameterSpace,
        Protocol as Protocol,
        Refinement as Refinement,
        RegionMaterial as RegionMaterial,
        Relaxation as Relaxation,
        Response as Response,
        Scenario as Scenario,
        Simulation as Simulation,
        Spot as Spot,
        Status as Status,
        StudyTemplate as StudyTemplate,
        SurfaceStates as SurfaceStates,
        Waypoints as Waypoints,
    )
    from palpate.domain.channels import (
        EQUILIBRIUM_CHANNELS as EQUILIBRIUM_CHANNELS,
        FORCE as FORCE,
        LATERAL_FORCE as LATERAL_FORCE,
        PRESS_AND_TWIST as PRESS_AND_TWIST,
        TORQUE as TORQUE,
    )
    from palpate.domain.component import (
        NO_FIELDS as NO_FIELDS,
        Component as Component,
        InputFile as InputFile,
        Settings as Settings,
        SettingsT as SettingsT,
    )
    from palpate.domain.indenter import Indenter as Indenter, Sphere as Sphere
    from palpate.domain.material import (
        AnisotropicMaterial as AnisotropicMaterial,
        IsotropicMaterial as IsotropicMaterial,
        Material as Material,
    )
    from palpate.domain.relaxing import (
        RelaxingMaterial as RelaxingMaterial,
        checked_times as checked_times,
        relaxed_share as relaxed_share,
        relaxing as relaxing,
        time_name as time_name,
    )
    from palpate.errors import (
        CurveError as CurveError,
        MaterialError as MaterialError,
        MeshError as MeshError,
        PalpateError as PalpateError,
        ParameterError as ParameterError,
        PluginError as PluginError,
        ScoringError as ScoringError,
        SolverError as SolverError,
        StudyError as StudyError,
        typed as typed,
    )
    from palpate.plugins.interfaces import (
        ExperimentLoader as ExperimentLoader,
        LimbSource as LimbSource,
        Sampler as Sampler,
        SetFilter as SetFilter,
        Solver as Solver,
    )
    from palpate.plugins.motion import Motion as Motion
    from palpate.plugins.provides import Provides as Provides
    from palpate.plugins.sections import Summary as Summary
    from palpate.plugins.table import OF_ROW as OF_ROW, StageTable as StageTable, TableColumn as TableColumn
    from palpate.progress import SILENT as SILENT, Progress as Progress, about as about
    from palpate.stages.stage import Run as Run, Stage as Stage
    from palpate.units import Quantity as Quantity, convert as convert

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
    __dir__ = __getattr__("__dir__")
