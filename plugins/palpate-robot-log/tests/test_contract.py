"""The loader of robot logs keeps the loaders' contract, and costs nothing before it loads."""

import subprocess
import sys
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

import polars as pl
import pytest

from palpate.plugins.interfaces import ExperimentLoader
from palpate.testing import LoaderContract
from palpate_robot_log import RobotLogLoader, RobotLogSettings

LOG = Path(str(files("palpate_robot_log") / "studies" / "robot-log" / "logs" / "simulated_p2.parquet"))
CHANNELS = {
    "time": "time_s",
    "position": {"columns": ["x_m", "y_m", "z_m"]},
    "orientation": {"columns": ["qx", "qy", "qz", "qw"]},
    "force": {"columns": ["fx_N", "fy_N", "fz_N"]},
    "moment": {"columns": ["tx_Nm", "ty_Nm", "tz_Nm"]},
}


@pytest.mark.slow
class TestRobotLog(LoaderContract):
    @pytest.fixture
    def loader(self) -> ExperimentLoader:
        return RobotLogLoader(RobotLogSettings.model_validate({"channels": CHANNELS}))

    @pytest.fixture
    def good_file(self, tmp_path: Path) -> Path:
        path = tmp_path / LOG.name
        path.write_bytes(LOG.read_bytes())
        return path

    @pytest.fixture
    def bad_files(self, tmp_path: Path) -> Sequence[Path]:
        """Half a press, one that never touches, one without a column, and one that is no log."""
        log = pl.read_parquet(LOG)
        corrupt = {
            "half.parquet": log[: len(log) // 4],
            "air.parquet": log[:50],
            "lacking.parquet": log.drop("qz"),
            "swapped.parquet": log.rename({"fx_N": "fz_N", "fz_N": "fx_N"}),
        }
        for name, frame in corrupt.items():
            frame.write_parquet(tmp_path / name)
        (tmp_path / "text.csv").write_text("nothing\nhere\n")
        return [*(tmp_path / name for name in corrupt), tmp_path / "text.csv"]


def test_who_lists_the_loaders_waits_for_none_of_what_they_use() -> None:
    """Half a second of every command, ``--help`` too."""
    code = "import sys, palpate_robot_log as e; e.palpate_experiment_loaders(); print(*sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"scipy", "polars", "matplotlib"} & set(found.stdout.split())
