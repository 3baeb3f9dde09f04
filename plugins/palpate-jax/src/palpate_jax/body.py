"""Internal forces of the limb and their tangent, block by block.

Each block has the elements of one kind and region. Its energy is
E = Σ_q w_q Ψ(F̄_q) with F̄ = (θ/J)^(1/3) F, where θ is the element's mean of J
(mean dilatation: three-field with constant pressure and dilatation, Simo,
Taylor & Pister 1985). Force and tangent are its exact first and second
derivatives, so Newton converges quadratically. With ``mean_dilatation`` off,
F̄ = F: the plain displacement element.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.api import FloatArray, IntArray, Material, Mesh
from palpate_jax.autodiff import AutodiffKernel
from palpate_jax.compiled import CompiledKernel, serves
from palpate_jax.elements import ELEMENTS, PLAIN_ELEMENTS, tetrahedron_patches


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Elements of one kind and region.

    Parameters
    ----------
    nodes : (n_elements, n) array
        An element of tet4 may be a patch; a node may then occur twice, the second time without gradient.
    gradients : (n_elements, q, n, 3) array
        Shape function gradients in the reference configuration [1/mm].
    volumes : (n_elements, q) array
        Quadrature weight times reference Jacobian [mm³].
    mean_dilatation : bool
        Otherwise plain displacement elements.
    fields : mapping of name to (n_elements, q) or (n_elements, q, 3) array
        Cell fields of the mesh, in its frame.
    kind : str
    rows : (n_cells,) array
        Cells of the mesh that it was made of, among those of their kind.
    places : (n_cells, p) element numbers and (n_cells, p) point numbers
        Quadrature points of each of these cells.
    """

    region: str
    nodes: IntArray
    gradients: FloatArray
    volumes: FloatArray
    mean_dilatation: bool
    fields: Mapping[str, FloatArray]
    kind: str
    rows: IntArray
    places: tuple[IntArray, IntArray]

    def deformation(self, displacements: FloatArray) -> tuple[FloatArray, FloatArray]:
        """F (e, q, 3, 3) of displacements (n_nodes, 3), and the factor (e, q) to make it the material's."""
        F = np.eye(3) + np.einsum("eai,eqaj->eqij", displacements[self.nodes], self.gradients)
        J = np.linalg.det(F)
        if not self.mean_dilatation:
            return F, np.ones_like(J)
        mean = (self.volumes * J).sum(axis=1, keepdims=True) / self.volumes.sum(axis=1, keepdims=True)
        return F, np.cbrt(mean / J)


def blocks(mesh: Mesh, mean_dilatation: bool | Collection[str] = True) -> tuple[Block, ...]:
    """Split a mesh into blocks of one element kind and one region each.

    ``mean_dilatation`` may name the regions that have it; the others are plain.
    With it an element of a block of tet4 is a patch of tetrahedra
    with a point for each (:mod:`palpate_jax.elements`); without it tet10 has the
    rule of the plain displacement element.
    """
    found = []
    for kind, cells in mesh.cells.items():
        for index, region in enumerate(mesh.regions):
            mean = mean_dilatation if isinstance(mean_dilatation, bool) else region in mean_dilatation
            element = ELEMENTS[kind] if mean else PLAIN_ELEMENTS[kind]
            own = np.flatnonzero(mesh.cell_regions[kind] == index)
            nodes = cells[own]
            if len(nodes) == 0:
                continue
            jacobians = np.einsum("eai,qaj->eqij", mesh.points_mm[nodes], element.slopes)
            gradients = np.einsum("qaj,eqji->eqai", element.slopes, np.linalg.inv(jacobians))
            volumes = np.linalg.det(jacobians) * element.quadrature_weights
            fields = {
                name: np.repeat(by_kind[kind][own][:, None], volumes.shape[1], axis=1)
                for name, by_kind in mesh.cell_fields.items()
            }
            elements, points = np.indices(volumes.shape)
            block = Block(region, nodes, gradients, volumes, mean, fields, kind, own, (elements, points))
            if mean and kind == "tet4":
                block = _by_patch(block, tetrahedron_patches(mesh.points_mm, nodes))
            found.append(block)
    return tuple(found)


