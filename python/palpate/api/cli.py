"""Commands: the session, its options and its progress."""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.cli.limb import look_into_mesh as look_into_mesh
    from palpate.cli.options import (
        RUN as RUN,
        STAGES as STAGES,
        AsJson as AsJson,
        OutFolder as OutFolder,
        RunPath as RunPath,
        RunPaths as RunPaths,
        StudyPath as StudyPath,
        Tables as Tables,
        TrustPlugins as TrustPlugins,
        examples as examples,
    )
    from palpate.cli.output import (
        Closed as Closed,
        IntervalOutput as IntervalOutput,
        Row as Row,
        RunOutput as RunOutput,
    )
    from palpate.cli.progress import StageProgress as StageProgress
    from palpate.cli.results import show_summary as show_summary
    from palpate.cli.run import run_and_show as run_and_show
    from palpate.cli.runs import (
        find_run as find_run,
        is_study as is_study,
        newest_run as newest_run,
        original_study as original_study,
        study_of_run as study_of_run,
    )
    from palpate.cli.session import TEXT_WIDTH as TEXT_WIDTH, Session as Session, run_folder as run_folder
    from palpate.cli.stages import stage_command as stage_command
    from palpate.plugins.commands import Command as Command

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
    __dir__ = __getattr__("__dir__")
