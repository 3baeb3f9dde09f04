"""Gmsh: fills a clean surface at the sizes of the field (GPL, so an extra that the user installs)."""

import numpy as np

from palpate.api import FloatArray, IntArray
from palpate_limb.meshing.mesher import Mesher, MeshingTask


class Gmsh(Mesher):
    """Delaunay tetrahedra behind the surface's own triangles."""

    name = "gmsh"
    needs = "gmsh"

    def fill(self, task: MeshingTask) -> tuple[FloatArray, IntArray]:
        """Points (n, 3) and tetrahedra (m, 4), of positive volume."""
        import gmsh
        from scipy.interpolate import NearestNDInterpolator

        if task.nested:
            raise ValueError("gmsh is given one closed surface here; use ftetwild for layers")
        size = NearestNDInterpolator(task.size_points_mm, task.sizes_mm)
        gmsh.initialize()
        try:
            gmsh.option.setNumber("General.Terminal", 0)
            surface = gmsh.model.addDiscreteEntity(2)
            gmsh.model.mesh.addNodes(
                2, surface, list(range(1, len(task.points_mm) + 1)), task.points_mm.ravel()
            )
            gmsh.model.mesh.addElementsByType(surface, 2, [], (task.faces + 1).ravel())
            gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop([surface])])
            gmsh.model.geo.synchronize()
            gmsh.model.mesh.setSizeCallback(lambda _d, _t, x, y, z, _l: float(size(x, y, z)))
            gmsh.model.mesh.generate(3)
            tags, points, _ = gmsh.model.mesh.getNodes()
            _, nodes = gmsh.model.mesh.getElementsByType(4)
        finally:
            gmsh.finalize()
        row = np.zeros(int(tags.max()) + 1, dtype=np.int64)
        row[tags] = np.arange(len(tags))
        return np.asarray(points).reshape(-1, 3), row[nodes].reshape(-1, 4)