def _by_patch(block: Block, labels: IntArray) -> Block:
    """Make an element of each patch of one-point elements.

    Patches are filled up to a common size with points of no volume and no
    gradient, and with separate nodes that have no gradient either.
    """
    slots = _places(labels)
    owners, inverse = np.unique(labels[:, None] * (block.nodes.max() + 1) + block.nodes, return_inverse=True)
    patches, numbers = np.divmod(owners, block.nodes.max() + 1)
    places = _places(patches)
    first = np.searchsorted(patches, np.arange(labels.max() + 1))
    nodes = np.repeat(numbers[first, None], places.max() + 1, axis=1)
    nodes[patches, places] = numbers
    volumes = np.zeros((len(nodes), slots.max() + 1))
    volumes[labels, slots] = block.volumes[:, 0]
    gradients = np.zeros((*volumes.shape, nodes.shape[1], 3))
    local = places[inverse.reshape(block.nodes.shape)]
    gradients[labels[:, None], slots[:, None], local] = block.gradients[:, 0]
    _, first_cell = np.unique(labels, return_index=True)
    fields = {
        name: np.repeat(values[first_cell], slots.max() + 1, axis=1) for name, values in block.fields.items()
    }
    for name, values in block.fields.items():
        fields[name][labels, slots] = values[:, 0]
    places_of_cells = labels[:, None], slots[:, None]
    return replace(
        block, nodes=nodes, gradients=gradients, volumes=volumes, fields=fields, places=places_of_cells
    )


def _places(labels: IntArray) -> IntArray:
    """Running number of each entry among those of the same label."""
    order = np.argsort(labels, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(labels))[:-1]])
    places = np.empty_like(labels)
    places[order] = np.arange(len(labels)) - starts[labels[order]]
    return places


class Body:
    """Internal forces of a mesh whose regions have given materials.

    Isotropic materials run in compiled kernels where the computation is on the
    processor; others, and a computation on a GPU, in JAX alone.

    Parameters
    ----------
    axes : (3, 3) array, optional
        Axes of the frame of ``mesh.points_mm``, as columns in the frame that directions and fields are in.
    """

    def __init__(
        self,
        mesh: Mesh,
        materials: Mapping[str, Material],
        mean_dilatation: bool | Collection[str],
        axes: FloatArray | None = None,
    ) -> None:
        self.blocks = blocks(mesh, mean_dilatation)
        self._shape = (mesh.n_nodes, 3)
        self._n_entries: int | None = None
        self._kernels: list[CompiledKernel | AutodiffKernel] = []
        for block in self.blocks:
            material = materials[block.region]
            shape = (block.nodes, block.gradients, block.volumes, block.mean_dilatation)
            if serves(material):
                self._kernels.append(CompiledKernel(material, *shape))
                continue
            fields = {name: block.fields[name] for name in material.fields}
            self._kernels.append(AutodiffKernel(material, *shape, axes=axes, fields=fields))

    def bind(self, places: Sequence[IntArray], n_entries: int) -> None:
        """Set the places of the stiffness entries, before the first tangent.

        Parameters
        ----------
        places : sequence of (e, 3n, 3n) integer arrays
            By block, the place of each entry in the values of a sparse matrix; ``n_entries`` where
            it has none.
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

    def rates(self, displacements: FloatArray, thetas: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """∂force/∂θ (m, n_nodes, 3) of a region's m parameters, by region, at fixed displacements."""
        totals = {region: np.zeros((len(theta), *self._shape)) for region, theta in thetas.items()}
        for block, kernel in zip(self.blocks, self._kernels, strict=True):
            kernel.add_rates(displacements, thetas[block.region], totals[block.region])
        return totals

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
            raise RuntimeError("the places of the stiffness entries are not set; call `bind` first")
        total, values = np.zeros(self._shape), np.zeros(self._n_entries + 1)
        least = [
            kernel.add_tangent(displacements, thetas[block.region], total, values)
            for block, kernel in zip(self.blocks, self._kernels, strict=True)
        ]
        return total, values[:-1], float(np.min(least))
