"""State of the process that plugins share is restored after each import and call."""

import os
from pathlib import Path

import numpy as np
import pytest

from palpate.plugins.catalogue import Plugins
from palpate.plugins.guard import answering_for
from palpate.testing import bench

from .conftest import Write


def test_an_import_and_a_call_leave_the_working_directory(write: Write) -> None:
    here = Path.cwd()
    text = "import os\nimport numpy\nos.chdir('/')\nnumpy.seterr(all='raise')\n"
    with np.errstate(all="ignore"):
        Plugins.load([write("moves", text)], entry_points=False)
        assert np.geterr()["over"] == "ignore"
    assert Path.cwd() == here
    with answering_for(bench.HalfSpace(), "moving"):
        os.chdir("/")
    assert Path.cwd() == here


def test_a_working_directory_that_was_removed_breaks_no_plugin(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plugin = write(
        "still", "from palpate import hookimpl\n@hookimpl\ndef palpate_materials():\n    return []\n"
    )
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    with answering_for(bench.HalfSpace(), "removing"):
        (tmp_path / "gone").rmdir()
    assert not Plugins.load([plugin], entry_points=False).broken
