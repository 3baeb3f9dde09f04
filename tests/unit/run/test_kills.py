"""Runs that are killed lose nothing: a few of the kills of ``make chaos``."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

KILLS = Path(__file__).parents[2] / "chaos" / "kills.py"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="kills forks of itself")
def test_no_kill_costs_what_was_finished():
    given = [sys.executable, str(KILLS), "--random", "5", "--workers", "1", "--stride", "90"]
    done = subprocess.run(given, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    counts = json.loads(done.stdout)
    assert counts["kills random"] == 5
    assert counts["kills at writes"] >= 3
    assert counts["kills in the fit"] == 2
    assert counts["workers seen"] >= 1
    assert [counts[bad] for bad in ("lost", "twice", "other bytes", "orphans")] == [0, 0, 0, 0]
