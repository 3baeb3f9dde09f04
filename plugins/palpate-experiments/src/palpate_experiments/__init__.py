"""Loaders of measured curves, and ready studies on real rubber and silicone and on a robot's logs.

Names are imported when they are first used: the process that reads a stranger's log
imports this package too, and needs neither the loaders nor what they are made of.
"""

from importlib.resources import files
from typing import TYPE_CHECKING

from palpate import hookimpl
from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.domain import StudyTemplate
    from palpate.plugins.interfaces import ExperimentLoader
    from palpate_experiments.csv_loader import CsvLoader, CsvSettings
    from palpate_experiments.robot_log import RobotLogLoader, RobotLogSettings

__all__ = ["CsvLoader", "CsvSettings", "RobotLogLoader", "RobotLogSettings"]

__getattr__ = deferred(
    __name__,
    {
        "CsvLoader": "csv_loader",
        "CsvSettings": "csv_loader",
        "RobotLogLoader": "robot_log",
        "RobotLogSettings": "robot_log",
    },
)


@hookimpl
def palpate_experiment_loaders() -> "list[type[ExperimentLoader]]":
    """Provide the loaders of processed curves and of a robot's log."""
    from palpate_experiments.csv_loader import CsvLoader
    from palpate_experiments.robot_log import RobotLogLoader

    return [CsvLoader, RobotLogLoader]


@hookimpl
def palpate_studies() -> "list[StudyTemplate]":
    """Provide two studies on measured data, and one on a robot's logs."""
    from palpate.domain import StudyTemplate

    return [
        StudyTemplate(
            name="treloar",
            summary="Treloar's rubber in three modes, one of which misleads; half a minute (measured)",
            directory=_directory("treloar"),
        ),
        StudyTemplate(
            name="ecoflex",
            summary="compression of five Ecoflex 00-50 cylinders (measured)",
            directory=_directory("ecoflex"),
        ),
        StudyTemplate(
            name="robot-log",
            summary="the forearm phantom at four spots, from a robot's logs (simulated)",
            directory=_directory("robot-log"),
        ),
    ]


def _directory(name: str) -> str:
    return str(files("palpate_experiments") / "studies" / name)
