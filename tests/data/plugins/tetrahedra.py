"""A limb source whose meshes can be refined."""

from dataclasses import replace

from palpate.api import LimbSource, hookimpl
from palpate.mesh.specimens.blocks import block


class Tetrahedra(LimbSource):
    """A block of tetrahedra, whatever the file holds."""

    name = "tetrahedra"
    summary = "a block of tetrahedra"

    def load(self, path, spot):
        limb = block("tet10", n_across=4, n_down=2)
        return replace(limb, spot=spot, mesh=replace(limb.mesh, regions=("tissue",)))


@hookimpl
def palpate_limb_sources():
    return [Tetrahedra]
