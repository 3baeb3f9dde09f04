"""The toy study, as files that a test may change."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from palpate.cli.app import main

TOY = Path(__file__).parents[1] / "data" / "toy"
PLUGIN = str(TOY / "toy_plugin.py")
Call = Callable[..., Any]


def copied_study(folder: Path) -> Path:
    """Copy the files of the toy study into a new folder."""
    folder.mkdir()
    for name in ("study.toml", "s1.txt", "s2.txt"):
        (folder / name).write_bytes((TOY / name).read_bytes())
    return folder


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """Copy of the toy study."""
    return copied_study(tmp_path / "study")


@pytest.fixture(scope="session")
def whole_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run of the toy study, made once: to read; it is as deep as the folders of the tests."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("palpate_report.from_run.write_figures", lambda content, folder: ())
        assert main(["--plugin", PLUGIN, "run", str(copied_study(folder / "study"))]) == 0
    return folder / "runs" / "toy"


@pytest.fixture(scope="session")
def run_without_sweep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run of the toy study without a sweep, made once with its figures: to read."""
    folder = tmp_path_factory.mktemp("unswept")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        study = copied_study(folder / "study")
        edit(study, "n_sets = 20", "n_sets = 0")
        assert main(["--plugin", PLUGIN, "run", str(study)]) == 0
    return folder / "runs" / "toy"


@pytest.fixture
def ran(study: Path, whole_run: Path, tmp_path: Path) -> Path:
    """Copy of the run of the study, which a test may change."""
    return shutil.copytree(whole_run, tmp_path / "runs" / "toy")


def edit(study: Path, old: str, new: str) -> None:
    """Replace a text of a study."""
    path = study / "study.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
