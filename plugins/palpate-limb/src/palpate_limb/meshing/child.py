"""The process in which a mesher works: reads arrays, writes arrays."""

import importlib
import sys
from pathlib import Path

import numpy as np

from palpate_limb.meshing.in_child import NOT_INSTALLED, ChildWork, save_arrays


def main(target: str, given: str, made: str) -> int:
    """Let a class work on the arrays in one file, and write what it makes to another."""
    module, _, name = target.partition(":")
    try:
        worker = getattr(importlib.import_module(module), name)()
        if not isinstance(worker, ChildWork):
            raise TypeError(f"{target} is no Mesher")
        with np.load(given) as arrays:
            result = worker.work(dict(arrays))
    except ImportError as error:
        print(f"mesher {target}: {error}; install it, e.g. pip install 'palpate-limb[all]'", file=sys.stderr)  # noqa: T201
        return NOT_INSTALLED
    save_arrays(Path(made), result)
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
