"""Locking of FEBio's displacement elements: parts that have them, and the size of the excess."""

import numpy as np
import pytest

from palpate.api import relaxing
from palpate.domain import Indentation, Job
from palpate.domain.indenter import Sphere
from palpate.mesh.specimens import block
from palpate_febio.locking import EXCESS, locking_parts
from palpate_febio.solver import FebioSolver
from palpate_jax.solver import JaxSolver
from palpate_materials import NeoHookean, Ogden, Yeoh

OGDEN, NEO_HOOKEAN = np.array([0.06, 2.0, 0.84]), np.array([0.0735, 0.4434])


def job_of(material, theta):
    path = np.array([(0.0, 0.0), (1.5, 0.0), (3.0, 0.0)])
    protocol = Indentation(indenter=Sphere(radius_mm=7.5), path=path, friction=1.0)
    named = {"materials": {"soft_tissue": material}, "thetas": {"soft_tissue": theta}}
    return Job(spot="block", set_id=0, protocol=protocol, **named)


@pytest.mark.parametrize("kind", EXCESS)
def test_only_displacement_elements_lock(kind):
    limb = block(kind, n_across=4, n_down=2)
    solver = FebioSolver()
    for material, theta in ((Ogden(), OGDEN), (Yeoh(), np.array([0.0129, -1e-3, 9.2e-5, 0.6]))):
        assert (solver.locking(job_of(material, theta), limb) > 0.0) == (kind == "tet4")
    assert solver.locking(job_of(NeoHookean(), NEO_HOOKEAN), limb) > 0.0
    assert JaxSolver().locking(job_of(NeoHookean(), NEO_HOOKEAN), limb) == 0.0


@pytest.mark.parametrize("kind", EXCESS)
def test_locking_grows_with_the_bulk_modulus_and_falls_with_the_edge(kind):
    def at(poisson, n_across):
        limb = block(kind, n_across=n_across, n_down=n_across // 2)
        thetas = {"soft_tissue": np.array([0.0735, poisson])}
        return locking_parts(limb, {"soft_tissue": NeoHookean()}, thetas, 7.5)["soft_tissue", kind]

    assert at(0.40, 4) < at(0.45, 4) < at(0.49, 4)
    assert at(0.45, 4) > at(0.45, 6) > at(0.45, 8)


def test_tissue_that_relaxes_locks_as_its_elastic_material_at_once():
    limb, elastic = block("tet4", n_across=4, n_down=2), job_of(Ogden(), OGDEN)
    relaxes = job_of(relaxing(Ogden(), (0.5,), True), np.append(OGDEN, 0.3))
    assert FebioSolver().locking(relaxes, limb) == pytest.approx(FebioSolver().locking(elastic, limb))


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "n_across"), [("hex8", 8), ("tet10", 6), ("tet4", 8)])
def test_the_excess_is_the_embedded_solvers_without_mean_dilatation(kind, n_across):
    limb = block(kind, n_across=n_across, n_down=n_across // 2, grading=1.3)
    job = job_of(NeoHookean(), np.array([0.0735, 0.46]))
    settings = (JaxSolver.Settings.model_validate({"mean_dilatation": mean}) for mean in (True, False))
    right, locked = (JaxSolver(s).simulate(job, limb).response["force"].ordinate[-1] for s in settings)
    excess = FebioSolver().locking(job, limb)
    assert locked / right - 1.0 == pytest.approx(excess, rel=0.5)
