"""Studies and runs, for commands: reading, simulating, and the tables of a run."""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.domain import FINE as FINE, moving_span as moving_span
    from palpate.errors import NothingSelectableError as NothingSelectableError
    from palpate.experiment.cycles import cycle_warnings as cycle_warnings
    from palpate.experiment.measured import measured_warnings as measured_warnings
    from palpate.experiment.relaxation import REMEDY as REMEDY, relaxation_of as relaxation_of
    from palpate.fingerprints import installed_code as installed_code
    from palpate.limb.checks import check_limb as check_limb
    from palpate.limb.loading import (
        fine_edge_mm as fine_edge_mm,
        finer_limb as finer_limb,
        limb_warnings as limb_warnings,
        load_limbs as load_limbs,
        press_warnings as press_warnings,
        size_at_contact as size_at_contact,
    )
    from palpate.plugins.catalogue import Plugins as Plugins
    from palpate.plugins.guard import answering_for as answering_for
    from palpate.plugins.optional import (
        LoadingDrawer as LoadingDrawer,
        RangeProposer as RangeProposer,
        Verifier as Verifier,
    )
    from palpate.plugins.provides import provided_by_default as provided_by_default
    from palpate.plugins.registry import load_file as load_file, plugin_source as plugin_source
    from palpate.plugins.versions import FIRST_PARTY as FIRST_PARTY
    from palpate.run.directory import RESULT as RESULT, RunDirectory as RunDirectory, file_name as file_name
    from palpate.run.fit_state import read_fit_state as read_fit_state
    from palpate.run.keys import job_key as job_key
    from palpate.run.ledger import Ledger as Ledger
    from palpate.run.lock import living_runner_of as living_runner_of
    from palpate.run.ownership import is_run as is_run, keep_only as keep_only
    from palpate.run.result import FIRST_ANSWER as FIRST_ANSWER, StudyInputs as StudyInputs
    from palpate.run.result_files import Files as Files, parquet as parquet
    from palpate.run.tables import (
        ASSESSED as ASSESSED,
        OF_A_FIT as OF_A_FIT,
        SEARCHED as SEARCHED,
        common as common,
    )
    from palpate.scoring.completeness import (
        Completeness as Completeness,
        completeness as completeness,
        described as described,
        without_result as without_result,
    )
    from palpate.scoring.scores import (
        Swept as Swept,
        at_measured as at_measured,
        score as score,
        scored_points as scored_points,
    )
    from palpate.scoring.selection import (
        by_reason as by_reason,
        failures as failures,
        objectives as objectives,
        unranked as unranked,
    )
    from palpate.simulation.cost import n_workers as n_workers
    from palpate.simulation.forecast import Forecast as Forecast, Part as Part, work_of as work_of
    from palpate.simulation.jobs import (
        check_jobs as check_jobs,
        job_for as job_for,
        jobs as jobs,
        stored as stored,
    )
    from palpate.simulation.processor_time import processor_time as processor_time
    from palpate.simulation.sweep import Simulations as Simulations
    from palpate.stages.core_stages import best_sets as best_sets, fit_so_far as fit_so_far
    from palpate.stages.pipeline import (
        RunResult as RunResult,
        check_study as check_study,
        locked_run as locked_run,
        parts_of as parts_of,
        run_stage as run_stage,
        run_study as run_study,
    )
    from palpate.stages.stage import read_run as read_run
    from palpate.study.checks import unedited_warnings as unedited_warnings
    from palpate.study.display_units import in_units as in_units, unit_factors as unit_factors
    from palpate.study.reading import (
        Study as Study,
        StudySpot as StudySpot,
        read_options as read_options,
        read_study as read_study,
    )
    from palpate.study.spots import mesh_note as mesh_note
    from palpate.study.tool import Tool as Tool, read_tool as read_tool

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
    __dir__ = __getattr__("__dir__")
