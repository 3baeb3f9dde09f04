"""Laws of materials."""

import itertools
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import ArrayLike

from palpate import mechanics
from palpate.domain import FloatArray
from palpate.domain.component import NO_FIELDS, Array
from palpate.domain.material import AnisotropicMaterial, IsotropicMaterial, Material
from palpate.errors import MaterialError
from palpate.testing.components import ComponentContract, overridden


def _same(
    got: ArrayLike, expected: ArrayLike, message: str, *, rtol: float = 1e-7, atol: float = 0.0
) -> None:
    found, known = (np.asarray(values, dtype=np.float64) for values in (got, expected))
    np.testing.assert_allclose(found, known, rtol=rtol, atol=atol, err_msg=message)


# Compiled once for each material under test: shared by its tests.
Fields: TypeAlias = Mapping[str, FloatArray]

_stress_and_tangent = jax.jit(mechanics.stress_and_tangent, static_argnums=0)


def _rotation(seed: int) -> FloatArray:
    Q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    return Q * np.linalg.det(Q)


@partial(jax.jit, static_argnums=0)
def _energies_from_F(  # noqa: N802
    material: AnisotropicMaterial, F: FloatArray, theta: FloatArray, fields: Fields
) -> Array:
    if not fields:
        return jax.vmap(lambda f: material.energy_from_F(f, theta))(F)
    return jax.vmap(lambda f, own: material.energy_from_F(f, theta, own))(F, fields)


def _slopes(
    function: Callable[[FloatArray], FloatArray], F: FloatArray, step: float
) -> Iterator[tuple[int, int, FloatArray]]:
    """Row and column of each entry of gradients (n, 3, 3), and the central difference in it."""
    for i, j in np.ndindex(3, 3):
        dF = np.zeros((3, 3))
        dF[i, j] = step
        yield i, j, (function(F + dF) - function(F - dF)) / (2.0 * step)


