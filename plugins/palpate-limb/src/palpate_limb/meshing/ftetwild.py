"""fTetWild: takes any triangles, and keeps to them within a tolerance."""

import importlib.machinery
import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np

from palpate.api import FloatArray, IntArray
from palpate_limb.meshing.mesher import Mesher, MeshingTask

STOP_ENERGY = 10.0
"""Elements are improved, and sizes met, until the worst has this AMIPS energy; a regular one has 3."""
N_ROUNDS = 60


class FTetWild(Mesher):
    """Fast tetrahedral meshing in the wild (Hu et al. 2020), as pytetwild ships it."""

    name = "ftetwild"
    needs = "pytetwild"

    def fill(self, task: MeshingTask) -> tuple[FloatArray, IntArray]:
        """Points (n, 3) and tetrahedra (m, 4), of positive volume."""
        diagonal = float(np.linalg.norm(np.ptp(task.points_mm, axis=0)))
        points, tets = _extension().tetrahedralize_mesh(
            np.ascontiguousarray(task.points_mm, dtype=np.float64),
            np.ascontiguousarray(task.faces, dtype=np.uint32),
            True,  # optimise
            True,  # skip the simplification: the surfaces come simplified
            0.05,
            float(task.sizes_mm.max()),
            task.tolerance_mm / diagonal,
            STOP_ENERGY,
            False,  # coarsen
            1,  # threads
            N_ROUNDS,
            6,  # log level
            True,  # quiet
            True,  # VTK's order: positive volumes
            task.nested,  # keep everything
            np.ascontiguousarray(task.size_points_mm, dtype=np.float64),
            np.ascontiguousarray(task.size_cells, dtype=np.int32),
            np.ascontiguousarray(task.sizes_mm, dtype=np.float64),
        )
        return np.asarray(points, dtype=np.float64), np.asarray(tets, dtype=np.int64)


def _extension() -> ModuleType:
    """The compiled part of pytetwild alone: the package imports PyVista, with half a gigabyte of VTK."""
    package = importlib.util.find_spec("pytetwild")
    folders = [] if package is None else list(package.submodule_search_locations or [])
    for folder in folders:
        for suffix in importlib.machinery.EXTENSION_SUFFIXES:
            path = Path(folder) / f"PyfTetWildWrapper{suffix}"
            spec = (
                importlib.util.spec_from_file_location("PyfTetWildWrapper", path) if path.is_file() else None
            )
            if spec is not None and spec.loader is not None:
                module = importlib.util.module_from_spec(spec)
                spec.loader.exec_module(module)
                return module
    raise ImportError("pytetwild is missing")
