"""Contract tests that a plugin's own suite inherits.

Subclass the contract of what you provide, override its fixtures, and pytest
runs the laws that palpate relies on:

.. code-block:: python

    from palpate.testing import MaterialContract

    class TestMyTissue(MaterialContract):
        @pytest.fixture
        def material(self):
            return MyTissue()
"""

# ruff: noqa: D102 - the name of a test says what must hold

import itertools
import pickle
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Never

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from palpate import mechanics
from palpate.domain import (
    BoolArray,
    FloatArray,
    Job,
    Limb,
    ParameterSpace,
    Simulation,
    Spot,
    Status,
)
from palpate.errors import CurveError, MaterialError, MeshError, PalpateError
from palpate.interfaces import (
    Component,
    ExperimentLoader,
    LimbSource,
    Material,
    Sampler,
    SetFilter,
    Solver,
)

__all__ = [
    "LimbSourceContract",
    "LoaderContract",
    "MaterialContract",
    "SamplerContract",
    "SetFilterContract",
    "SolverContract",
]


# Compiled once for each material under test: shared by its tests.
_stress_and_tangent = jax.jit(mechanics.stress_and_tangent, static_argnums=0)


def _missing(fixture: str, contract: str) -> Never:
    pytest.fail(f"{contract}: override the fixture '{fixture}'")


def check_described(component: Component) -> None:
    """Assert that name, summary and every setting say what they are."""
    assert component.name.isidentifier(), f"name {component.name!r} must be an identifier"
    assert component.summary.strip(), f"'{component.name}' needs a summary"
    for name, field in type(component.settings).model_fields.items():
        assert field.description, f"setting '{name}' of '{component.name}' needs a description"


class ComponentContract:
    """What holds for every component."""

    @pytest.fixture
    def component(self) -> Component:
        """Provide the component under test; each contract fills it in."""
        _missing("component", type(self).__name__)

    def test_says_what_it_is(self, component: Component) -> None:
        check_described(component)

    def test_travels_to_another_process(self, component: Component) -> None:
        copy = pickle.loads(pickle.dumps(component))
        assert type(copy) is type(component)
        assert copy.settings == component.settings


# ------------------------------------------------------------------ materials


