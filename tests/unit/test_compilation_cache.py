"""What JAX compiled stays on disk, and may be damaged or missing."""

import os
import subprocess
import sys

import pytest

RUN = """
import numpy as np
from palpate.mechanics import initial_moduli
from palpate_materials.uncoupled import Ogden
print([float(m).hex() for m in initial_moduli(Ogden(), np.array([0.06, 3.0, 1.0]))])
"""


def moduli(home):
    """Moduli that a new process computes with a home of its own; every warning is an error there."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
    command = [sys.executable, "-W", "error", "-c", RUN]
    environment = kept | {"XDG_CACHE_HOME": str(home), "LOCALAPPDATA": str(home), "HOME": str(home)}
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout


@pytest.mark.slow
def test_a_kept_compilation_is_used_and_a_damaged_one_is_not(tmp_path):
    first = moduli(tmp_path)
    kept = sorted(tmp_path.rglob("jit__rest-*"))
    assert kept
    written = [path.stat().st_mtime_ns for path in kept]
    assert moduli(tmp_path) == first
    assert sorted(tmp_path.rglob("jit__rest-*")) == kept
    assert [path.stat().st_mtime_ns for path in kept] == written
    whole = {path: path.read_bytes() for path in kept}
    for path in kept:
        path.write_bytes(path.read_bytes()[:50])
    assert moduli(tmp_path) == first
    assert all(len(path.read_bytes()) > 0.9 * len(content) for path, content in whole.items())  # replaced


@pytest.mark.slow
def test_a_home_that_is_no_folder_costs_nothing_but_time(tmp_path):
    home = tmp_path / "home"
    home.write_text("")
    assert moduli(home) == moduli(tmp_path)
