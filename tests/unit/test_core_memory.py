"""A batch needs no more memory than its input and output.

It runs in a process of its own, which resets and reads the kernel's high-water mark.
"""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/clear_refs").exists(), reason="the high-water mark of memory is Linux's"
)

MEASURE = """
import gc
import numpy as np
from palpate import _core

def memory(name):
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) * 1024 for line in status if line.startswith(name))

def needed(call):
    gc.collect()
    with open("/proc/self/clear_refs", "w") as marks:
        marks.write("5")
    before = memory("VmRSS")
    out = call()
    return memory("VmHWM") - before, out

def ramp(n):
    x = np.arange(n, dtype=float)
    x *= 15.0 / (n - 1)
    return x
"""

MANY = """
n_sets, n = 1_000_000, 8
x, exp = ramp(n), ramp(n) ** 2
sim = np.empty((n_sets, n))
sim[:] = exp
sim *= np.linspace(0.5, 1.5, n_sets)[:, None]
path = _core.Measured(x, exp).along(x)
extra, (nmse, coverage) = needed(lambda: path.score(sim))
assert np.isfinite(nmse).all() and (coverage == 1.0).all()
print(extra, nmse.nbytes + coverage.nbytes)
"""

SLACK_BYTES = 16e6
"""Python's own."""


def test_memory_is_bounded_by_input_and_output() -> None:
    done = subprocess.run([sys.executable, "-c", MEASURE + MANY], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    extra, allowed = map(int, done.stdout.split())
    assert extra < allowed + SLACK_BYTES
