"""Studies and runs, for commands: reading, simulating, and the tables of a run."""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.domain import (
        moving_span as moving_span,
    )
    from palpate.errors import (
        LedgerError as LedgerError,
        NothingSelectableError as NothingSelectableError,
        SamplingError as SamplingError,
        ScoringError as ScoringError,
        StoppedError as StoppedError,
    )
    from palpate.experiment.relaxation import (
        relaxation_of as relaxation_of,
    )
    from palpate.fingerprints import (
        installed_code as installed_code,
    )
    from palpate.limb.loading import (
        check_limb as check_limb,
        load_limbs as load_limbs,
        size_at_contact as size_at_contact,
    )
    from palpate.plugins.catalogue import (
        Plugins as Plugins,
    )
    from palpate.plugins.guard import (
        answering_for as answering_for,
    )
    from palpate.plugins.optional import (
        LoadingDrawer as LoadingDrawer,
        Verifier as Verifier,
    )
    from palpate.plugins.provides import (
        provided_by_default as provided_by_default,
    )
    from palpate.plugins.registry import (
        FIRST_PARTY as FIRST_PARTY,
        load_file as load_file,
    )
    from palpate.run.directory import (
        RunDirectory as RunDirectory,
        file_name as file_name,
    )
    from palpate.run.keys import (
        job_key as job_key,
    )
    from palpate.run.result_files import (
        Files as Files,
        parquet as parquet,
    )
    from palpate.scoring.scores import (
        Swept as Swept,
        at_measured as at_measured,
        residual_scale as residual_scale,
    )
    from palpate.scoring.selection import (
        objectives as objectives,
    )
    from palpate.simulation.jobs import (
        check_jobs as check_jobs,
        job_for as job_for,
        jobs as jobs,
        stored as stored,
    )
    from palpate.simulation.sweep import (
        Simulations as Simulations,
    )
    from palpate.stages.pipeline import (
        RunResult as RunResult,
        check_study as check_study,
        locked_run as locked_run,
        run_study as run_study,
    )
    from palpate.stages.saved_run import (
        SavedRun as SavedRun,
        open_run as open_run,
    )
    from palpate.stages.stage import (
        read_run as read_run,
    )
    from palpate.study.reading import (
        Study as Study,
        StudySpot as StudySpot,
        read_study as read_study,
    )
    from palpate.study.spots import (
        mesh_note as mesh_note,
    )
    from palpate.study.tool import (
        Tool as Tool,
        read_tool as read_tool,
    )

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__getattr__("__all__")})
