"""The process in which a mesher works: reads a task, writes a mesh."""

import importlib
import sys

import numpy as np

from palpate_limb.meshing.mesher import Mesher, MeshingTask

NOT_INSTALLED = 3


def main(target: str, given: str, made: str) -> int:
    """Mesh the task in one file and write the mesh to another."""
    module, _, name = target.partition(":")
    try:
        mesher = getattr(importlib.import_module(module), name)()
        if not isinstance(mesher, Mesher):
            raise TypeError(f"{target} is no Mesher")
        with np.load(given) as arrays:
            task = MeshingTask(
                points_mm=arrays["points_mm"],
                faces=arrays["faces"],
                nested=bool(arrays["nested"]),
                size_points_mm=arrays["size_points_mm"],
                size_cells=arrays["size_cells"],
                sizes_mm=arrays["sizes_mm"],
                tolerance_mm=float(arrays["tolerance_mm"]),
            )
        points, tets = mesher.fill(task)
    except ImportError as error:
        print(f"mesher {target}: {error}; install it, e.g. pip install 'palpate-limb[all]'", file=sys.stderr)  # noqa: T201
        return NOT_INSTALLED
    np.savez(made, points_mm=points, tets=tets)
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
