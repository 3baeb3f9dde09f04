"""TetGen: fast, for clean surfaces (AGPL, so an extra that the user installs)."""

import numpy as np

from palpate.api import FloatArray, IntArray
from palpate_limb.meshing.mesher import Mesher, MeshingTask


class TetGen(Mesher):
    """Constrained Delaunay tetrahedra (Si 2015); fills everything inside of the outermost surface."""

    name = "tetgen"
    needs = "tetgen"

    def fill(self, task: MeshingTask) -> tuple[FloatArray, IntArray]:
        """Points (n, 3) and tetrahedra (m, 4), of positive volume."""
        import tetgen

        body = tetgen.TetGen(task.points_mm, task.faces.astype(np.int32))
        done = body.tetrahedralize(
            plc=True,
            quality=True,
            minratio=1.5,
            mindihedral=10.0,
            maxvolume=float(task.sizes_mm.max()) ** 3 / 6.0,
            verbose=0,
        )
        return np.asarray(done[0], dtype=np.float64), np.asarray(done[1], dtype=np.int64)
