"""How far the tissue is deformed at balanced states, by region."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.api import FloatArray, Limb
from palpate_jax.load_stepping import LoadStep
from palpate_jax.model import Model


def strain_ranges(limb: Limb, model: Model, reached: Sequence[LoadStep]) -> dict[str, dict[str, list[Any]]]:
    """Ends of the strains over the quadrature points of each region, one entry for each state.

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
            squares = np.linalg.eigvalsh(F.swapaxes(-1, -2) @ F)
            centres = limb.mesh.points_mm[block.nodes].mean(axis=1)
            by_region.setdefault(block.region, []).append(
                (squares.reshape(-1, 3), np.repeat(centres, squares.shape[1], axis=0))
            )
        for region, parts in by_region.items():
            squares, centres = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
            for name, value in _ends(squares, centres).items():
                found.setdefault(region, {}).setdefault(name, []).append(value)
    return found


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
