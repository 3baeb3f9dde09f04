"""Each law of a material fails, with the reason, on a material that breaks only this law."""

import jax
import jax.numpy as jnp
import pytest

from palpate import AnisotropicMaterial, IsotropicMaterial, Parameter
from palpate.api import NO_FIELDS
from palpate.testing import MaterialContract


def parameter(name, lower, upper, unit="MPa", kind="modulus"):
    return Parameter(name=name, unit=unit, lower=lower, upper=upper, kind=kind, description=f"the {name}")


class Sound(IsotropicMaterial):
    """Ψ = μ/2 (Ĩ1 − 3) + κ/2 (ln J)²."""

    name, summary = "sound", "neo-Hookean, without fault"
    parameters = (parameter("mu", 0.01, 0.1), parameter("kappa", 0.25, 2.5))

    def energy(self, stretches, theta):
        xp = stretches.__array_namespace__()
        J = xp.prod(stretches, axis=-1)
        excess = xp.sum(stretches**2, axis=-1) * J ** (-2 / 3) - 3
        return theta[0] / 2 * excess + theta[1] / 2 * xp.log(J) ** 2


class InKilopascal(Sound):
    parameters = (parameter("mu", 10.0, 100.0, unit="kPa"), *Sound.parameters[1:])


class EnergyInKilopascal(Sound):
    """Forgets that the energy is to be in MPa."""

    def energy(self, stretches, theta):
        return 1e3 * super().energy(stretches, theta)


class EnergyInGigapascal(Sound):
    def energy(self, stretches, theta):
        return 1e-3 * super().energy(stretches, theta)


class TooWide(Sound):
    """Gent's limit of chain extension, declared down to where ordinary strains pass it."""

    parameters = (*Sound.parameters, parameter("limit", 0.01, 1.0, unit="", kind="shape"))

    def energy(self, stretches, theta):
        xp = stretches.__array_namespace__()
        J = xp.prod(stretches, axis=-1)
        excess = xp.sum(stretches**2, axis=-1) * J ** (-2 / 3) - 3
        left = xp.where(excess < theta[2], 1 - excess / theta[2], xp.nan)
        return -theta[0] * theta[2] / 2 * xp.log(left) + theta[1] / 2 * xp.log(J) ** 2


class Offset(Sound):
    def energy(self, stretches, theta):
        return super().energy(stretches, theta) + 0.1 * theta[0]


class Prestressed(Sound):
    def energy(self, stretches, theta):
        return super().energy(stretches, theta) + 0.1 * theta[0] * (stretches - 1).sum(axis=-1)


class Lopsided(Sound):
    def energy(self, stretches, theta):
        return super().energy(stretches, theta) * (1 + 0.1 * (stretches[..., 0] - 1) ** 2)


class OutOfProportion(Sound):
    def energy(self, stretches, theta):
        return super().energy(stretches, theta) * (1 + theta[0])


class InF(AnisotropicMaterial):
    """The sound material, written in F."""

    name, summary, parameters = "in_f", "neo-Hookean, without fault", Sound.parameters

    def energy_from_F(self, F, theta):  # noqa: N802 - the interface's name
        J = jnp.linalg.det(F)
        excess = jnp.sum(F * F) * J ** (-2 / 3) - 3
        return theta[0] / 2 * excess + theta[1] / 2 * jnp.log(J) ** 2


class NotObjective(InF):
    """Reads a fibre's stretch off F itself, where C = FᵀF is what does not turn."""

    def energy_from_F(self, F, theta):  # noqa: N802
        return super().energy_from_F(F, theta) + theta[0] * (F[0, 0] - 1) ** 2


class Fibrous(InF):
    """Fibres along a cell field, in tension and compression."""

    name, summary, fields = "fibrous", "fibres of a cell field, without fault", ("a",)

    def energy_from_F(self, F, theta, fields=NO_FIELDS):  # noqa: N802
        matrix = super().energy_from_F(F, theta)
        return matrix + theta[0] * self.excess(F, fields) ** 2 if fields else matrix

    def excess(self, F, fields):
        return jnp.sum((F @ fields["a"]) ** 2) - 1


class FibresInTension(Fibrous):
    def energy_from_F(self, F, theta, fields=NO_FIELDS):  # noqa: N802
        return super().energy_from_F(F, theta, fields) + (
            0.1 * theta[0] * self.excess(F, fields) if fields else 0
        )


