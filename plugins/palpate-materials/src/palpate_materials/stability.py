"""Drucker stability: a filter of parameter sets of unstable materials."""

from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from palpate.api import BoolArray, FloatArray, Material, ParameterSpace, SetFilter, Settings

Mode = Literal["uniaxial", "equibiaxial", "planar"]


class DruckerSettings(Settings):
    """Settings of :class:`Drucker`."""

    modes: tuple[Mode, ...] = Field(
        default=("uniaxial", "equibiaxial", "planar"),
        min_length=1,
        description="Deformation modes along which stability is required.",
    )
    least_stretch: float = Field(
        default=0.3, gt=0.0, lt=1.0, description="Compressive end of the stretch range, less than 1."
    )
    largest_stretch: float = Field(
        default=3.0, gt=1.0, description="Tensile end of the stretch range, more than 1."
    )
    n_stretches: int = Field(
        default=61, ge=3, description="Number of stretches checked, evenly spaced in their logarithm."
    )

    @model_validator(mode="after")
    def _distinct_modes(self) -> "DruckerSettings":
        if len(set(self.modes)) != len(self.modes):
            raise ValueError(f"modes {self.modes} name one mode twice; name each once")
        return self


class Drucker(SetFilter[DruckerSettings]):
    """Keep the sets for which dτ : dε > 0 for every strain increment, in every region.

    The Hessian ∂²Ψ/∂ε_i∂ε_j in the logarithmic principal strains must be
    positive definite at each stretch t of the range along each mode, at constant
    volume:

    =============  ==============================
    mode           principal stretches
    =============  ==============================
    uniaxial       t, t^(−1/2), t^(−1/2)
    equibiaxial    t, t, t^(−2)
    planar         t, 1, t^(−1)  (pure shear)
    =============  ==============================

    At J = 1 the Hessian of an uncoupled energy is the Hessian of its isochoric part on
    the increments of constant volume, plus κ on the volumetric one. So for
    these materials the condition is the classic one of incompressible rubber (a
    positive definite 2 × 2 stiffness between true stress and logarithmic strain)
    and κ > 0, independent of the pressure. A coupled material has the same
    condition along the same isochoric paths. For an anisotropic one the Hessian
    is 6 × 6, in the whole logarithmic strain tensor, with each mode applied along
    all permutations of the coordinate axes.
    """

    name = "drucker"
    summary = "Drucker stability along simple deformation modes, over a range of stretches"

    def accept(self, space: ParameterSpace, values: FloatArray) -> BoolArray:
        """Mask of the sets that are stable in every region.

        Parameters
        ----------
        values : (n_sets, n_parameters) array
            In design columns and in each region's convention.

        Returns
        -------
        (n_sets,) array of bool
        """
        keep = np.ones(len(values), dtype=np.bool_)
        if not len(values):
            return keep
        rows = [space.thetas(row) for row in values]
        for region in space.regions:
            thetas = np.array([row[region.region] for row in rows])
            keep &= self.stable(region.material, thetas)
        return keep

    def reason(self, space: ParameterSpace, row: FloatArray) -> str:
        """Region, mode and stretch at which a set (n_parameters,) is least stable."""
        from palpate_materials.least_stiffness import least_stiffness

        states = list(
            zip(self._stretches(), np.repeat(self.settings.modes, self.settings.n_stretches), strict=True)
        )
        found = {}
        for region in space.regions:
            theta = space.thetas(row)[region.region][None]
            for state, mode in states:
                margin = float(np.asarray(least_stiffness(region.material, state[None], theta))[0])
                where = (
                    f"{region.region} has a stiffness of {margin:.3g} MPa at {mode} stretch {state[0]:.3g}"
                )
                # NaN, where the energy is undefined, is the least stable.
                found[where] = -np.inf if np.isnan(margin) else margin
        return min(found, key=lambda where: found[where])

    def stable(self, material: Material, thetas: FloatArray) -> BoolArray:
        """Mask (n_sets,) of the stable textbook parameter sets (n_sets, n_parameters) of one material."""
        # Imported here, so that JAX is not imported to list the plugins.
        from palpate_materials.least_stiffness import least_stiffness

        margin = np.asarray(least_stiffness(material, self._stretches(), thetas))
        # NaN, from a set for which the energy is undefined, is not stable.
        return np.asarray(margin > 0.0)

    def _stretches(self) -> FloatArray:
        """Principal stretches (n_modes · n_stretches, 3), at constant volume."""
        settings = self.settings
        t = np.geomspace(settings.least_stretch, settings.largest_stretch, settings.n_stretches)
        paths = {
            "uniaxial": np.stack([t, t**-0.5, t**-0.5], axis=-1),
            "equibiaxial": np.stack([t, t, t**-2.0], axis=-1),
            "planar": np.stack([t, np.ones_like(t), 1.0 / t], axis=-1),
        }
        return np.concatenate([paths[mode] for mode in settings.modes])
