"""Laws of stress, tangent and stability that hold for every isotropic material."""

import jax
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

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
gradients = arrays(np.float64, (3, 3), elements=st.floats(-0.25, 0.25)).map(lambda e: np.eye(3) + e)
shares = arrays(np.float64, (8,), elements=st.floats(0.0, 1.0))
rotations = st.integers(0, 2**32 - 1).map(
    lambda seed: Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
)
few = settings(max_examples=25, deadline=None)


def theta_of(material, share):
    lower, upper = np.array([[p.lower, p.upper] for p in material.parameters]).T
    return lower + (upper - lower) * share[: lower.size]


@pytest.mark.parametrize("material", MATERIALS, ids=lambda m: m.name)
@few
@given(F=gradients, share=shares, Q=rotations, R=rotations)
def test_stress_and_tangent_turn_with_space_and_with_the_specimen(material, F, share, Q, R):
    theta = theta_of(material, share)
    P, A = (np.asarray(x) for x in stress_and_tangent(material, F, theta))
    near = {"atol": 1e-10 * np.abs(A).max()}
    np.testing.assert_allclose(P @ F.T, F @ P.T, **near)  # balance of moments
    turned, turned_A = (np.asarray(x) for x in stress_and_tangent(material, Q @ F @ R.T, theta))
    np.testing.assert_allclose(turned, Q @ P @ R.T, **near)
    np.testing.assert_allclose(turned_A, np.einsum("ip,JM,kq,LN,pMqN->iJkL", Q, R, Q, R, A), **near)


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
