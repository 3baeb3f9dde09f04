"""Transversely isotropic materials: one family of fibres in an isotropic ground."""

from collections.abc import Mapping

from pydantic import Field, field_validator

from palpate.api import NO_FIELDS, AnisotropicMaterial, Parameter, Settings
from palpate.api.mechanics import Array
from palpate_materials.uncoupled import bulk_modulus, modulus, power_series, shape, yeoh_coefficients

Direction = tuple[float, float, float]


class FibreSettings(Settings):
    """Settings of :class:`HolzapfelGasserOgden`."""

    terms: int = Field(
        default=1, ge=1, le=3, description="Terms of the ground: 1 is neo-Hookean, 2 or 3 are Yeoh's."
    )
    dispersion: bool = Field(
        default=False, description="Whether fibres are dispersed around their direction: a parameter more."
    )
    tension_only: bool = Field(default=True, description="Whether fibres that are shortened bear nothing.")
    field: str = Field(
        default="axis",
        min_length=1,
        description="Cell data of the mesh with the direction of the fibres in each element; axis is the "
        "limb's, written by palpate limb.",
    )
    direction: Direction | None = Field(
        default=None,
        description="One direction for all elements instead, in the frame of the mesh; of any length but "
        "zero. Homogeneous tests, which have no mesh, need it.",
    )

    @field_validator("direction")
    @classmethod
    def _points_somewhere(cls, direction: Direction | None) -> Direction | None:
        if direction is not None and not any(direction):
            raise ValueError("(0, 0, 0) points nowhere; give the direction of the fibres")
        return direction


class HolzapfelGasserOgden(AnisotropicMaterial[FibreSettings]):
    """Holzapfel–Gasser–Ogden (2006) with one family of fibres, uncoupled.

    Ψ = Σ_k c_k (Ĩ1 − 3)^k + k1/(2 k2) (exp(k2 E²) − 1) + κ/2 (ln J)²,
    E = d (Ĩ1 − 3) + (1 − 3d) (Ĩ4 − 1)

    with Ĩ4 = J^(−2/3) a · C a for fibres along the unit vector a of the undeformed body, and their
    dispersion d (``dispersion``): 0 where all are along a, 1/3 where they have no direction. Without that
    setting d is 0. Fibres that are shortened, E < 0, bear nothing by default; the tangent then jumps at
    E = 0. With ``tension_only = false`` they bear as much as lengthened ones, and nothing jumps.

    Initial moduli of the ground: shear modulus 2 c1 and bulk modulus κ. Small strains along the fibres
    meet 4 k1 (1 − 3d)² per unit more where they bear. One term is the model of Abaqus; two families of
    FEBio's ``Holzapfel-Gasser-Ogden`` coincide at its angle 0, with c = 2 c1 and half of k1 each.

    In tension alone the fibres are stable where their energy is a number: the filter ``drucker`` goes to
    a stretch of 3, where the exponential overflows, so give it ``largest_stretch = 2`` and
    ``least_stretch = 0.7``. It refuses fibres that bear compression, which soften in it, if they are stiff.

    >>> import numpy as np
    >>> material = HolzapfelGasserOgden(FibreSettings(direction=(1.0, 0.0, 0.0)))
    >>> F = np.diag([1.2, 1.2**-0.5, 1.2**-0.5])
    >>> float(material.energy_from_F(F, np.array([0.01, 0.02, 1.0, 1.0])).round(6))
    0.003203
    """

    name = "holzapfel_gasser_ogden"
    summary = "Holzapfel-Gasser-Ogden: one family of fibres in a neo-Hookean or Yeoh ground, for muscle"

    def __init__(self, settings: FibreSettings | None = None) -> None:
        super().__init__(settings)
        self.fields = () if self.settings.direction else (self.settings.field,)
        self.parameters = (
            *yeoh_coefficients(self.settings.terms),
            modulus("k1", 1e-3, 5e-2, "stiffness of the fibres", 0.0),
            shape("k2", 0.1, 3.0, "how fast the fibres stiffen"),
            *([DISPERSION] if self.settings.dispersion else []),
            bulk_modulus(),
        )

    def energy_from_F(  # noqa: N802 - the interface's name
        self, F: Array, theta: Array, fields: Mapping[str, Array] = NO_FIELDS
    ) -> Array:
        """Strain energy per reference volume [MPa] of one deformation gradient (3, 3)."""
        import jax.numpy as jnp  # here: a list of materials needs no JAX

        settings = self.settings
        along = fields[settings.field] if self.fields and fields else settings.direction or (1.0, 0.0, 0.0)
        a = jnp.asarray(along)
        k1, k2, *dispersion, kappa = theta[settings.terms :]
        J = jnp.linalg.det(F)
        isochoric = J ** (-2.0 / 3.0)
        first = isochoric * jnp.sum(F * F) - 3.0
        E = isochoric * jnp.sum((F @ a) ** 2) / jnp.sum(a * a) - 1.0
        if dispersion:
            E = dispersion[0] * first + (1.0 - 3.0 * dispersion[0]) * E
        if settings.tension_only:
            E = jnp.where(E > 0.0, E, 0.0)
        fibres = k1 / (2.0 * k2) * jnp.expm1(k2 * E**2)
        return power_series(theta, first, settings.terms) + fibres + 0.5 * kappa * jnp.log(J) ** 2


DISPERSION = Parameter(
    name="dispersion",
    unit="",
    lower=0.0,
    upper=0.3,
    kind="shape",
    description="dispersion of the fibres: 0 aligned, 1/3 without direction",
    physical_lower=0.0,
    physical_upper=1.0 / 3.0,
)