class MaterialContract(ComponentContract):
    """Laws of a hyperelastic material; override ``material``."""

    n_thetas = 4
    """Parameter sets drawn from the declared ranges."""

    largest_strain = 0.2
    """Largest entry of F − 1 that the material must bear over its declared ranges."""

    @pytest.fixture
    def material(self) -> Material:
        """Provide the material under test."""
        _missing("material", type(self).__name__)

    @pytest.fixture
    def component(self, material: Material) -> Component:
        """Provide the material."""
        return material

    @pytest.fixture
    def thetas(self, material: Material) -> FloatArray:
        """Provide textbook parameter sets: both ends of all ranges, and random points between."""
        lower, upper = np.array([[p.lower, p.upper] for p in material.parameters]).T
        inner = np.random.default_rng(0).random((self.n_thetas - 2, lower.size))
        thetas: FloatArray = lower + (upper - lower) * np.concatenate(
            [np.zeros((1, lower.size)), np.ones((1, lower.size)), inner]
        )
        return thetas

    @pytest.fixture
    def gradients(self) -> FloatArray:
        """Provide deformation gradients (6, 3, 3): rest, two and three equal stretches, and general ones."""
        e = self.largest_strain
        random = np.random.default_rng(1).uniform(-e, e, (3, 3, 3))
        special = [np.zeros((3, 3)), np.diag([e, -e / 2, -e / 2]), np.diag([e, e, e]) / 3]
        gradients: FloatArray = np.eye(3) + np.concatenate([special, random])
        return gradients

    def energies(self, material: Material, F: FloatArray, theta: FloatArray) -> FloatArray:
        """Evaluate the energy (n,) of F (n, 3, 3), by numpy where the material is isotropic."""
        if material.isotropic:
            stretches = np.linalg.svd(F, compute_uv=False)
            return np.asarray(material.energy(stretches, theta))
        return np.array([material.energy_from_F(jnp.asarray(f), jnp.asarray(theta)) for f in F])

    def stress(self, material: Material, F: FloatArray, theta: FloatArray) -> FloatArray:
        """Evaluate the first Piola–Kirchhoff stress (n, 3, 3) of F (n, 3, 3)."""
        return np.asarray(_stress_and_tangent(material, F, theta)[0])

    def test_parameters_say_what_they_are(self, material: Material) -> None:
        names = [p.name for p in material.parameters]
        assert names
        assert len(set(names)) == len(names)
        for p in material.parameters:
            assert p.name.isidentifier()
            assert p.description.strip(), f"parameter '{p.name}' needs a description"
            assert p.unit == ("MPa" if p.kind == "modulus" else ""), f"unit '{p.unit}' of a {p.kind}"

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

    def test_energy_of_a_stack_is_a_stack_of_energies(self, material: Material, thetas: FloatArray) -> None:
        if not material.isotropic:
            pytest.skip("an anisotropic energy takes one deformation gradient")
        stretches = np.random.default_rng(2).uniform(0.9, 1.1, (2, 3, 3))
        stacked = material.energy(stretches, thetas[-1])
        assert stacked.shape == (2, 3)
        one = material.energy(stretches[1, 2], thetas[-1])
        np.testing.assert_allclose(stacked[1, 2], one, rtol=1e-13, atol=1e-16)

    def test_energy_is_symmetric_in_the_stretches(self, material: Material, thetas: FloatArray) -> None:
        if not material.isotropic:
            pytest.skip("an anisotropic energy has no such symmetry")
        stretches = np.array([1.0 + self.largest_strain, 1.05, 1.0 - self.largest_strain])
        orders = np.array(list(itertools.permutations(stretches)))
        for theta in thetas:
            energy = material.energy(orders, theta)
            np.testing.assert_allclose(energy, energy[0], rtol=1e-12)

    def test_numpy_and_jax_agree(self, material: Material, thetas: FloatArray) -> None:
        if not material.isotropic:
            pytest.skip("an anisotropic energy is called by JAX only")
        stretches = np.random.default_rng(3).uniform(0.9, 1.1, (5, 3))
        for theta in thetas:
            traced = jax.jit(material.energy)(jnp.asarray(stretches), jnp.asarray(theta))
            np.testing.assert_allclose(traced, material.energy(stretches, theta), rtol=1e-11, atol=1e-15)

    def test_rotating_the_specimen_rotates_the_stress(
        self, material: Material, thetas: FloatArray, gradients: FloatArray
    ) -> None:
        Q, _ = np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))
        Q *= np.linalg.det(Q)
        theta = thetas[-1]
        before = self.energies(material, gradients, theta)
        np.testing.assert_allclose(
            self.energies(material, Q @ gradients, theta), before, rtol=1e-9, atol=1e-14
        )
        P = self.stress(material, gradients, theta)
        rotated = self.stress(material, Q @ gradients, theta)
        np.testing.assert_allclose(rotated, Q @ P, atol=1e-9 * np.abs(P).max())

    def test_stress_is_the_slope_of_the_energy(
        self, material: Material, thetas: FloatArray, gradients: FloatArray
    ) -> None:
        theta = thetas[-1]
        P = self.stress(material, gradients, theta)
        _, kappa = mechanics.initial_moduli(material, theta)
        step = 1e-5
        for i, j in np.ndindex(3, 3):
            dF = np.zeros((3, 3))
            dF[i, j] = step
            rise = self.energies(material, gradients + dF, theta) - self.energies(
                material, gradients - dF, theta
            )
            np.testing.assert_allclose(P[:, i, j], rise / (2 * step), atol=1e-6 * (kappa + np.abs(P).max()))

    def test_tangent_is_the_slope_of_the_stress(
        self, material: Material, thetas: FloatArray, gradients: FloatArray
    ) -> None:
        theta = thetas[-1]
        _, A = _stress_and_tangent(material, gradients, theta)
        step = 1e-6
        for k, m in np.ndindex(3, 3):
            dF = np.zeros((3, 3))
            dF[k, m] = step
            rise = self.stress(material, gradients + dF, theta) - self.stress(material, gradients - dF, theta)
            np.testing.assert_allclose(A[..., k, m], rise / (2 * step), atol=1e-6 * float(np.abs(A).max()))

    def test_moduli_scale_the_energy(
        self, material: Material, thetas: FloatArray, gradients: FloatArray
    ) -> None:
        factors = np.array([2.5 if p.kind == "modulus" else 1.0 for p in material.parameters])
        for theta in thetas:
            energy = self.energies(material, gradients, theta)
            scaled = self.energies(material, gradients, factors * theta)
            np.testing.assert_allclose(scaled, 2.5 * energy, rtol=1e-12, atol=1e-15)


# -------------------------------------------------------------------- solvers


