"""Reading in the tests' own process."""

import pytest

from palpate_robot_log import robot_log
from palpate_robot_log.reading import assembly, inspection
from palpate_robot_log.reading.formats import read_here


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process of its own for each file takes longer than what is tested."""
    for module in (inspection, assembly, robot_log):
        monkeypatch.setattr(module, "read_log", read_here)
