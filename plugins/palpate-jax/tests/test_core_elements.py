"""Element kernels on meshes, for a material whose derivatives are written down here.

More of their laws are in ``crates/palpate-elements/tests``.
"""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate import _core
from palpate.mesh.specimens import block
from palpate_jax.body import blocks

MU, KAPPA = 0.07, 2.0


def energy(stretches):
    """μ/2 (Σ λ² − 3) − μ ln J + κ/2 (ln J)²."""
    log = np.log(stretches).sum(axis=-1)
    return 0.5 * MU * ((stretches**2).sum(axis=-1) - 3.0) - MU * log + 0.5 * KAPPA * log**2


def first(stretches):
    log = np.log(stretches).sum(axis=-1, keepdims=True)
    return MU * stretches + (KAPPA * log - MU) / stretches


def second(stretches):
    log = np.log(stretches).sum(axis=-1, keepdims=True)
    inverse = 1.0 / stretches
    diagonal = MU - (KAPPA * log - MU) * inverse**2
    return KAPPA * inverse[..., :, None] * inverse[..., None, :] + diagonal[..., None] * np.eye(3)


class Elements:
    """A small mesh of one kind, its forces and its dense stiffness."""

    def __init__(self, kind, mean):
        self.mesh = block(kind, n_across=2, n_down=2, width_mm=4.0, height_mm=3.0).mesh
        (part,) = blocks(self.mesh, mean)
        self.volumes, size = part.volumes, 3 * self.mesh.n_nodes
        unknowns = (3 * part.nodes[:, :, None] + np.arange(3)).reshape(len(part.nodes), -1)
        places = unknowns[:, :, None] * size + unknowns[:, None, :]
        self.block = _core.ElementBlock(
            part.nodes, part.gradients, part.volumes, mean_dilatation=mean, places=places
        )

    def energy(self, u):
        return float((self.volumes * energy(self.block.deform(u).stretches)).sum())

    def force(self, u):
        deformation, total = self.block.deform(u), np.zeros_like(u)
        deformation.add_force(first(deformation.stretches), total)
        return total

    def stiffness(self, u):
        deformation, values = self.block.deform(u), np.zeros(u.size**2)
        stretches = deformation.stretches
        deformation.add_stiffness(first(stretches), second(stretches), values)
        return values.reshape(u.size, u.size)


CASES = {(kind, mean): Elements(kind, mean) for kind in ("hex8", "tet10", "tet4") for mean in (True, False)}
STRETCHED = {"rest": np.ones(3), "pulled": np.array([1.3, 0.9, 0.9]), "sheared": np.array([1.2, 1.0, 0.8])}


@st.composite
def states(draw):
    """Elements and displacements about a homogeneous state, with or without noise."""
    elements = CASES[draw(st.sampled_from(sorted(CASES)))]
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    points = elements.mesh.points_mm
    u = points * (STRETCHED[draw(st.sampled_from(sorted(STRETCHED)))] - 1.0)
    return elements, u + draw(st.sampled_from([0.0, 1e-9, 0.05])) * rng.standard_normal(u.shape), rng


def turn(rng):
    q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    return q * np.linalg.det(q)


@given(states())
def test_turning_and_moving_the_body_turns_its_forces(state):
    elements, u, rng = state
    points, q = elements.mesh.points_mm, turn(rng)
    forces = elements.force(u)
    turned = elements.force((points + u) @ q.T + rng.standard_normal(3) - points)
    np.testing.assert_allclose(turned, forces @ q.T, rtol=0, atol=1e-12 + 1e-12 * np.abs(forces).max())


@given(states())
def test_forces_balance_have_no_moment_and_spin_with_the_body(state):
    elements, u, rng = state
    forces, stiffness = elements.force(u), elements.stiffness(u)
    size, now = 1e-3 + np.abs(forces).max(), elements.mesh.points_mm + u
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=1e-12 * size)
    np.testing.assert_allclose(np.cross(now, forces).sum(axis=0), 0.0, atol=1e-11 * size)
    spin = rng.standard_normal(3)
    rate = stiffness @ np.cross(spin, now).ravel()
    expected = np.cross(spin, forces).ravel()
    np.testing.assert_allclose(rate, expected, rtol=0, atol=1e-11 * np.abs(stiffness).max())


@given(states())
def test_forces_are_the_slope_of_the_energy_and_the_stiffness_theirs(state):
    elements, u, rng = state
    d, h = rng.standard_normal(u.shape), 1e-5
    forces, stiffness = elements.force(u), elements.stiffness(u)
    slope = (elements.energy(u + h * d) - elements.energy(u - h * d)) / (2.0 * h)
    assert (forces * d).sum() == pytest.approx(slope, abs=1e-6 * (1.0 + np.abs(forces).sum()))
    rate = (elements.force(u + h * d) - elements.force(u - h * d)).ravel() / (2.0 * h)
    np.testing.assert_allclose(stiffness @ d.ravel(), rate, atol=1e-6 * np.abs(rate).max())


