"""Laws of stress, tangent and stability that hold for every isotropic material."""

import jax
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from palpate import mechanics
from palpate.domain import HomogeneousTests, Job
from palpate_jax.homogeneous import HomogeneousSettings, HomogeneousSolver
from palpate_materials import (
    ArrudaBoyce,
    Demiray,
    Drucker,
    Gent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    VerondaWestmann,
    Yeoh,
)
from palpate_materials.stability import DruckerSettings

MATERIALS = (
    Ogden(),
    Yeoh(),
    NeoHookean(),
    MooneyRivlin(),
    VerondaWestmann(),
    Demiray(),
    Gent(),
    ArrudaBoyce(),
)
stress_and_tangent = jax.jit(mechanics.stress_and_tangent, static_argnums=0)
entries = st.floats(-0.25, 0.25)
gradients = arrays(np.float64, (3, 3), elements=entries).map(lambda e: np.eye(3) + e)
shares = arrays(np.float64, (8,), elements=st.floats(0.0, 1.0))
rotations = arrays(np.float64, (3,), elements=st.floats(-3.0, 3.0)).map(
    lambda w: np.asarray(
        jax.scipy.linalg.expm(np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]))
    )
)
few = settings(max_examples=25, deadline=None)


def theta_of(material, share):
    lower, upper = np.array([[p.lower, p.upper] for p in material.parameters]).T
    return lower + (upper - lower) * share[: lower.size]


@pytest.mark.parametrize("material", MATERIALS, ids=lambda m: m.name)
@few
@given(F=gradients, share=shares, Q=rotations)
def test_stress_is_isotropic_objective_and_its_tangent_symmetric(material, F, share, Q):
    theta = theta_of(material, share)
    P, A = (np.asarray(x) for x in stress_and_tangent(material, F, theta))
    near = {"atol": 1e-10 * np.abs(A).max()}
    np.testing.assert_allclose(A, A.transpose(2, 3, 0, 1), **near)
    # Moment balance: P Fᵀ is symmetric.
    np.testing.assert_allclose(P @ F.T, F @ P.T, **near)
    turned, turned_A = (np.asarray(x) for x in stress_and_tangent(material, Q @ F, theta))
    np.testing.assert_allclose(turned, Q @ P, **near)
    np.testing.assert_allclose(turned_A, np.einsum("ip,kq,pJqL->iJkL", Q, Q, A), **near)
    other, _ = stress_and_tangent(material, F @ Q.T, theta)
    np.testing.assert_allclose(other, P @ Q.T, **near)


@pytest.mark.parametrize("material", MATERIALS, ids=lambda m: m.name)
@few
@given(
    share=shares,
    stretch=st.floats(0.8, 1.25),
    pair=st.sampled_from([(0, 1), (0, 2), (1, 2)]),
    tiny=st.floats(0, 1e-5),
)
def test_tangent_is_continuous_through_equal_stretches(material, share, stretch, pair, tiny):
    theta = theta_of(material, share)
    equal = np.full(3, 1.1)
    equal[list(pair)] = stretch
    apart = equal.copy()
    apart[pair[0]] *= 1 + tiny
    _, A = stress_and_tangent(material, np.diag(equal), theta)
    _, B = stress_and_tangent(material, np.diag(apart), theta)
    assert np.isfinite(A).all()
    np.testing.assert_allclose(A, B, atol=(100 * tiny + 1e-9) * np.abs(A).max())


UNIAXIAL = Drucker(DruckerSettings(modes=("uniaxial",)))
SOLVER = HomogeneousSolver(HomogeneousSettings(incompressible=True))
PATH = np.geomspace(0.3, 3.0, 61)


@few
@given(share=shares)
def test_true_stress_of_a_stable_set_rises_along_the_mode(share):
    yeoh = MATERIALS[1]
    theta = theta_of(yeoh, share) * [1, 2, 3, 1]  # the paper's numbers: about every third set is unstable
    if not UNIAXIAL.stable(yeoh, theta[None])[0]:
        return
    job = Job(
        spot="specimen",
        set_id=0,
        materials={"rubber": yeoh},
        thetas={"rubber": theta},
        protocol=HomogeneousTests(paths={"uniaxial": PATH}),
    )
    true_stress = SOLVER.simulate(job, None).response["uniaxial"].ordinate * PATH
    assert (np.diff(true_stress) > 0.0).all()
