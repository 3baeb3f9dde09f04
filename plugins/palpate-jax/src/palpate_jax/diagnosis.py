"""Reason why load stepping ended early, from the material and the elements of its last equilibrium state."""

from collections.abc import Mapping

import numpy as np

from palpate.api import FloatArray, IsotropicMaterial, Material
from palpate.api.mechanics import principal_derivatives
from palpate_jax.body import Block
from palpate_jax.load_stepping import Stop
from palpate_jax.model import Model

CRUSHED = 0.05
"""Ratio of volumes at a quadrature point below which its element counts as about to invert."""


def explained(
    stop: Stop, model: Model, materials: Mapping[str, Material], thetas: Mapping[str, FloatArray]
) -> str:
    """The stop in words: the symptom, where on the path, and the likely cause.

    A material is unstable where ∂²Ψ/∂ε_i∂ε_j in the logarithmic principal strains is not positive
    definite (Drucker), which is checked at every quadrature point of the last equilibrium state.
    Materials that are not isotropic are not examined.
    """
    where = f"beyond {_place(stop.position)}"
    if stop.is_limit:
        return f"{stop.reason} ({where})"
    least = np.inf
    for block in model.body.blocks:
        F, J = _deformation(block, stop.displacements)
        least = min(least, float(J[block.volumes > 0.0].min()))
        material = materials[block.region]
        if not isinstance(material, IsotropicMaterial):
            continue
        stretches: FloatArray = np.linalg.svd(F[block.volumes > 0.0], compute_uv=False).astype(np.float64)
        stiffness = _least_stiffness(material, stretches, thetas[block.region])
        if stiffness.min() <= 0.0:
            worst = ", ".join(f"{s:.2f}" for s in stretches[int(np.argmin(stiffness))])
            return (
                f"{stop.reason} {where}: the material of region '{block.region}' is unstable there, at "
                f"{int((stiffness <= 0.0).sum())} of {stiffness.size} points, worst at stretches {worst}; "
                "smaller steps do not help; a stability filter drops such sets"
            )
    if least < CRUSHED:
        return f"{stop.reason} {where}: an element is crushed to {least:.3f} of its volume; refine the mesh"
    return (
        f"{stop.reason} {where}: the material is stable there, but the contact finds no equilibrium; "
        "try more depth_steps, a smaller rotation_step_deg, or a finer mesh under the indenter"
    )


def _place(position: FloatArray) -> str:
    """Position (6,) in words; shifts and tilts only where there are any."""
    depth, *aside, rotation = position.tolist()
    words = [f"depth {depth:.2f} mm", f"rotation {rotation:.1f} degrees"]
    for name, unit, pair in (("shift", "mm", aside[:2]), ("tilt", "degrees", aside[2:])):
        words += [f"{name} ({pair[0]:.2f}, {pair[1]:.2f}) {unit}"] if any(pair) else []
    return ", ".join(words)


def _deformation(block: Block, displacements: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Deformation gradient (e, q, 3, 3) of the material, and J (e, q)."""
    F = np.eye(3) + np.einsum("eai,eqaj->eqij", displacements[block.nodes], block.gradients)
    J = np.linalg.det(F)
    if block.mean_dilatation:
        mean = (block.volumes * J).sum(axis=1, keepdims=True) / block.volumes.sum(axis=1, keepdims=True)
        F = np.cbrt(mean / J)[..., None, None] * F
    return F, J


def _least_stiffness(material: IsotropicMaterial, stretches: FloatArray, theta: FloatArray) -> FloatArray:
    """Least eigenvalue (n,) of λ_i λ_j ψ_ij + δ_ij λ_i ψ_i [MPa] at stretches (n, 3)."""
    psi_i, psi_ij = (np.asarray(d) for d in principal_derivatives(material, stretches, theta))
    hessians = stretches[:, :, None] * stretches[:, None, :] * psi_ij
    hessians[:, range(3), range(3)] += stretches * psi_i
    least: FloatArray = np.linalg.eigvalsh(np.nan_to_num(hessians, nan=-1.0))[:, 0]
    return least
