"""State of the process that plugins share is restored after each import and call."""

import os
from pathlib import Path

import numpy as np

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
