"""The limb in equilibrium: internal forces and their tangent, block by block.

Each block holds the elements of one kind and region. Its energy is
E = Σ_q w_q Ψ(F̄_q) with F̄ = (θ/J)^(1/3) F, where θ is the element's mean of J
(mean dilatation: three-field with constant pressure and dilatation, Simo,
Taylor & Pister 1985). Force and tangent are its exact first and second
derivatives, so Newton converges quadratically. With ``mean_dilatation`` off,
F̄ = F: the plain displacement element.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.domain import FloatArray, IntArray, Mesh
from palpate.interfaces import Material
from palpate_jax.autodiff import AutodiffKernel
from palpate_jax.compiled import CompiledKernel, serves
from palpate_jax.elements import ELEMENTS


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Elements of one kind and region.

    Parameters
    ----------
    region : str
    nodes : (n_elements, n) array
    gradients : (n_elements, q, n, 3) array
        Shape function gradients in the reference configuration [1/mm].
    volumes : (n_elements, q) array
        Quadrature weight times reference Jacobian [mm³].
    """

    region: str
    nodes: IntArray
    gradients: FloatArray
    volumes: FloatArray


def blocks(mesh: Mesh) -> tuple[Block, ...]:
    """Split a mesh into blocks of one element kind and one region each."""
    found = []
    for kind, cells in mesh.cells.items():
        element = ELEMENTS[kind]
        for index, region in enumerate(mesh.regions):
            nodes = cells[mesh.cell_regions[kind] == index]
            if len(nodes) == 0:
                continue
            jacobians = np.einsum("eai,qaj->eqij", mesh.points_mm[nodes], element.slopes)
            gradients = np.einsum("qaj,eqji->eqai", element.slopes, np.linalg.inv(jacobians))
            volumes = np.linalg.det(jacobians) * element.weights
            found.append(Block(region, nodes, gradients, volumes))
    return tuple(found)


class Body:
    """Internal forces of a mesh whose regions have given materials.

    Isotropic materials run in compiled kernels where the computation is on the
    processor; others, and a computation on a GPU, in JAX alone.

    Parameters
    ----------
    mesh : Mesh
    materials : mapping of region to Material
    mean_dilatation : bool
    """

    def __init__(self, mesh: Mesh, materials: Mapping[str, Material], mean_dilatation: bool) -> None:
        self.blocks = blocks(mesh)
        self._shape = (mesh.n_nodes, 3)
        self._n_entries: int | None = None
        self._kernels: list[CompiledKernel | AutodiffKernel] = []
        for block in self.blocks:
            material = materials[block.region]
            kernel = CompiledKernel if serves(material) else AutodiffKernel
            self._kernels.append(
                kernel(material, block.nodes, block.gradients, block.volumes, mean_dilatation)
            )

    def bind(self, places: Sequence[IntArray], n_entries: int) -> None:
        """Say where stiffness entries go, before the first tangent.

        Parameters
        ----------
        places : sequence of (e, 3n, 3n) integer arrays
            By block, the place of each entry in the values of a sparse matrix; ``n_entries`` where
            it has none.
        n_entries : int
        """
        for kernel, own in zip(self._kernels, places, strict=True):
            kernel.bind(own)
        self._n_entries = n_entries

    def force(self, displacements: FloatArray, thetas: Mapping[str, FloatArray]) -> tuple[FloatArray, float]:
        """Internal nodal forces (n_nodes, 3) [N] and the least J of any quadrature point."""
        total = np.zeros(self._shape)
        least = [
            kernel.add_force(displacements, thetas[block.region], total)
            for block, kernel in zip(self.blocks, self._kernels, strict=True)
        ]
        return total, float(np.min(least))

    def tangent(
        self, displacements: FloatArray, thetas: Mapping[str, FloatArray]
    ) -> tuple[FloatArray, FloatArray, float]:
        """Internal forces, the values (n_entries,) of their derivative [N/mm], and the least J.

        Raises
        ------
        RuntimeError
            :meth:`bind` was not called.
        """
        if self._n_entries is None:
            raise RuntimeError("the body does not know where stiffness entries go; call `bind` first")
        total, values = np.zeros(self._shape), np.zeros(self._n_entries + 1)
        least = [
            kernel.add_tangent(displacements, thetas[block.region], total, values)
            for block, kernel in zip(self.blocks, self._kernels, strict=True)
        ]
        return total, values[:-1], float(np.min(least))