class FibresWithEnergy(Fibrous):
    def energy_from_F(self, F, theta, fields=NO_FIELDS):  # noqa: N802
        return super().energy_from_F(F, theta, fields) + (0.1 * theta[0] if fields else 0)


class FibresFixedInSpace(Fibrous):
    def excess(self, F, fields):
        return super().excess(F, fields) + fields["a"][0] * ((F.T @ F)[0, 0] - 1)


class FibresNotObjective(Fibrous):
    def excess(self, F, fields):
        return fields["a"] @ F @ fields["a"] - 1


class AnotherField(Fibrous):
    def excess(self, F, fields):
        return super().excess(F, {"a": fields["b"]})


@jax.custom_jvp
def swirl(F):
    return jnp.zeros_like(F[0, 0])


@swirl.defjvp
def _swirl_jvp(primals, tangents):
    (F,), (dF,) = primals, tangents
    return swirl(F), (F[0, 1] - F[1, 0]) * dF[0, 0] + 0.0 * F[0, 0]


class Swirling(InF):
    """Brings a derivative of its own that no energy has."""

    def energy_from_F(self, F, theta):  # noqa: N802
        return super().energy_from_F(F, theta) + theta[0] * swirl(F)


# One of each, so that the contract compiles it once.
CONTRACT, SOUND, IN_F, SWIRLING, FIBROUS = MaterialContract(), Sound(), InF(), Swirling(), Fibrous()


def hold(test, material):
    """Put one test of the contract to a material."""
    thetas = MaterialContract.thetas.__wrapped__(CONTRACT, material)
    gradients = MaterialContract.gradients.__wrapped__(CONTRACT)
    fields = MaterialContract.fields.__wrapped__(CONTRACT, material, gradients)
    offered = {"material": material, "thetas": thetas, "gradients": gradients, "fields": fields}
    method = getattr(CONTRACT, f"test_{test}")
    names = method.__code__.co_varnames[1 : method.__code__.co_argcount]
    method(**{name: offered[name] for name in names})


CASES = [
    ("parameters_say_what_they_are", InKilopascal(), "'mu' is a modulus in 'kPa': a modulus is in MPa"),
    ("energy_is_in_megapascals", EnergyInKilopascal(), "initial modulus of 250 MPa: is the energy in MPa"),
    ("energy_is_in_megapascals", EnergyInGigapascal(), "of 0.00025 MPa: is the energy in MPa"),
    ("energy_is_finite_and_positive_over_the_ranges", TooWide(), "narrow the declared ranges"),
    ("reference_state_is_sound", Offset(), "energy .* in the undeformed state"),
    ("reference_state_is_sound", Prestressed(), "stress .* in the undeformed state"),
    ("energy_is_symmetric_in_the_stretches", Lopsided(), "depends on the order of the stretches"),
    ("moduli_scale_the_energy", OutOfProportion(), "which parameter is a modulus"),
    ("rotating_the_specimen_rotates_the_stress", NotObjective(), "not objective"),
    ("tangent_is_symmetric", SWIRLING, "tangent is asymmetric"),
    ("stress_is_the_slope_of_the_energy", SWIRLING, "P00 is not the slope of the energy"),
    ("rotating_the_specimen_rotates_the_stress", FibresNotObjective(), "not objective"),
    ("fields_store_nothing_at_rest", FibresInTension(), "the undeformed state has a stress"),
    ("fields_store_nothing_at_rest", FibresWithEnergy(), "the undeformed state has an energy"),
    ("fields_turn_with_the_body", FibresFixedInSpace(), "is a direction fixed in space"),
    ("moduli_scale_the_energy", AnotherField(), "'b'"),
]


@pytest.mark.parametrize(("test", "material", "message"), CASES, ids=[type(m).__name__ for _, m, _ in CASES])
def test_a_fault_is_reported(test, material, message):
    with pytest.raises((AssertionError, ValueError, KeyError), match=f"(?s){message}"):
        hold(test, material)


@pytest.mark.parametrize("test", sorted({test for test, _, _ in CASES}))
def test_a_sound_material_passes(test):
    if "fields" in test:
        hold(test, FIBROUS)
        return
    hold(test, SOUND)
    if test != "energy_is_symmetric_in_the_stretches":
        hold(test, IN_F)


class Slow(Sound):
    """With a time constant, which scales with no modulus and has a unit."""

    parameters = (
        *Sound.parameters,
        Parameter(name="tau", unit="s", lower=0.1, upper=1.0, kind="shape", description="time constant"),
    )


def test_a_time_constant_is_a_parameter():
    hold("parameters_say_what_they_are", Slow())
