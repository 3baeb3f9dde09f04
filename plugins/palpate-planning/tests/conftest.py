"""A study of one press, fitted, whose solver is in closed form."""

import shutil
from dataclasses import replace

import pytest

from palpate.stages import pipeline
from palpate.study.reading import read_study
from palpate.study.tool import read_tool

TOOL = """
[protocol]
indenter = { shape = "sphere", radius = "20 mm" }
depth = "1.5 mm"
friction = 0.5
"""


@pytest.fixture(scope="session")
def fitted(tmp_path_factory, one_press):
    """Folder of a study of one press and its run, to the end of its fit; and the plugins."""
    folder = tmp_path_factory.mktemp("one_press")
    study, plugins = one_press(folder, sampling={"n_sets": 0})
    pipeline.run_study(study, folder / "run", plugins)
    return folder, plugins


@pytest.fixture
def run(fitted, tmp_path):
    """Study, run directory and plugins, in a folder of the test."""
    folder, plugins = fitted
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    study = read_study(tmp_path / "study.toml", plugins)
    return replace(study, truth={"tissue.E": 0.07, "tissue.nu": 0.345}), tmp_path / "run", plugins


@pytest.fixture
def tool(run, tmp_path):
    """A larger sphere, read from its file."""
    file = tmp_path / "tool.toml"
    file.write_text(TOOL)
    return read_tool(file, run[0], run[2])
