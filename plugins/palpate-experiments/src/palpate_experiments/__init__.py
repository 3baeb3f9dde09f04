"""Loaders of measured curves, and ready studies on real rubber and silicone."""

from importlib.resources import files

from palpate import hookimpl
from palpate.domain import StudyTemplate
from palpate.interfaces import ExperimentLoader
from palpate_experiments.csv_loader import CsvLoader, CsvSettings
from palpate_experiments.robot_log import RobotLogLoader, RobotLogSettings

__all__ = ["CsvLoader", "CsvSettings", "RobotLogLoader", "RobotLogSettings"]


@hookimpl
def palpate_experiment_loaders() -> list[type[ExperimentLoader]]:
    """Provide the loaders of processed curves and of a robot's log."""
    return [CsvLoader, RobotLogLoader]


@hookimpl
def palpate_studies() -> list[StudyTemplate]:
    """Provide the two studies on measured data."""
    return [
        StudyTemplate(
            name="treloar",
            summary="Treloar's rubber in three modes: a fit to one of them misleads (measured)",
            directory=_directory("treloar"),
        ),
        StudyTemplate(
            name="ecoflex",
            summary="compression of five Ecoflex 00-50 cylinders (measured)",
            directory=_directory("ecoflex"),
        ),
    ]


def _directory(name: str) -> str:
    return str(files("palpate_experiments") / "studies" / name)
