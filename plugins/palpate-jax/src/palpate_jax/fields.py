"""Fields of equilibrium states as VTU files, one per load step, and a PVD that lists them.

All vectors and tensors are in the coordinates of the limb's own mesh.

====================  ========  ============================================================
name                  at        quantity
====================  ========  ============================================================
displacement_mm       nodes     displacement
contact_pressure_MPa  nodes     pressure of the indenter, per deformed area
contact_shear_MPa     nodes     tangential traction of the indenter on the tissue, per deformed area
cauchy_stress_MPa     elements  Cauchy stress, row by row, mean over the deformed volume
principal_stretches   elements  stretches, the largest first, of the mean deformation gradient
J                     elements  volume over reference volume
region                elements  index into the regions of the mesh
====================  ========  ============================================================

Nodal tractions are means around a node, such that area × traction adds up to the force.
"""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import jax
import numpy as np

from palpate.api import FloatArray, Limb, Material
from palpate.api.mechanics import stress
from palpate.api.mesh import CELLS, in_spot_frame, spot_axes
from palpate_jax.body import Block, blocks
from palpate_jax.contact import Contact
from palpate_jax.load_stepping import LoadStep
from palpate_jax.skin import nodal_tractions

_stress = jax.jit(stress, static_argnums=0)


class FieldWriter:
    """Writes the fields of one limb's simulations.

    Parameters
    ----------
    mean_dilatation : bool, or the regions that have it
        As the simulation had it.
    """

    def __init__(
        self, limb: Limb, materials: Mapping[str, Material], mean_dilatation: bool | Collection[str]
    ) -> None:
        self._mesh, self._axes = in_spot_frame(limb), spot_axes(limb.spot.normal, limb.spot.along)
        self._original = limb.mesh
        self._materials = materials
        self._blocks = blocks(self._mesh, mean_dilatation)
        self._contact = Contact(self._mesh)

    def write(self, folder: Path, thetas: Mapping[str, FloatArray], states: Sequence[LoadStep]) -> Path:
        """Write ``000.vtu``, ``001.vtu`` … and ``path.pvd``, which lists them.

        Parameters
        ----------
        folder : Path
            Made if it is not there.

        Returns
        -------
        Path
            The PVD file.

        Raises
        ------
        OSError
            The folder cannot be written to.
        """
        folder.mkdir(parents=True, exist_ok=True)
        names = [f"{number:03d}.vtu" for number in range(len(states))]
        for name, state in zip(names, states, strict=True):
            self._write_one(folder / name, thetas, state)
        lines = "".join(
            f'    <DataSet timestep="{number}" name="depth {state.depth_mm:g} mm, rotation '
            f'{state.rotation_deg:g} degrees" file="{name}"/>\n'
            for number, (name, state) in enumerate(zip(names, states, strict=True))
        )
        index = folder / "path.pvd"
        index.write_text(
            '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n'
            f"  <Collection>\n{lines}  </Collection>\n</VTKFile>\n",
            encoding="utf-8",
        )
        return index

    def _write_one(self, path: Path, thetas: Mapping[str, FloatArray], state: LoadStep) -> None:
        import meshio  # here: slow to import, and few simulations write fields

        mesh = self._original
        kinds = [(kind, cell.meshio) for kind, cell in CELLS.items() if len(mesh.cells.get(kind, ()))]
        by_kind = self._of_cells(thetas, state)
        found = nodal_tractions(self._contact, self._mesh.points_mm, state)
        names = ("cauchy_stress_MPa", "principal_stretches", "J", "region")
        meshio.write_points_cells(
            path,
            mesh.points_mm,
            [(name, mesh.cells[kind]) for kind, name in kinds],
            point_data={
                "displacement_mm": state.displacements @ self._axes.T,
                "contact_pressure_MPa": found.pressures_MPa,
                "contact_shear_MPa": found.shears_MPa @ self._axes.T,
            },
            cell_data={name: [by_kind[kind][name] for kind, _ in kinds] for name in names},
        )

    def _of_cells(
        self, thetas: Mapping[str, FloatArray], state: LoadStep
    ) -> dict[str, dict[str, FloatArray]]:
        """Cell data by kind and name."""
        found: dict[str, dict[str, FloatArray]] = {}
        for number, block in enumerate(self._blocks):
            regions = self._mesh.cell_regions[block.kind]
            own = found.setdefault(block.kind, {"region": regions.astype(np.float64)})
            material, theta = self._materials[block.region], thetas[block.region]
            history, n_own = state.stresses.get(number), len(theta) - len(material.relaxation_times_s)
            lost = None if history is None else history.lost(theta[n_own:])
            values = cell_fields(material, theta, block, state.displacements, self._axes, lost)
            for name, value in zip(("cauchy_stress_MPa", "principal_stretches", "J"), values, strict=True):
                if name == "cauchy_stress_MPa":
                    value = (self._axes @ value @ self._axes.T).reshape(-1, 9)
                own.setdefault(name, np.zeros((len(regions), *value.shape[1:])))[block.rows] = value
        return found


