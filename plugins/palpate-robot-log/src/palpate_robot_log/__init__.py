"""The loader of a robot's logs, and ready studies on such logs.

Names are imported when they are first used: the process that reads a log
imports this package too, and does not need the loader.
"""

from importlib.resources import files
from typing import TYPE_CHECKING

from palpate.api import deferred, hookimpl

if TYPE_CHECKING:
    from palpate.api import ExperimentLoader, StudyTemplate
    from palpate_robot_log.robot_log import (
        ColumnsLoader as ColumnsLoader,
        ColumnsSettings as ColumnsSettings,
        RobotLogLoader as RobotLogLoader,
        RobotLogSettings as RobotLogSettings,
    )

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)


@hookimpl
def palpate_experiment_loaders() -> "list[type[ExperimentLoader]]":
    """Provide the loaders of a robot's log, and of curves in files of columns."""
    from palpate_robot_log.robot_log import ColumnsLoader, RobotLogLoader

    return [RobotLogLoader, ColumnsLoader]


@hookimpl
def palpate_studies() -> "list[StudyTemplate]":
    """Provide studies on a robot's logs."""
    from palpate.api import StudyTemplate

    summaries = {
        "robot-log": "the forearm phantom at four spots, from a robot's logs (simulated)",
        "forearm-relaxing": "a forearm that relaxes, from a robot's logs at two rates; minutes (simulated)",
    }
    folder = files("palpate_robot_log") / "studies"
    return [
        StudyTemplate(name=name, summary=summary, directory=str(folder / name))
        for name, summary in summaries.items()
    ]
