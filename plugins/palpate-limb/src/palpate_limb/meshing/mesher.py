"""What a mesher is: it fills surfaces with tetrahedra, in a process of its own.

A mesher may loop for ever or end its process on surfaces that it cannot take.
"""

import importlib
import os
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, ParamSpec, TypeVar

import numpy as np

from palpate.api import FloatArray, IntArray, MeshError, PluginError
from palpate.sandbox import Limits, run_function

P = ParamSpec("P")
T = TypeVar("T")

MESHERS: Mapping[str, str] = MappingProxyType(
    {
        "ftetwild": "palpate_limb.meshing.ftetwild:FTetWild",
        "tetgen": "palpate_limb.meshing.tetgen_mesher:TetGen",
        "gmsh": "palpate_limb.meshing.gmsh_mesher:Gmsh",
    }
)
"""Class of each mesher as module:class; a mesher from elsewhere is named in the same way."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeshingTask:
    """Surfaces to fill and sizes to respect.

    Parameters
    ----------
    points_mm : (n, 3) array
    faces : (m, 3) integer array
        Of all surfaces: the body's, and those that elements must follow inside of it.
    nested : bool
        There are surfaces inside of the body. Then everything within the box may
        be filled: the caller keeps what is in the body.
    size_points_mm, size_cells, sizes_mm
        Edge lengths (k,) at the points (k, 3) of a grid of tetrahedra (l, 4).
    tolerance_mm : float
        How far the mesh's surface may stray.
    """

    points_mm: FloatArray
    faces: IntArray
    nested: bool
    size_points_mm: FloatArray
    size_cells: IntArray
    sizes_mm: FloatArray
    tolerance_mm: float


class Mesher(ABC):
    """Fills surfaces with tetrahedra."""

    name: ClassVar[str]
    needs: ClassVar[str]
    """The distribution that does the work."""

    @abstractmethod
    def fill(self, task: MeshingTask) -> tuple[FloatArray, IntArray]:
        """Points (n, 3) and tetrahedra (m, 4), of positive volume."""


def run_mesher(mesher: str, task: MeshingTask, time_limit_s: float) -> tuple[FloatArray, IntArray]:
    """Let a mesher work in a process of its own.

    Parameters
    ----------
    mesher : str
        A key of ``MESHERS``, or ``module:class``.
    task : MeshingTask
    time_limit_s : float

    Raises
    ------
    PluginError
        No such mesher, or what it needs is not installed.
    MeshError
        It failed, took too long, or filled nothing.
    """
    target = MESHERS.get(mesher, mesher)
    if ":" not in target:
        raise PluginError(
            f"no mesher '{mesher}' (there: {', '.join(MESHERS)}); choose one, or name module:class"
        )
    points, tets = run_tool(f"mesher '{mesher}'", time_limit_s, _filled, target, task)
    if not len(tets):
        raise MeshError(f"mesher '{mesher}' filled nothing; check that the surfaces are closed and outward")
    return points, np.asarray(tets, dtype=np.int64)


def _filled(target: str, task: MeshingTask) -> tuple[FloatArray, IntArray]:
    module, _, name = target.partition(":")
    mesher = getattr(importlib.import_module(module), name)()
    if not isinstance(mesher, Mesher):
        raise PluginError(f"{target} is no Mesher; derive it from palpate_limb.meshing.Mesher")
    os.chdir(tempfile.gettempdir())  # fTetWild leaves files where it runs
    return mesher.fill(task)


def run_tool(
    what: str, time_limit_s: float, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs
) -> T:
    """Call a function in a process of its own.

    Parameters
    ----------
    what : str
        As messages call it.
    time_limit_s : float
    function : callable

    Raises
    ------
    PluginError
        What it needs is not installed.
    MeshError
        It failed, or took too long.
    """
    try:
        return run_function(Limits(time_s=time_limit_s), function, *args, **kwargs)
    except ImportError as error:
        raise PluginError(f"{what}: {error}; install it, e.g. pip install 'palpate-limb[all]'") from None
    except (ChildProcessError, MemoryError) as error:
        raise MeshError(
            f"{what} failed ({error}); check the surfaces, coarsen the mesh, raise the time limit, or use "
            "another mesher"
        ) from None
