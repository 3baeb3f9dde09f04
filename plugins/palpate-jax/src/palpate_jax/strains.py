"""How far the tissue is deformed at equilibrium states, by region."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.api import FloatArray, Limb
from palpate_jax.body import Block
from palpate_jax.load_stepping import LoadStep
from palpate_jax.model import Model


def strain_ranges(limb: Limb, model: Model, reached: Sequence[LoadStep]) -> dict[str, dict[str, list[Any]]]:
    """Ends of the strains over the quadrature points of each region, one entry for each state.

    Strains are those that the material is given: with mean dilatation, J is the mean of the element.

    Returns
    -------
    dict
        By region: ``stretch_min`` and ``stretch_max`` of the principal stretches, ``i1_max`` of the first
        invariant of the isochoric deformation (3 at rest), ``J_min`` and ``J_max`` of the relative volume,
        and ``where_mm``, the undeformed centre of the element with the largest ``i1``, in the limb's frame.
    """
    found: dict[str, dict[str, list[Any]]] = {}
    for state in reached:
        by_region: dict[str, list[tuple[FloatArray, FloatArray]]] = {}
        for block in model.body.blocks:
            F = np.eye(3) + np.einsum("eai,eqaj->eqij", state.displacements[block.nodes], block.gradients)
            squares = (
                np.linalg.eigvalsh(F.swapaxes(-1, -2) @ F) * _dilated(block, np.linalg.det(F))[..., None]
            )
            centres = np.repeat(limb.mesh.points_mm[block.nodes].mean(axis=1)[:, None], F.shape[1], axis=1)
            real = block.volumes > 0.0  # points that fill up a patch are none
            by_region.setdefault(block.region, []).append((squares[real], centres[real]))
        for region, parts in by_region.items():
            squares, centres = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
            for name, value in _ends(squares, centres).items():
                found.setdefault(region, {}).setdefault(name, []).append(value)
    return found


def _dilated(block: Block, J: FloatArray) -> FloatArray:
    """Factor (e, q) on squared stretches from those of the displacements to those that the material has."""
    if not block.mean_dilatation:
        return np.ones_like(J)
    mean = (block.volumes * J).sum(axis=1, keepdims=True) / block.volumes.sum(axis=1, keepdims=True)
    return np.asarray(np.cbrt(mean / J) ** 2)


def _ends(squares: FloatArray, centres_mm: FloatArray) -> dict[str, Any]:
    """Ends of squared stretches (n, 3) at points (n, 3)."""
    J = np.sqrt(squares.prod(axis=1))
    i1 = squares.sum(axis=1) / np.cbrt(J) ** 2
    return {
        "stretch_min": float(np.sqrt(squares.min())),
        "stretch_max": float(np.sqrt(squares.max())),
        "i1_max": float(i1.max()),
        "J_min": float(J.min()),
        "J_max": float(J.max()),
        "where_mm": centres_mm[np.argmax(i1)].tolist(),
    }
