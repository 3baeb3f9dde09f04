"""Internal forces of the limb and their tangent, block by block.

Each block has the elements of one kind and region. Its energy is
E = Σ_q w_q Ψ(F̄_q) with F̄ = (θ/J)^(1/3) F, where θ is the element's mean of J
(mean dilatation: three-field with constant pressure and dilatation, Simo,
Taylor & Pister 1985). Force and tangent are its exact first and second
derivatives, so Newton converges quadratically. With ``mean_dilatation`` off,
F̄ = F: the plain displacement element.

A block whose material relaxes has the stress of these forces in :mod:`palpate_jax.viscoelasticity`.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.api import FloatArray, IntArray, Material, Mesh
from palpate_jax.autodiff import AutodiffKernel
from palpate_jax.compiled import CompiledKernel, serves
from palpate_jax.elements import ELEMENTS, PLAIN_ELEMENTS, tetrahedron_patches
from palpate_jax.viscoelasticity import BlockRelaxation, InLoadStep, Stresses, held_in, weighted

Histories = Mapping[int, Stresses]
"""History variables by number of the blocks that relax."""


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
    rows : (n_cells,) array
        Cells of the mesh that it was made of, numbered among the cells of their kind.
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
    """Running number of each entry among the entries with its label."""
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
        self._relaxations: dict[int, BlockRelaxation] = {}
        for number, block in enumerate(self.blocks):
            material = materials[block.region]
            times_s = material.relaxation_times_s
            material = weighted(material) if times_s else material
            shape = (block.nodes, block.gradients, block.volumes, block.mean_dilatation)
            if compiled := serves(material):
                self._kernels.append(CompiledKernel(material, *shape))
            if times_s or not compiled:
                fields = {name: block.fields[name] for name in material.fields}
                kernel = AutodiffKernel(material, *shape, axes=axes, fields=fields)
                self._kernels += [] if compiled else [kernel]
            if times_s:
                turned = block.gradients if axes is None else block.gradients @ axes.T
                relaxing = (block.nodes, turned, block.volumes, mesh.points_mm, np.array(times_s))
                self._relaxations[number] = BlockRelaxation(kernel, *relaxing)

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
        for number, relaxation in self._relaxations.items():
            relaxation.bind(places[number])
        self._n_entries = n_entries

    def at_rest(self, *leading: int) -> Histories:
        """History of a body at rest, or with leading axes its derivatives; empty where nothing relaxes."""
        return {number: each.at_rest(*leading) for number, each in self._relaxations.items()}

    def in_step(
        self, values: Mapping[str, FloatArray], before: Histories, duration_s: float
    ) -> Mapping[str, FloatArray]:
        """Materials in a load step that begins with this history; the values alone where nothing relaxes."""
        if not self._relaxations:
            return values
        theta = {number: values[self.blocks[number].region] for number in before}
        held = {n: self._relaxations[n].in_step(theta[n], each, duration_s) for n, each in before.items()}
        return InLoadStep(values, held)

    def after(self, displacements: FloatArray, thetas: Mapping[str, FloatArray]) -> Histories:
        """History at the end of a load step, which is in equilibrium there."""
        return {n: self._relaxations[n].after(displacements, held) for n, held in held_in(thetas).items()}

    def slopes_after(
        self,
        displacements: FloatArray,
        thetas: Mapping[str, FloatArray],
        slopes: Histories,
        moved: FloatArray,
    ) -> Histories:
        """Derivatives of that history as nodes move by ``moved`` (m, n_nodes, 3); rows as in ``thetas``."""
        ends = dict(zip(thetas, np.cumsum([len(theta) for theta in thetas.values()]).tolist(), strict=True))
        found = {}
        for n, held in held_in(thetas).items():
            theta, end = thetas[self.blocks[n].region], ends[self.blocks[n].region]
            changed = np.zeros((len(moved), len(theta)))
            changed[end - len(theta) : end] = np.eye(len(theta))
            found[n] = self._relaxations[n].slopes_after(displacements, held, slopes[n], moved, changed)
        return found

    def force(self, displacements: FloatArray, thetas: Mapping[str, FloatArray]) -> tuple[FloatArray, float]:
        """Internal nodal forces (n_nodes, 3) [N] and the least J of any quadrature point."""
        total = np.zeros(self._shape)
        least = [
            kernel.add_force(displacements, theta, total)
            for kernel, theta in zip(self._kernels, self._thetas(thetas), strict=True)
        ]
        for n, held in held_in(thetas).items():
            self._relaxations[n].add_force(held, displacements, total)
        return total, float(np.min(least))

    def _thetas(self, thetas: Mapping[str, FloatArray]) -> list[FloatArray]:
        """Values that each kernel takes; of what relaxes at once, where no load step is given."""
        held = held_in(thetas)
        at_once = {n: np.array([*thetas[self.blocks[n].region], 1.0, 1.0]) for n in self._relaxations}
        every = at_once | {n: each.theta for n, each in held.items()}
        return [every.get(n, thetas[block.region]) for n, block in enumerate(self.blocks)]

    def rates(self, displacements: FloatArray, thetas: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """∂force/∂θ (m, n_nodes, 3) of a region's m parameters, by region.

        Displacements, and the history before the load step, are fixed.
        """
        totals = {region: np.zeros((len(theta), *self._shape)) for region, theta in thetas.items()}
        held, every = held_in(thetas), zip(self.blocks, self._kernels, self._thetas(thetas), strict=True)
        for n, (block, kernel, theta) in enumerate(every):
            own = np.zeros((len(theta), *self._shape)) if n in held else totals[block.region]
            kernel.add_rates(displacements, theta, own)
            if n in held:
                self._relaxations[n].add_rates(displacements, held[n], own, totals[block.region])
        return totals

    def add_rates_of_history(
        self,
        displacements: FloatArray,
        thetas: Mapping[str, FloatArray],
        slopes: Histories,
        totals: FloatArray,
    ) -> None:
        """Add the change of the forces with the history before a load step to ``totals`` (m, n_nodes, 3)."""
        for n, held in held_in(thetas).items():
            self._relaxations[n].add_rates_of_history(displacements, held, slopes[n], totals)

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
            kernel.add_tangent(displacements, theta, total, values)
            for kernel, theta in zip(self._kernels, self._thetas(thetas), strict=True)
        ]
        for n, held in held_in(thetas).items():
            self._relaxations[n].add_force(held, displacements, total)
            self._relaxations[n].add_stiffness(held, values)
        return total, values[:-1], float(np.min(least))
