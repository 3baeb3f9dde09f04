"""The process that reads a mesh file: a request on stdin, one line of JSON and a NumPy archive back."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import MeshError
from palpate.sandbox import allow_only, limit_resources
from palpate_forearm.mesh_files import MeshFile, read_here

ARRAYS = "mesh.npz"


def main() -> None:
    """Read the file that the request names, within its limits."""
    asked = json.load(sys.stdin)
    path, scratch = Path(asked["path"]), Path(asked["scratch"])
    limit_resources(asked["memory_mb"], asked["time_s"], asked["memory_mb"])
    allow_only([path.parent, path.resolve().parent], scratch)
    try:
        answer = save(read_here(path), scratch / ARRAYS)
    except MeshError as error:
        answer = {"error": str(error)}
    except MemoryError:
        most = f"{asked['memory_mb']:g} MB"
        answer = {"error": f"{path}: reading it needs more than {most} of memory; use a smaller mesh"}
    try:
        print(json.dumps(answer), flush=True)  # noqa: T201 - the answer
    except BrokenPipeError:  # who asked was killed, and cannot remove the folder
        shutil.rmtree(scratch, ignore_errors=True)


def save(mesh: MeshFile, path: Path) -> dict[str, object]:
    """Write the arrays of a mesh, and say which is which."""
    arrays: list[NDArray[np.generic]] = []

    def place(array: NDArray[np.generic]) -> int:
        arrays.append(array)
        return len(arrays) - 1

    numbers = "biufSU"  # whatever else NumPy would have to unpickle
    head: dict[str, object] = {
        "points": place(mesh.points),
        "blocks": [[kind, place(cells)] for kind, cells in mesh.blocks],
        "point_data": {k: place(v) for k, v in mesh.point_data.items() if v.dtype.kind in numbers},
        "cell_data": {
            k: [place(v) for v in blocks]
            for k, blocks in mesh.cell_data.items()
            if all(v.dtype.kind in numbers for v in blocks)
        },
        "point_sets": {k: place(v) for k, v in mesh.point_sets.items()},
        "cell_sets": {k: [place(v) for v in blocks] for k, blocks in mesh.cell_sets.items()},
    }
    np.savez(path, *arrays)
    return head
