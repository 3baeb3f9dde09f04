"""Soft matter with one family of fibres."""

from collections.abc import Mapping

import jax.numpy as jnp
from pydantic import Field, field_validator

from palpate.api import NO_FIELDS, AnisotropicMaterial, Parameter, Settings
from palpate.api.mechanics import Array


class ReinforcedSettings(Settings):
    """Settings of :class:`Reinforced`."""

    direction: tuple[float, float, float] = Field(
        default=(1.0, 0.0, 0.0),
        description="Of the fibres, in the frame of the mesh; of any length but zero.",
    )
    field: str = Field(
        default="",
        description="Cell data of the mesh with the direction in each element, instead of one for all.",
    )
    tension_only: bool = Field(default=True, description="Whether fibres that are shortened bear nothing.")

    @field_validator("direction")
    @classmethod
    def _points_somewhere(cls, direction: tuple[float, float, float]) -> tuple[float, float, float]:
        if not any(direction):
            raise ValueError("(0, 0, 0) points nowhere; give the direction of the fibres")
        return direction


def _modulus(name: str, lower: float, upper: float, description: str) -> Parameter:
    return Parameter(
        name=name,
        unit="MPa",
        lower=lower,
        upper=upper,
        kind="modulus",
        description=description,
        physical_lower=0.0,
    )


class Reinforced(AnisotropicMaterial[ReinforcedSettings]):
    """Ψ = μ/2 (Ĩ1 − 3) + k1/(2 k2) (exp(k2 (I4 − 1)²) − 1) + κ/2 (ln J)², with I4 = a · C a.

    The fibre term is that of Holzapfel, Gasser and Ogden (2000), in the whole I4: a fibre that a
    change of volume lengthens is a longer fibre. Initial moduli across the fibres: μ and κ.
    """

    name = "reinforced"
    summary = "one family of fibres that stiffen exponentially, in a neo-Hookean matrix"
    parameters = (
        _modulus("mu", 0.005, 0.05, "shear modulus of the matrix"),
        _modulus("k1", 0.005, 0.1, "stiffness of the fibres"),
        Parameter(
            name="k2",
            unit="",
            lower=0.1,
            upper=4.0,
            kind="shape",
            description="how fast the fibres stiffen",
            physical_lower=1e-6,
        ),
        _modulus("kappa", 0.25, 2.5, "bulk modulus"),
    )

    def __init__(self, settings: ReinforcedSettings | None = None) -> None:
        super().__init__(settings)
        self.fields = (self.settings.field,) if self.settings.field else ()

    def energy_from_F(  # noqa: N802 - the interface's name
        self, F: Array, theta: Array, fields: Mapping[str, Array] = NO_FIELDS
    ) -> Array:
        """Strain energy per reference volume [MPa] of one deformation gradient (3, 3)."""
        mu, k1, k2, kappa = theta
        along = fields[self.settings.field] if fields else jnp.array(self.settings.direction)
        a = along / jnp.linalg.norm(along)
        J, longer = jnp.linalg.det(F), jnp.sum((F @ a) ** 2) - 1.0
        if self.settings.tension_only:
            longer = jnp.where(longer > 0.0, longer, 0.0)
        matrix = mu / 2 * (jnp.sum(F * F) * J ** (-2 / 3) - 3.0) + kappa / 2 * jnp.log(J) ** 2
        return matrix + k1 / (2 * k2) * jnp.expm1(k2 * longer**2)