def cell_fields(
    material: Material,
    theta: FloatArray,
    block: Block,
    displacements: FloatArray,
    axes: FloatArray | None = None,
    lost: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Cauchy stress, stretches and J of the cells of a block.

    Parameters
    ----------
    axes : (3, 3) array, optional
        As of :class:`palpate_jax.body.Body`.
    lost : (e, q, 3, 3) array, optional
        Second Piola–Kirchhoff stress that has relaxed, in the frame of the material's directions [MPa].

    Returns
    -------
    cauchy_MPa : (c, 3, 3) array
    stretches : (c, 3) array
        The largest first.
    J : (c,) array
    """
    places, (gradients, _) = block.places, block.deformation(displacements)
    stresses, J = _cauchy(material, theta, block, gradients, axes)
    if lost is not None:
        turned = gradients if axes is None else gradients @ axes.T
        stresses = stresses - turned @ lost @ turned.swapaxes(-1, -2) / J[..., None, None]
    volumes = block.volumes[places]
    now = volumes * J[places]
    sigma = np.einsum("cp,cpij->cij", now, stresses[places]) / now.sum(axis=1)[:, None, None]
    mean = np.einsum("cp,cpij->cij", volumes, gradients[places]) / volumes.sum(axis=1)[:, None, None]
    return sigma, np.linalg.svd(mean, compute_uv=False), now.sum(axis=1) / volumes.sum(axis=1)


def _cauchy(
    material: Material, theta: FloatArray, block: Block, F: FloatArray, axes: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Cauchy stress (e, q, 3, 3) [MPa] and J (e, q) at the quadrature points.

    With mean dilatation, where τ̄ = P̄ F̄ᵀ at the deformation of the mean dilatation θ,
    the stress is dev τ̄ / J plus the element's mean of tr τ̄ / 3θ: its conjugate in the
    energy that the solver balances.
    """
    w, J = block.volumes, np.linalg.det(F)
    volume = w.sum(axis=1, keepdims=True)
    theta_mean = (w * J).sum(axis=1, keepdims=True) / volume if block.mean_dilatation else J
    mean_F = np.cbrt(theta_mean / J)[..., None, None] * F
    mean_F = mean_F if axes is None else mean_F @ axes.T
    own = {name: block.fields[name] for name in material.fields}
    kirchhoff = np.asarray(_stress(material, mean_F, theta, own)) @ mean_F.swapaxes(-1, -2)
    third = np.trace(kirchhoff, axis1=-2, axis2=-1) / 3.0
    pressure = third / theta_mean
    if block.mean_dilatation:
        pressure = np.broadcast_to((w * pressure).sum(axis=1, keepdims=True) / volume, J.shape)
    deviator = kirchhoff - third[..., None, None] * np.eye(3)
    return deviator / J[..., None, None] + pressure[..., None, None] * np.eye(3), J
