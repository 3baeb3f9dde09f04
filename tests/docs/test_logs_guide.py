"""The guides on logs and loaders are true."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from palpate.domain.indenter import SphereSettings
from palpate.plugins.catalogue import Plugins
from palpate.study.model import ScoringTable, SpotTable
from palpate_robot_log import RobotLogLoader, RobotLogSettings
from palpate_robot_log.reading.channel_map import LogFiles

GUIDE = (Path(__file__).parents[2] / "docs" / "logs.md").read_text(encoding="utf-8")
LOADERS = (Path(__file__).parents[2] / "docs" / "loaders.md").read_text(encoding="utf-8")
LOADER, CONTRACT = re.findall(r"```python\n(.*?)```", LOADERS, flags=re.DOTALL)
READING, MACHINE, TURNING, FILES, SPOTS = map(
    tomllib.loads, re.findall(r"```toml\n(.*?)```", GUIDE, flags=re.DOTALL)
)


def test_the_loader_is_short_and_is_found(tmp_path: Path) -> None:
    assert len(LOADER.splitlines()) <= 40
    (tmp_path / "press_log.py").write_text(LOADER, encoding="utf-8")
    plugins = Plugins.load([tmp_path / "press_log.py"], entry_points=False)
    assert plugins.broken == ()
    good = tmp_path / "good.jsonl"
    good.write_text('{"um": 0, "mN": 0}\n{"um": 500, "mN": 40}\n')
    force = plugins.loaders["press_log"]().load(good)["force"]
    assert (force.abscissa.tolist(), force.ordinate.tolist()) == ([0.0, 0.5], [0.0, 0.04])
    assert force.std.tolist() == [0.02, 0.02]


@pytest.mark.slow
def test_the_loader_keeps_the_contract(tmp_path: Path) -> None:
    (tmp_path / "press_log.py").write_text(LOADER, encoding="utf-8")
    (tmp_path / "test_press_log.py").write_text(CONTRACT, encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--import-mode=prepend", "."]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    # As many as the contract has; what a loader that neither writes nor draws need not keep is skipped.
    assert int(re.search(r"\b(\d+) passed", done.stdout)[1]) >= 9, done.stdout


def test_the_tables_are_read() -> None:
    settings = READING["experiment"]["settings"]
    assert READING["experiment"]["loader"] == RobotLogLoader.name
    assert RobotLogSettings.model_validate(settings).gravity.method == "known"
    one, small = map(SpotTable.model_validate, SPOTS["spot"])
    assert [len(files) for files in (one.measured[""], small.measured[""])] == [3, 1]
    assert SphereSettings.model_validate(small.protocol.indenter.settings).radius == 5.0
    assert RobotLogSettings.model_validate(settings | small.settings).gravity.weight == pytest.approx(0.61)
    assert ScoringTable.model_validate(SPOTS["scoring"]).point_weighting == "std"


def test_the_map_of_a_testing_machine_is_the_proposed_one(tmp_path: Path) -> None:
    depth = np.concatenate([np.full(30, -2.0), np.linspace(-2.0, 8.0, 150), np.full(30, 8.0)])
    depth = np.concatenate([depth, depth[::-1]])
    noise = np.random.default_rng(1).normal(0.0, 0.01, depth.size)
    rows = zip(0.04 * np.arange(depth.size), depth + 2.0, depth.clip(0.0) ** 1.5 + noise, strict=True)
    table = "".join(",".join(f"{value:.6g}" for value in row) + "\n" for row in rows)
    (tmp_path / "log.csv").write_text("Time (s),Crosshead (mm),Load (N)\n" + table)
    proposed = tomllib.loads(RobotLogLoader.inspect(tmp_path / "log.csv").study_text)["experiment"]
    assert proposed["settings"]["channels"] == MACHINE["experiment"]["settings"]["channels"]
    force = RobotLogLoader(RobotLogSettings.model_validate(proposed["settings"])).load(tmp_path / "log.csv")[
        "force"
    ]
    assert force.ordinate[-1] == pytest.approx(8.0**1.5, rel=0.01)


def test_the_map_of_a_machine_that_turns_is_the_proposed_one(tmp_path: Path) -> None:
    """A press of 8 mm, then a turn to and fro by 20 degrees against 1.5 N·mm per degree."""
    down, turn = np.linspace(-2.0, 8.0, 150), 20.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, 300))
    parts = [(np.full(30, -2.0), 0.0), (down, 0.0), (np.full(30, 8.0), 0.0), (np.full(300, 8.0), turn)]
    parts += [(np.full(30, 8.0), 0.0), (down[::-1], 0.0), (np.full(30, -2.0), 0.0)]
    depth = np.concatenate([d for d, _ in parts])
    angle = np.concatenate([np.broadcast_to(a, d.shape) for d, a in parts])
    force, torque = depth.clip(0.0) ** 1.5, 1.5 * angle
    noise = np.random.default_rng(1).normal(0.0, [0.01, 0.1], (depth.size, 2))
    table = np.column_stack(
        [0.04 * np.arange(depth.size), depth + 2.0, force + noise[:, 0], angle, torque + noise[:, 1]]
    )
    names = "Time (s),Crosshead (mm),Load (N),Rotation (deg),Torque (N·mm)"
    rows = "".join(",".join(f"{value:.6g}" for value in row) + "\n" for row in table.tolist())
    (tmp_path / "log.csv").write_text(f"{names}\n{rows}", encoding="utf-8")
    proposed = tomllib.loads(RobotLogLoader.inspect(tmp_path / "log.csv").study_text)["experiment"]
    assert proposed["settings"]["channels"] == TURNING["experiment"]["settings"]["channels"]
    curves = RobotLogLoader(RobotLogSettings.model_validate(proposed["settings"])).load(tmp_path / "log.csv")
    assert curves["torque"].ordinate.max() == pytest.approx(30.0, rel=0.02)
    assert curves["torque"].abscissa[curves["torque"].ordinate.argmax()] == pytest.approx(20.0, abs=1.0)


def test_the_pictures_are_those_that_are_drawn() -> None:
    source = (
        Path(__file__).parents[2] / "plugins/palpate-robot-log/src/palpate_robot_log/pictures.py"
    ).read_text()
    listed = re.findall(r"^\| `(\d_\w+)`", GUIDE, flags=re.MULTILINE)
    assert listed == sorted(set(re.findall(r'folder / "(\d_\w+)\.png"', source)))


def test_names_of_two_files_are_those_of_the_command() -> None:
    files = LogFiles.model_validate(FILES["experiment"]["settings"]["files"])
    pose, wrench = re.search(r"experiment inspect (\S+pose\.csv) (\S+)", GUIDE).groups()
    assert files == LogFiles.of(Path(pose), Path(wrench))
