"""PARDISO in the place of the sparse factor: the same interface, the same answers, the same refusals."""

import numpy as np
import pytest
import scipy.sparse as sp

from palpate._core import SparseFactor
from palpate.domain import Indentation, Job, Sphere
from palpate.errors import PalpateError, StudyError
from palpate.specimens import block
from palpate_jax import pardiso
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.yeoh import Yeoh

installed = pytest.mark.skipif(not pardiso.is_installed(), reason="pypardiso is not installed")


@pytest.fixture
def stiffness() -> sp.csr_array:
    """A symmetric matrix of a grid, shaken so that it is indefinite."""
    n = 12
    chain = sp.diags_array([np.full(n, 2.0), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1])
    grid = sp.kronsum(chain, chain, format="csr")
    shake = sp.diags_array(np.where(np.arange(n * n) % 7 == 0, -9.0, 0.5))
    return sp.csr_array(grid + shake)


@installed
@pytest.mark.parametrize("kind", ["lu", "ldlt"])
def test_solutions_are_those_of_the_sparse_factor(stiffness, kind):
    ours = SparseFactor(stiffness.indptr, stiffness.indices, kind=kind, layout="csr")
    theirs = pardiso.PardisoFactor(stiffness.indptr, stiffness.indices, kind=kind)
    rhs = np.sin(np.arange(theirs.n))
    for scale in (1.0, 3.0):  # new values, the same analysis
        for factor in (ours, theirs):
            factor.factorise(scale * stiffness.data)
        np.testing.assert_allclose(theirs.solve(rhs), ours.solve(rhs), atol=1e-10)
        np.testing.assert_allclose(theirs.precondition(rhs), ours.solve(rhs), atol=1e-8)
    assert theirs.probe_error < 1e-8


@installed
def test_an_older_factor_preconditions_an_unsymmetric_matrix(stiffness):
    factor = pardiso.PardisoFactor(stiffness.indptr, stiffness.indices)
    factor.factorise(stiffness.data)
    data = stiffness.data * (1.0 + 0.05 * np.sin(np.arange(stiffness.nnz)))
    rhs = np.cos(np.arange(factor.n))
    solution, n_steps, converged = factor.krylov(data, rhs, 1e-9, 60)
    left = sp.csr_array((data, stiffness.indices, stiffness.indptr)) @ solution - rhs
    assert converged
    assert 3 < n_steps <= 60
    assert np.linalg.norm(left) <= 1e-9 * np.linalg.norm(rhs)
    assert not factor.krylov(data, rhs, 1e-9, 2)[2]


@installed
def test_what_cannot_be_solved_is_refused(stiffness):
    factor = pardiso.PardisoFactor(stiffness.indptr, stiffness.indices)
    with pytest.raises(ValueError, match="call factorise first"):
        factor.precondition(np.ones(factor.n))
    with pytest.raises(ValueError, match=r"data has shape \(2,\)"):
        factor.factorise(np.ones(2))
    with pytest.raises(ValueError, match=r"data\[0\] is nan"):
        factor.factorise(np.full(factor.n_data, np.nan))
    loose = sp.csr_array(sp.diags_array([[1.0, 2.0, 1.0], [-1.0, -1.0], [-1.0, -1.0]], offsets=[0, 1, -1]))
    singular = pardiso.PardisoFactor(loose.indptr, loose.indices)
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        singular.factorise(loose.data)
    with pytest.raises(ValueError, match="call factorise first"):
        singular.solve(np.ones(3))
    definite = pardiso.PardisoFactor(stiffness.indptr, stiffness.indices, kind="llt")
    with pytest.raises(np.linalg.LinAlgError, match="PARDISO ended with error"):
        definite.factorise(stiffness.data)
    with pytest.raises(ValueError, match="every diagonal entry"):
        pardiso.PardisoFactor(np.array([0, 1, 2]), np.array([1, 0]))


def test_its_absence_is_said_with_what_to_do(stiffness, monkeypatch):
    monkeypatch.setattr(pardiso, "find_spec", lambda name: None)
    with pytest.raises(PalpateError, match=r"palpate-jax\[pardiso\]"):
        pardiso.PardisoFactor(stiffness.indptr, stiffness.indices)


def press() -> Job:
    path = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, -10.0)])
    return Job(
        spot="block",
        set_id=0,
        materials={"soft_tissue": Yeoh()},
        thetas={"soft_tissue": np.array([0.0141, -0.0011, 1.05e-4, 0.4])},
        protocol=Indentation(indenter=Sphere(radius_mm=7.5), path=path, friction=0.6),
    )


SMALL = {"n_across": 4, "n_down": 2, "width_mm": 24.0, "height_mm": 10.0, "grading": 1.4}


@installed
def test_a_simulation_is_the_same_with_either_factor() -> None:
    limb = block("hex8", **SMALL)
    ours, theirs = (
        JaxSolver(JaxSettings(factors=by, tolerance=1e-9, depth_steps=3)).simulate(press(), limb)
        for by in ("palpate", "pardiso")
    )
    for channel in ("force", "torque"):
        expected = ours.response[channel].ordinate
        np.testing.assert_allclose(
            theirs.response[channel].ordinate, expected, atol=1e-7 * np.abs(expected).max()
        )


def test_a_study_that_asks_for_it_is_told_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate_jax.solver.is_installed", lambda: False)
    solver = JaxSolver(JaxSettings(factors="pardiso"))
    with pytest.raises(StudyError, match=r"not installed: pip install .palpate-jax\[pardiso\]"):
        solver.check(press(), block("hex8", **SMALL))
