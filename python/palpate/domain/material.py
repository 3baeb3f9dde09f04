"""Materials: hyperelastic, each given by its energy alone."""

from abc import abstractmethod
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from palpate.domain.component import NO_FIELDS, Array, Component, SettingsT
from palpate.domain.curves import FloatArray
from palpate.domain.parameter import Parameter
from palpate.errors import MaterialError, ParameterError


def check_number(material: "HyperelasticMaterial[SettingsT]", theta: FloatArray) -> None:
    """Refuse more or fewer values than a material has parameters, with a ParameterError."""
    if len(theta) != len(material.parameters):
        raise ParameterError(
            f"material '{material.name}' takes {len(material.parameters)} parameters, got {len(theta)}"
        )


class HyperelasticMaterial(Component[SettingsT]):
    """Base of isotropic and anisotropic materials; subclass one of these.

    A material is given by its energy alone: stress, tangent, initial moduli and stability follow
    in :mod:`palpate.mechanics`. ``parameters`` may be a class attribute, or be set in ``__init__``
    where the settings decide how many there are.
    """

    parameters: tuple[Parameter, ...]

    conventions: Mapping[str, tuple[float, ...]] = MappingProxyType({})
    """Other ways to write the coefficients: textbook value = number × factor, by parameter."""

    fields: tuple[str, ...] = ()
    """Cell fields of the mesh that the energy takes: see :class:`AnisotropicMaterial`."""

    relaxation_times_s: tuple[float, ...] = ()
    """Time constants, each with a share of the stress that relaxes: the last parameters."""

    relaxes_isochoric: bool = False
    """Whether only the stress of the isochoric part of the energy, Ψ(J^(-1/3) F), relaxes."""

    def __eq__(self, other: object) -> bool:
        """Whether both have one class and equal settings, and so one energy: what is compiled is shared."""
        if self is other or not isinstance(other, HyperelasticMaterial):
            return self is other
        return type(self) is type(other) and bool(self.settings == other.settings)

    def __hash__(self) -> int:
        return hash(type(self))

    def to_textbook(self, values: FloatArray, convention: str) -> FloatArray:
        """Convert coefficients (n_parameters,) written in ``convention`` to textbook values.

        Raises
        ------
        MaterialError
            The convention is unknown to this material.
        """
        return values * np.array(self._factors(convention))

    def from_textbook(self, theta: FloatArray, convention: str) -> FloatArray:
        """Convert textbook values (n_parameters,) to ``convention``."""
        return theta / np.array(self._factors(convention))

    def _factors(self, convention: str) -> tuple[float, ...]:
        if convention == "textbook":
            return (1.0,) * len(self.parameters)
        if convention not in self.conventions:
            known = ", ".join(["textbook", *self.conventions])
            raise MaterialError(
                f"material '{self.name}' knows no convention '{convention}'; choose one of: {known}"
            )
        return self.conventions[convention]

    def check(self, theta: FloatArray) -> None:
        """Refuse textbook values outside the physical range of their parameter.

        Raises
        ------
        ParameterError
        """
        check_number(self, theta)
        for parameter, value in zip(self.parameters, theta, strict=True):
            parameter.check(float(value))


class IsotropicMaterial(HyperelasticMaterial[SettingsT]):
    """A hyperelastic material without directions: its energy is a function of the principal stretches."""

    @abstractmethod
    def energy(self, stretches: Array, theta: Array) -> Array:
        """Strain energy per reference volume.

        Parameters
        ----------
        stretches : (..., 3) array
            Principal stretches λ1, λ2, λ3; the energy is symmetric in them and zero at rest.
        theta : (n_parameters,) array
            Textbook values in the order of ``parameters``.

        Returns
        -------
        (...,) array
            Energy in MPa. Write it with the array's own namespace
            (``xp = stretches.__array_namespace__()``), so that numpy can check it and
            JAX can differentiate it.
        """


class AnisotropicMaterial(HyperelasticMaterial[SettingsT]):
    """A hyperelastic material with directions of its own, such as fibres.

    Its energy depends on more than the principal stretches, so it is given by the deformation
    gradient: through C = FᵀF and its invariants, I4 = a · C a for a fibre along the unit vector
    a of the undeformed body, all in the frame of the mesh. Everything else follows as for any
    material, by JAX alone.

    A direction that differs from element to element comes with the mesh, as a cell field: name it
    in ``fields``, as a class attribute or in ``__init__``. A study of several spots needs that,
    since each spot's mesh may be in a frame of its own; one direction in the settings is refused
    there, unless the study states that all meshes share a frame.
    """

    @abstractmethod
    def energy_from_F(  # noqa: N802
        self, F: Array, theta: Array, fields: Mapping[str, Array] = NO_FIELDS
    ) -> Array:
        """Strain energy per reference volume.

        Parameters
        ----------
        F : (3, 3) array
            Deformation gradient; the energy is zero at rest and does not change when a
            rotation follows.
        theta : (n_parameters,) array
            Textbook values in the order of ``parameters``.
        fields : mapping of name to () or (3,) array
            Values of this element, vectors in the frame of the mesh, for each name in
            ``self.fields``. Empty where there is no mesh, as when the moduli at rest are checked; a
            material without fields need not take the argument.

        Returns
        -------
        () array
            Energy in MPa, written in ``jax.numpy``.
        """


Material = IsotropicMaterial | AnisotropicMaterial
"""A material of either kind."""