class SolverContract(ComponentContract):
    """Laws of a solver; override ``solver``, ``job`` and, where it needs one, ``limb``."""

    scaling_tolerance = 1e-6
    """Largest relative deviation from: all moduli times s, then all ordinates times s."""

    @pytest.fixture
    def solver(self) -> Solver:
        """Provide the solver under test."""
        _missing("solver", type(self).__name__)

    @pytest.fixture
    def job(self) -> Job:
        """Provide a job that the solver can do, with materials whose moduli may be scaled."""
        _missing("job", type(self).__name__)

    @pytest.fixture
    def limb(self) -> Limb | None:
        """Provide the limb of the job."""
        return None

    @pytest.fixture
    def component(self, solver: Solver) -> Component:
        """Provide the solver."""
        return solver

    def test_version_is_constant(self, solver: Solver) -> None:
        assert solver.version().strip()
        assert solver.version() == solver.version()

    def test_simulates(self, solver: Solver, job: Job, limb: Limb | None) -> None:
        solver.check(job, limb)
        simulation = solver.simulate(job, limb)
        assert simulation.job is job
        assert simulation.status is Status.OK, simulation.message
        assert simulation.response is not None
        assert list(simulation.response)
        assert simulation.seconds >= 0.0

    def test_many_jobs_come_back_in_order(self, solver: Solver, job: Job, limb: Limb | None) -> None:
        jobs = [self.scaled(job, factor, set_id) for set_id, factor in enumerate((1.0, 1.5))]
        many = list(solver.simulate_many(iter(jobs), limb))
        assert [s.job.set_id for s in many] == [0, 1]
        for simulation, alone in zip(many, (solver.simulate(j, limb) for j in jobs), strict=True):
            self.assert_scaled(simulation, alone, 1.0)

    def test_moduli_scale_the_response(self, solver: Solver, job: Job, limb: Limb | None) -> None:
        simulation = solver.simulate(job, limb)
        self.assert_scaled(solver.simulate(self.scaled(job, 2.0, job.set_id), limb), simulation, 2.0)

    def scaled(self, job: Job, factor: float, set_id: int) -> Job:
        """Build the job with every modulus times ``factor``."""
        thetas = {
            region: theta
            * np.array([factor if p.kind == "modulus" else 1.0 for p in job.materials[region].parameters])
            for region, theta in job.thetas.items()
        }
        return replace(job, thetas=thetas, set_id=set_id)

    def assert_scaled(self, simulation: Simulation, reference: Simulation, factor: float) -> None:
        """Assert that every ordinate is ``factor`` times the reference's."""
        assert simulation.response is not None
        assert reference.response is not None
        assert set(simulation.response) == set(reference.response)
        for channel in reference.response:
            expected = factor * reference.response[channel].ordinate
            tolerance = self.scaling_tolerance * float(np.abs(expected).max())
            np.testing.assert_allclose(simulation.response[channel].ordinate, expected, atol=tolerance)


# -------------------------------------------------------- files of curves, limbs


class LoaderContract(ComponentContract):
    """Laws of an experiment loader; override ``loader``, ``good_file`` and ``bad_files``."""

    channel: str | None = None
    """Passed to ``load`` where a file holds one channel that the study names."""

    @pytest.fixture
    def loader(self) -> ExperimentLoader:
        """Provide the loader under test."""
        _missing("loader", type(self).__name__)

    @pytest.fixture
    def good_file(self, tmp_path: Path) -> Path:
        """Provide a file that it reads."""
        _missing("good_file", type(self).__name__)

    @pytest.fixture
    def bad_files(self, tmp_path: Path) -> Sequence[Path]:
        """Provide files that it must refuse, such as an empty one and one with text in a curve."""
        _missing("bad_files", type(self).__name__)

    @pytest.fixture
    def component(self, loader: ExperimentLoader) -> Component:
        """Provide the loader."""
        return loader

    def test_reads_curves(self, loader: ExperimentLoader, good_file: Path) -> None:
        response = loader.load(good_file, self.channel)
        assert list(response)
        for name in response:
            assert response[name].channel == name

    def test_refuses_bad_files_by_name(self, loader: ExperimentLoader, bad_files: Sequence[Path]) -> None:
        assert bad_files
        for path in bad_files:
            with pytest.raises(CurveError) as caught:
                loader.load(path, self.channel)
            assert path.name in str(caught.value)

    def test_reads_back_what_it_writes(self, loader: ExperimentLoader, good_file: Path) -> None:
        if type(loader).save is ExperimentLoader.save:
            pytest.skip("writes no curves")
        written, copy = loader.load(good_file, self.channel), good_file.with_stem("copy")
        loader.save(copy, written, self.channel)
        found = loader.load(copy, self.channel)
        assert set(found) == set(written)
        for name in written:
            np.testing.assert_allclose(found[name].abscissa, written[name].abscissa, rtol=1e-12)
            np.testing.assert_allclose(found[name].ordinate, written[name].ordinate, rtol=1e-12)

    def test_refuses_a_missing_file_by_name(self, loader: ExperimentLoader, good_file: Path) -> None:
        with pytest.raises(PalpateError) as caught:
            loader.load(good_file.with_name("no_such" + good_file.suffix), self.channel)
        assert "no_such" in str(caught.value)