@given(st.sampled_from(sorted(CASES)), st.integers(0, 2**32), st.floats(0.5, 30.0))
def test_inverted_elements_are_reported_and_never_a_number(case, seed, size):
    elements, rng = CASES[case], np.random.default_rng(seed)
    u = size * rng.standard_normal(elements.mesh.points_mm.shape)
    deformation, values = elements.block.deform(u), np.zeros(u.size**2)
    stretches = deformation.stretches
    sound = np.isfinite(stretches).all()
    assert sound == (deformation.least_jacobian > 0.0)
    deformation.add_stiffness(first(stretches), second(stretches), values)
    assert np.isfinite(values).all() == sound


def test_a_flipped_element_has_the_jacobian_of_the_flip():
    elements = CASES["hex8", True]
    u = np.zeros_like(elements.mesh.points_mm)
    u[:, 2] = -2.0 * elements.mesh.points_mm[:, 2]
    deformation = elements.block.deform(u)
    assert deformation.least_jacobian == pytest.approx(-1.0, rel=1e-12)
    assert np.isnan(deformation.stretches).all()


def test_two_calls_give_the_same_bits():
    elements = CASES["tet10", True]
    u = 0.05 * np.random.default_rng(1).standard_normal(elements.mesh.points_mm.shape)
    assert (elements.force(u) == elements.force(u)).all()
    assert (elements.stiffness(u) == elements.stiffness(u)).all()


def test_an_array_that_does_not_fit_is_refused():
    elements = CASES["hex8", True]
    n = elements.mesh.n_nodes
    u = np.zeros((n, 3))
    with pytest.raises(ValueError, match=f"displacements has {n - 1} rows, but the block refers to row"):
        elements.block.deform(u[:-1])
    with pytest.raises(TypeError, match="displacements"):
        elements.block.deform(u.astype(np.float32))
    deformation = elements.block.deform(u)
    psi = first(deformation.stretches)
    with pytest.raises(ValueError, match="psi_i has"):
        deformation.add_force(psi[1:], u)
    with pytest.raises(TypeError, match="total is changed in place: it must be contiguous"):
        deformation.add_force(psi, np.zeros((3, n)).T)
    with pytest.raises(ValueError, match="values has 5 rows"):
        deformation.add_stiffness(psi, second(deformation.stretches), np.zeros(5))


def test_axes_in_another_order_are_refused():
    """Their number of values is right; only the shape is wrong."""
    nodes, corner = np.tile([0, 1, 2, 3], (3, 1)), np.vstack([-np.ones(3), np.eye(3)])
    gradients, volumes = np.tile(corner, (3, 2, 1, 1)), np.full((3, 2), 1.0 / 12.0)
    swapped = np.ascontiguousarray(gradients.swapaxes(1, 2))
    with pytest.raises(ValueError, match=r"gradients has shape \[3, 4, 2, 3\] where \[3, 2, 4, 3\]"):
        _core.ElementBlock(nodes, swapped, volumes)
    with pytest.raises(ValueError, match=r"places has shape \[12, 3, 12\] where \[3, 12, 12\]"):
        _core.ElementBlock(nodes, gradients, volumes, places=np.zeros((12, 3, 12), dtype=np.int64))
    block = _core.ElementBlock(nodes, gradients, volumes, places=np.zeros((3, 12, 12), dtype=np.int64))
    with pytest.raises(ValueError, match=r"displacements has shape \[3, 4\] where \[3, 3\]"):
        block.deform(np.zeros((3, 4)))
    deformation = block.deform(np.zeros((4, 3)))
    psi_i, psi_ij = np.zeros((3, 2, 3)), np.zeros((3, 2, 3, 3))
    with pytest.raises(ValueError, match="psi_i has shape"):
        deformation.add_force(psi_i.swapaxes(0, 1), np.zeros((4, 3)))
    with pytest.raises(ValueError, match="total has shape"):
        deformation.add_force(psi_i, np.zeros((3, 4)))
    with pytest.raises(ValueError, match="psi_ij has shape"):
        deformation.add_stiffness(psi_i, psi_ij.swapaxes(0, 1), np.zeros(1))


def test_a_block_without_places_has_no_stiffness():
    nodes, gradients = np.array([[0, 1, 2, 3]]), np.vstack([-np.ones(3), np.eye(3)])
    bare = _core.ElementBlock(nodes, gradients[None, None], np.array([[1.0 / 6.0]]))
    deformation = bare.deform(np.zeros((4, 3)))
    stretches = deformation.stretches
    with pytest.raises(ValueError, match="no places"):
        deformation.add_stiffness(first(stretches), second(stretches), np.zeros(1))
    with pytest.raises(ValueError, match="element 0 has 0 mm³"):
        _core.ElementBlock(nodes, gradients[None, None], np.zeros((1, 1)))
    with pytest.raises(ValueError, match="nodes: element 0 has -1"):
        _core.ElementBlock(nodes - 1, gradients[None, None], np.ones((1, 1)))
