"""What a plugin may import: this module and those named below. Nothing else of palpate is public.

Names are imported when they are first used: ``from palpate.api import Curve`` costs what ``Curve`` needs.
Public too are :mod:`palpate.testing` (contracts), :mod:`palpate.mechanics`, :mod:`palpate.mesh.specimens`,
:mod:`palpate.mesh` (the frame of a spot, the numbering of nodes, the shape functions),
:mod:`palpate.experiment.delimited` (text files of columns) and :mod:`palpate.executors.sandbox` (programs and functions
within limits of time and memory).

A plugin that needs this version or a newer one sets ``palpate_api = (1, 0)`` in its module; an older palpate
leaves it out with that reason.
"""

from typing import TYPE_CHECKING

from palpate import __version__ as __version__, hookimpl as hookimpl
from palpate.lazy_imports import deferred as deferred
from palpate.plugins.versions import API_VERSION as API_VERSION

# ruff: isort: off
if TYPE_CHECKING:
    # ---- Values of a study
    from palpate.domain.balanced_states import (
        POSE as POSE,
        STATE_COLUMNS as STATE_COLUMNS,
        WRENCH as WRENCH,
        BalancedStates as BalancedStates,
    )
    from palpate.domain.channels import (
        BALANCED as BALANCED,
        FORCE as FORCE,
        LATERAL_FORCE as LATERAL_FORCE,
        PRESS_AND_TWIST as PRESS_AND_TWIST,
        TILT_MOMENT as TILT_MOMENT,
        TORQUE as TORQUE,
    )
    from palpate.domain import (
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
        Normaliser as Normaliser,
        Parameter as Parameter,
        ParameterSpace as ParameterSpace,
        Prior as Prior,
        Protocol as Protocol,
        RegionMaterial as RegionMaterial,
        Relaxation as Relaxation,
        Response as Response,
        Scenario as Scenario,
        Simulation as Simulation,
        Spot as Spot,
        Status as Status,
        StudyTemplate as StudyTemplate,
        SurfaceStates as SurfaceStates,
        Tie as Tie,
        Waypoints as Waypoints,
        moving_span as moving_span,
    )
    from palpate.domain.waypoints import MOST_TILT_DEG as MOST_TILT_DEG, MOST_WAYPOINTS as MOST_WAYPOINTS

    from palpate.plugins.indenter import Sphere as Sphere

    # ---- Base classes, and what their methods return
    from palpate.plugins.execution import Executor as Executor
    from palpate.plugins.indenter import Indenter as Indenter
    from palpate.plugins.interfaces import (
        NO_FIELDS as NO_FIELDS,
        AnisotropicMaterial as AnisotropicMaterial,
        Array as Array,
        Component as Component,
        ExperimentLoader as ExperimentLoader,
        LimbSource as LimbSource,
        InputFile as InputFile,
        IsotropicMaterial as IsotropicMaterial,
        Material as Material,
        Sampler as Sampler,
        SetFilter as SetFilter,
        Settings as Settings,
        SettingsT as SettingsT,
        Solver as Solver,
    )
    from palpate.plugins.provides import Provides as Provides, provided_by_default as provided_by_default
    from palpate.plugins.motion import Motion as Motion
    from palpate.plugins.parametrisation import (
        Parametrisation as Parametrisation,
        SpotInputs as SpotInputs,
        at_spot as at_spot,
        for_each_spot as for_each_spot,
    )
    from palpate.plugins.search import (
        Asking as Asking,
        Evaluation as Evaluation,
        Search as Search,
        SearchSpace as SearchSpace,
        Trial as Trial,
    )
    from palpate.run.result_files import Files as Files
    from palpate.stages.stage import Run as Run, Stage as Stage, Summary as Summary
    from palpate.plugins.subcommands import (
        SubCommand as SubCommand,
    )
    from palpate.plugins.sections import (
        Bar as Bar,
        Block as Block,
        Facts as Facts,
        Figure as Figure,
        Fold as Fold,
        Heading as Heading,
        Lines as Lines,
        Listing as Listing,
        Paragraph as Paragraph,
        Picture as Picture,
        Section as Section,
        Shares as Shares,
        Step as Step,
        Table as Table,
        Word as Word,
    )
    from palpate.plugins.energy_form import (
        EnergyForm as EnergyForm,
        StandardMaterial as StandardMaterial,
    )
    from palpate.plugins.optional import (
        CurveWriter as CurveWriter,
        FileInspector as FileInspector,
        LoadingDrawer as LoadingDrawer,
        Verifier as Verifier,
    )
    from palpate.plugins.inspection import (
        InspectedTable as InspectedTable,
        Inspection as Inspection,
    )

    # ---- Settings
    from palpate.units import (
        Quantity as Quantity,
        convert as convert,
    )

    # ---- Errors by cause
    from palpate.errors import (
        CurveError as CurveError,
        ExecutorError as ExecutorError,
        LedgerError as LedgerError,
        MaterialError as MaterialError,
        MeshError as MeshError,
        NothingSelectableError as NothingSelectableError,
        PalpateError as PalpateError,
        ParameterError as ParameterError,
        PluginError as PluginError,
        SamplingError as SamplingError,
        ScoringError as ScoringError,
        SolverError as SolverError,
        StoppedError as StoppedError,
        StudyError as StudyError,
    )

    # ---- Executors
    from palpate.executors import (
        Batch as Batch,
        InProcess as InProcess,
        Limits as Limits,
        JobResult as JobResult,
        Pool as Pool,
        Processes as Processes,
        attempt as attempt,
        n_cores as n_cores,
    )
    from palpate.executors.attempts import (
        simulate_alone as simulate_alone,
    )
    from palpate.executors.pool import (
        packed_or_refused as packed_or_refused,
    )
    from palpate.executors.worker import (
        packed as packed,
    )

    # ---- Kernels of finite elements
    from palpate._core import (
        Deformation as Deformation,
        ElementBlock as ElementBlock,
        SparseFactor as SparseFactor,
    )

    # ---- Plugins and their code
    from palpate.plugins.catalogue import (
        Plugins as Plugins,
    )
    from palpate.plugins.guard import (
        answering_for as answering_for,
    )
    from palpate.plugins.registry import (
        FIRST_PARTY as FIRST_PARTY,
        load_file as load_file,
    )
    from palpate.plugins.fingerprints import (
        installed_code as installed_code,
    )

    # ---- Interpolation of results
    from palpate_certainty.gaussian_process import GaussianProcess as GaussianProcess

    # ---- Studies and runs, for commands
    from palpate.study.reading import (
        Study as Study,
        StudySpot as StudySpot,
        read_study as read_study,
    )
    from palpate.run.keys import (
        job_key as job_key,
    )
    from palpate.run.directory import (
        RunDirectory as RunDirectory,
    )
    from palpate_report.report_data import ReportData as ReportData
    from palpate_report.report_warnings import ReportWarning as ReportWarning
    from palpate_report.result import Report as Report, RunResult as RunResult
    from palpate.run.atomic_files import write_atomically as write_atomically
    from palpate.progress import (
        SILENT as SILENT,
        Progress as Progress,
    )
    from palpate.limb.loading import (
        check_limb as check_limb,
        load_limbs as load_limbs,
    )
    from palpate.simulation.jobs import (
        job_for as job_for,
        jobs as jobs,
        stored as stored,
    )
    from palpate.stages.pipeline import (
        check_study as check_study,
        run_study as run_study,
    )

    # ---- Commands
    from palpate.cli.listing import (
        RUN as RUN,
        examples as examples,
        name_of as name_of,
    )
    from palpate.cli.options import (
        AsJson as AsJson,
        OutFolder as OutFolder,
        StudyPath as StudyPath,
    )
    from palpate.cli.progress import (
        StageProgress as StageProgress,
    )
    from palpate.cli.session import (
        TEXT_WIDTH as TEXT_WIDTH,
        Session as Session,
        run_folder as run_folder,
    )

    # ---- Tables and figures
    from palpate_report.style import (
        STYLE as STYLE,
    )
    from palpate_report.table_files import (
        markdown as markdown,
    )

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__getattr__("__all__")})