class LimbSourceContract(ComponentContract):
    """Laws of a limb source; override ``limb_source``, ``good_file``, ``bad_files`` and ``spot``."""

    @pytest.fixture
    def limb_source(self) -> LimbSource:
        """Provide the limb source under test."""
        _missing("limb_source", type(self).__name__)

    @pytest.fixture
    def good_file(self, tmp_path: Path) -> Path:
        """Provide a file that it reads."""
        _missing("good_file", type(self).__name__)

    @pytest.fixture
    def bad_files(self, tmp_path: Path) -> Sequence[Path]:
        """Provide files that it must refuse."""
        _missing("bad_files", type(self).__name__)

    @pytest.fixture
    def spot(self) -> Spot:
        """Provide a spot on the limb of ``good_file``."""
        return Spot(name="p1")

    @pytest.fixture
    def component(self, limb_source: LimbSource) -> Component:
        """Provide the limb source."""
        return limb_source

    def test_makes_a_limb(self, limb_source: LimbSource, good_file: Path, spot: Spot) -> None:
        limb = limb_source.load(good_file, spot)
        assert limb.spot.name == spot.name
        assert limb.mesh.n_cells > 0
        assert limb.mesh.regions
        assert {"fixed", "contact"} <= set(limb.mesh.node_sets)

    def test_refuses_bad_files_by_name(
        self, limb_source: LimbSource, bad_files: Sequence[Path], spot: Spot
    ) -> None:
        assert bad_files
        for path in bad_files:
            with pytest.raises(MeshError) as caught:
                limb_source.load(path, spot)
            assert path.name in str(caught.value)


# --------------------------------------------------------------------- designs


class SamplerContract(ComponentContract):
    """Laws of a sampler; override ``sampler``."""

    @pytest.fixture
    def sampler(self) -> Sampler:
        """Provide the sampler under test."""
        _missing("sampler", type(self).__name__)

    @pytest.fixture
    def component(self, sampler: Sampler) -> Component:
        """Provide the sampler."""
        return sampler

    def test_draws_in_the_open_unit_cube(self, sampler: Sampler) -> None:
        points = sampler.draw(16, 3, 1)
        assert points.shape == (16, 3)
        assert ((points > 0.0) & (points < 1.0)).all()

    def test_a_seed_decides_the_draw(self, sampler: Sampler) -> None:
        points = sampler.draw(16, 3, 1)
        np.testing.assert_array_equal(points, sampler.draw(16, 3, 1))
        assert not np.array_equal(points, sampler.draw(16, 3, 2))

    def test_an_extension_begins_with_the_points_there_were(self, sampler: Sampler) -> None:
        points = sampler.draw(16, 3, 1)
        np.testing.assert_array_equal(sampler.extend(points, 32, 1)[:16], points)


class SetFilterContract(ComponentContract):
    """Laws of a set filter; override ``set_filter``, ``space`` and ``values``."""

    @pytest.fixture
    def set_filter(self) -> SetFilter:
        """Provide the filter under test."""
        _missing("set_filter", type(self).__name__)

    @pytest.fixture
    def space(self) -> ParameterSpace:
        """Provide what is searched."""
        _missing("space", type(self).__name__)

    @pytest.fixture
    def values(self) -> FloatArray:
        """Provide sets (n_sets, n_parameters) of which the filter keeps some and drops some."""
        _missing("values", type(self).__name__)

    @pytest.fixture
    def component(self, set_filter: SetFilter) -> Component:
        """Provide the filter."""
        return set_filter

    @pytest.fixture
    def kept(self, set_filter: SetFilter, space: ParameterSpace, values: FloatArray) -> BoolArray:
        """Provide its verdict on ``values``."""
        return set_filter.accept(space, values)

    def test_keeps_some_and_drops_some(self, values: FloatArray, kept: BoolArray) -> None:
        assert kept.shape == (len(values),)
        assert kept.dtype == np.bool_
        assert 0 < kept.sum() < len(values)

    def test_judges_each_set_for_itself(
        self, set_filter: SetFilter, space: ParameterSpace, values: FloatArray, kept: BoolArray
    ) -> None:
        np.testing.assert_array_equal(set_filter.accept(space, values[::-1]), kept[::-1])
        np.testing.assert_array_equal(set_filter.accept(space, values[:1]), kept[:1])

    def test_takes_no_sets_at_all(
        self, set_filter: SetFilter, space: ParameterSpace, values: FloatArray
    ) -> None:
        assert set_filter.accept(space, values[:0]).shape == (0,)