class MaterialContract(ComponentContract):
    """Laws of a hyperelastic material; override ``material``."""

    n_thetas = 4
    """Parameter sets drawn from the declared ranges."""

    largest_strain = 0.2
    """Largest entry of F − 1 that the material must bear over its declared ranges."""

    largest_ratio = 300.0
    """Most that the larger initial modulus may differ from the largest modulus parameter, as a factor."""

    material = overridden("the material under test")

    component = pytest.fixture(lambda self, material: material)

    @pytest.fixture
    def thetas(self, material: Material) -> FloatArray:
        """Provide textbook parameter sets: both ends of all ranges, and random points between."""
        lower, upper = np.array([[p.lower, p.upper] for p in material.parameters]).T
        inner = np.random.default_rng(0).random((self.n_thetas - 2, lower.size))
        return lower + (upper - lower) * np.concatenate(
            [np.zeros((1, lower.size)), np.ones((1, lower.size)), inner]
        )

    @pytest.fixture
    def gradients(self) -> FloatArray:
        """Provide deformation gradients (6, 3, 3): rest, two and three equal stretches, and general ones.

        Override it where the energy has a kink at one of them: no tangent is exact there.
        """
        e = self.largest_strain
        random = np.random.default_rng(1).uniform(-e, e, (3, 3, 3))
        special = [np.zeros((3, 3)), np.diag([e, -e / 2, -e / 2]), np.diag([e, e, e]) / 3]
        return np.eye(3) + np.concatenate([special, random])

    @pytest.fixture
    def fields(self, material: Material, gradients: FloatArray) -> Fields:
        """Provide values at each of ``gradients`` of the cell fields that the material declares.

        They are random unit vectors (n, 3); override it where a field is a number (n,).
        """
        random = np.random.default_rng(5).standard_normal((len(material.fields), len(gradients), 3))
        unit = random / np.linalg.norm(random, axis=-1, keepdims=True)
        return dict(zip(material.fields, unit, strict=True))

    def energies(
        self, material: Material, F: FloatArray, theta: FloatArray, fields: Fields = NO_FIELDS
    ) -> FloatArray:
        """Evaluate the energy (n,) of F (n, 3, 3), by numpy where the material is isotropic."""
        if isinstance(material, IsotropicMaterial):
            stretches = np.linalg.svd(F, compute_uv=False)
            return np.asarray(material.energy(stretches, theta))
        return np.asarray(_energies_from_F(material, F, theta, dict(fields)))

    def stress(
        self, material: Material, F: FloatArray, theta: FloatArray, fields: Fields = NO_FIELDS
    ) -> FloatArray:
        """Evaluate the first Piola–Kirchhoff stress (n, 3, 3) of F (n, 3, 3)."""
        return np.asarray(_stress_and_tangent(material, F, theta, dict(fields))[0])

    def test_parameters_say_what_they_are(self, material: Material) -> None:
        names = [p.name for p in material.parameters]
        assert names, "a material needs parameters"
        assert len(set(names)) == len(names), f"parameters of one name: {names}"
        for p in material.parameters:
            assert p.name.isidentifier(), f"parameter name {p.name!r} must be an identifier"
            assert p.description.strip(), f"parameter '{p.name}' needs a description"
            assert p.unit in (("MPa",) if p.kind == "modulus" else ("", "1", "s")), (
                f"parameter '{p.name}' is a {p.kind} in '{p.unit}': a modulus is in MPa, a shape has no "
                "unit, or s where it is a time constant"
            )

    def test_refuses_the_wrong_number_of_parameters(self, material: Material, thetas: FloatArray) -> None:
        material.check(thetas[0])
        with pytest.raises(MaterialError):
            material.check(thetas[0][:-1])

    def test_conventions_convert_both_ways(self, material: Material, thetas: FloatArray) -> None:
        for convention in ("textbook", *material.conventions):
            there = material.from_textbook(thetas[0], convention)
            np.testing.assert_allclose(material.to_textbook(there, convention), thetas[0], rtol=1e-15)
        with pytest.raises(MaterialError, match="textbook"):
            material.to_textbook(thetas[0], "no such convention")

    def test_reference_state_is_sound(self, material: Material, thetas: FloatArray) -> None:
        for theta in thetas:
            mechanics.check_reference_state(material, theta)

    def test_energy_is_in_megapascals(self, material: Material, thetas: FloatArray) -> None:
        for theta in thetas:
            stiffest = max(mechanics.initial_moduli(material, theta))
            largest = max(
                abs(x) for x, p in zip(theta, material.parameters, strict=True) if p.kind == "modulus"
            )
            assert largest / self.largest_ratio <= stiffest <= largest * self.largest_ratio, (
                f"moduli of at most {largest:g} MPa give an initial modulus of {stiffest:g} MPa: "
                "is the energy in MPa, that is N·mm per mm³?"
            )

    def test_energy_is_finite_and_positive_over_the_ranges(
        self, material: Material, thetas: FloatArray, gradients: FloatArray, fields: Fields
    ) -> None:
        for theta in thetas:
            energy = self.energies(material, gradients, theta, fields)
            rest = np.abs(gradients - np.eye(3)).max(axis=(1, 2)) == 0.0
            bad = np.flatnonzero(~(np.isfinite(energy) & (rest | (energy > 0.0))))
            assert not bad.size, (
                f"at theta = {theta.tolist()} the energy of F = {gradients[bad[0]].round(3).tolist()} is "
                f"{energy[bad[0]]:g} MPa; narrow the declared ranges, or lower `largest_strain`"
            )

    def test_energy_of_a_stack_is_a_stack_of_energies(self, material: Material, thetas: FloatArray) -> None:
        if not isinstance(material, IsotropicMaterial):
            pytest.skip("an anisotropic energy takes one deformation gradient")
        stretches = np.random.default_rng(2).uniform(0.9, 1.1, (2, 3, 3))
        stacked = material.energy(stretches, thetas[-1])
        assert stacked.shape == (2, 3), f"energies of (2, 3, 3) stretches have shape {stacked.shape}"
        one = material.energy(stretches[1, 2], thetas[-1])
        np.testing.assert_allclose(stacked[1, 2], one, rtol=1e-13, atol=1e-16)

    def test_energy_is_symmetric_in_the_stretches(self, material: Material, thetas: FloatArray) -> None:
        if not isinstance(material, IsotropicMaterial):
            pytest.skip("an anisotropic energy has no such symmetry")
        stretches = np.array([1.0 + self.largest_strain, 1.05, 1.0 - self.largest_strain])
        orders = np.array(list(itertools.permutations(stretches)))
        for theta in thetas:
            energy = material.energy(orders, theta)
            _same(energy, energy[0], "energy depends on the order of the stretches", rtol=1e-12)

    def test_numpy_and_jax_agree(self, material: Material, thetas: FloatArray) -> None:
        if not isinstance(material, IsotropicMaterial):
            pytest.skip("an anisotropic energy is called by JAX only")
        stretches = np.random.default_rng(3).uniform(0.9, 1.1, (5, 3))
        for theta in thetas:
            traced = jax.jit(material.energy)(jnp.asarray(stretches), jnp.asarray(theta))
            np.testing.assert_allclose(traced, material.energy(stretches, theta), rtol=1e-11, atol=1e-15)

    def test_rotating_the_specimen_rotates_the_stress(
        self, material: Material, thetas: FloatArray, gradients: FloatArray, fields: Fields
    ) -> None:
        Q = _rotation(4)
        theta = thetas[-1]
        before = self.energies(material, gradients, theta, fields)
        after = self.energies(material, Q @ gradients, theta, fields)
        _same(after, before, "not objective: a rotation after F changes the energy", rtol=1e-9, atol=1e-14)
        P = self.stress(material, gradients, theta, fields)
        rotated = self.stress(material, Q @ gradients, theta, fields)
        off = 1e-9 * float(np.abs(P).max())
        _same(rotated, Q @ P, "not objective: a rotation after F does not rotate the stress", atol=off)

    def test_stress_is_the_slope_of_the_energy(
        self, material: Material, thetas: FloatArray, gradients: FloatArray, fields: Fields
    ) -> None:
        theta = thetas[-1]
        P = self.stress(material, gradients, theta, fields)
        _, kappa = mechanics.initial_moduli(material, theta)
        off = 1e-6 * (kappa + float(np.abs(P).max()))
        for i, j, slope in _slopes(lambda F: self.energies(material, F, theta, fields), gradients, 1e-5):
            _same(P[:, i, j], slope, f"P{i}{j} is not the slope of the energy", atol=off)

    def test_tangent_is_symmetric(
        self, material: Material, thetas: FloatArray, gradients: FloatArray, fields: Fields
    ) -> None:
        _, A = _stress_and_tangent(material, gradients, thetas[-1], dict(fields))
        swapped, off = np.transpose(A, (0, 3, 4, 1, 2)), 1e-9 * float(np.abs(A).max())
        _same(A, swapped, "the tangent is asymmetric: no energy has this stress", atol=off)

    def test_tangent_is_the_slope_of_the_stress(
        self, material: Material, thetas: FloatArray, gradients: FloatArray, fields: Fields
    ) -> None:
        theta = thetas[-1]
        _, A = _stress_and_tangent(material, gradients, theta, dict(fields))
        off = 1e-6 * float(np.abs(A).max())
        for k, m, slope in _slopes(lambda F: self.stress(material, F, theta, fields), gradients, 1e-6):
            _same(A[..., k, m], slope, f"∂P/∂F{k}{m} is not the slope of the stress", atol=off)

    def test_moduli_scale_the_energy(
        self, material: Material, thetas: FloatArray, gradients: FloatArray, fields: Fields
    ) -> None:
        factors = np.array([2.5 if p.kind == "modulus" else 1.0 for p in material.parameters])
        for theta in thetas:
            energy = self.energies(material, gradients, theta, fields)
            scaled = self.energies(material, gradients, factors * theta, fields)
            message = "all moduli times 2.5 is not the energy times 2.5: which parameter is a modulus?"
            _same(scaled, 2.5 * energy, message, rtol=1e-12, atol=1e-15)

    def test_fields_store_nothing_at_rest(
        self, material: Material, thetas: FloatArray, fields: Fields
    ) -> None:
        if not fields:
            pytest.skip("takes no cell fields")
        rest = np.broadcast_to(np.eye(3), (len(next(iter(fields.values()))), 3, 3))
        largest = float(np.abs(thetas[-1]).max())
        energy = self.energies(material, rest, thetas[-1], fields)
        _same(energy, 0.0, "with cell fields, the undeformed state has an energy", atol=1e-9 * largest)
        for *_, slope in _slopes(lambda F: self.energies(material, F, thetas[-1], fields), rest, 1e-5):
            _same(slope, 0.0, "with cell fields, the undeformed state has a stress", atol=1e-6 * largest)

    def test_fields_turn_with_the_body(
        self, material: Material, thetas: FloatArray, gradients: FloatArray, fields: Fields
    ) -> None:
        if not fields:
            pytest.skip("takes no cell fields")
        Q = _rotation(6)
        turned = {name: each @ Q.T if each.ndim > 1 else each for name, each in fields.items()}
        before = self.energies(material, gradients, thetas[-1], fields)
        after = self.energies(material, gradients @ Q.T, thetas[-1], turned)
        message = "body and cell fields turned together have another energy; is a direction fixed in space?"
        _same(after, before, message, rtol=1e-9, atol=1e-14)
