"""Runs that are killed lose nothing: a few of the kills of ``make chaos``."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

KILLS = Path(__file__).parents[2] / "chaos" / "kills.py"


pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="kills forks of itself")


def counts(*given: str) -> dict[str, int]:
    """Counts of kills and losses; the script ends with an error where something was lost."""
    command = [sys.executable, str(KILLS), *given]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads(done.stdout)
    assert [found[bad] for bad in ("lost", "twice", "other bytes", "orphans")] == [0, 0, 0, 0]
    return found


def test_a_run_that_is_killed_at_a_write_continues_to_the_same_bytes():
    found = counts("--random", "0", "--workers", "0", "--first", "60", "--most", "1")
    assert found["killed"] == 1


@pytest.mark.slow
def test_no_kill_costs_what_was_finished():
    found = counts("--random", "3", "--workers", "1", "--first", "40", "--stride", "60", "--most", "3")
    assert found["kills random"] == 3
    assert found["killed"] == 3
    assert found["kills in the fit"] == 2
    assert found["workers seen"] >= 1
