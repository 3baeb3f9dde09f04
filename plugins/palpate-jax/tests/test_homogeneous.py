"""The homogeneous-test solver against closed forms, and what it refuses."""

import pickle

import numpy as np
import pytest

from palpate.domain import HomogeneousTests, Indentation, Job, Status
from palpate.domain.indenter import Sphere
from palpate.domain.material import IsotropicMaterial
from palpate.errors import CurveError, MaterialError, SolverError
from palpate.testing import SolverContract
from palpate_jax.homogeneous import CHANNELS, MODES, HomogeneousSettings, HomogeneousSolver
from palpate_materials import Demiray, MooneyRivlin, NeoHookean, Ogden, Yeoh

STRETCHES = np.concatenate([np.linspace(1.0, 2.5, 16), np.linspace(0.95, 0.4, 12)])
FREE = ("uniaxial", "equibiaxial", "pure_shear")
COMPRESSIBLE = HomogeneousSolver()
INCOMPRESSIBLE = HomogeneousSolver(HomogeneousSettings(incompressible=True))
MOONEY = np.array([0.02, 0.01, 1.0])


def job(material, theta, paths, set_id=0):
    return Job(
        spot="specimen",
        set_id=set_id,
        materials={"rubber": material},
        thetas={"rubber": np.asarray(theta, dtype=float)},
        protocol=HomogeneousTests(paths=paths),
    )


def stresses(solver, material, theta, modes=FREE, path=STRETCHES):
    simulation = solver.simulate(job(material, theta, dict.fromkeys(modes, path)), None)
    assert simulation.status is Status.OK, simulation.message
    return {mode: simulation.response[mode].ordinate for mode in modes}


@pytest.mark.slow
class TestCompressible(SolverContract):
    @pytest.fixture
    def solver(self):
        return COMPRESSIBLE

    @pytest.fixture
    def job(self):
        return job(NeoHookean(), [0.0735, 0.4434], dict.fromkeys(MODES, np.linspace(0.7, 1.6, 8)))

    @pytest.fixture
    def hopeless(self):
        return job(Torn(), [0.1, 0.45], {"uniaxial": PATH})


def test_every_mode_is_a_channel():
    assert [channel.name for channel in CHANNELS] == list(MODES)
    assert all(channel.ordinate == "stress_MPa" for channel in CHANNELS)


def test_incompressible_mooney_rivlin_is_the_closed_form():
    t = STRETCHES
    c10, c01, _ = MOONEY
    got = stresses(INCOMPRESSIBLE, MooneyRivlin(), MOONEY)
    np.testing.assert_allclose(got["uniaxial"], 2 * (t - t**-2) * (c10 + c01 / t), atol=1e-13)
    np.testing.assert_allclose(got["equibiaxial"], 2 * (t - t**-5) * (c10 + c01 * t**2), atol=1e-12)
    np.testing.assert_allclose(got["pure_shear"], 2 * (t - t**-3) * (c10 + c01), atol=1e-13)


def test_simple_shear_and_confined_compression_are_the_closed_forms():
    shear = np.linspace(-1.0, 1.5, 9)
    got = stresses(COMPRESSIBLE, MooneyRivlin(), MOONEY, ("simple_shear",), shear)["simple_shear"]
    np.testing.assert_allclose(got, 2 * (MOONEY[0] + MOONEY[1]) * shear, atol=1e-13)
    E, nu = 0.0735, 0.4434
    mu, lame = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    t = np.linspace(1.2, 0.5, 8)
    got = stresses(COMPRESSIBLE, NeoHookean(), [E, nu], ("confined_compression",), t)["confined_compression"]
    np.testing.assert_allclose(got, mu * (t - 1 / t) + lame * np.log(t) / t, atol=1e-13)


def test_free_faces_carry_no_load():
    """In uniaxial tension of coupled neo-Hookean, μ(y² - 1) + λ ln J = 0 decides y."""
    E, nu = 0.0735, 0.40
    mu, lame = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    t = np.array([0.5, 0.8, 1.3, 2.0, 3.0])
    P = stresses(COMPRESSIBLE, NeoHookean(), [E, nu], ("uniaxial",), t)["uniaxial"]
    # P = (μ(t² - 1) + λ ln J)/t gives ln J; y then follows from J = t y².
    log_J = (P * t - mu * (t**2 - 1)) / lame
    y_squared = np.exp(log_J) / t
    np.testing.assert_allclose(mu * (y_squared - 1) + lame * log_J, 0.0, atol=1e-12)


@pytest.mark.slow
def test_initial_slopes_are_the_linear_elastic_ones():
    E, nu, e = 0.0735, 0.4434, 1e-6
    path = np.array([1.0, 1.0 + e])
    got = stresses(COMPRESSIBLE, NeoHookean(), [E, nu], MODES[:3], path)
    slope = {mode: stress[1] / e for mode, stress in got.items()}
    assert slope["uniaxial"] == pytest.approx(E, rel=1e-4)
    assert slope["equibiaxial"] == pytest.approx(E / (1 - nu), rel=1e-4)
    assert slope["pure_shear"] == pytest.approx(E / (1 - nu**2), rel=1e-4)


@pytest.mark.slow
def test_a_large_bulk_modulus_makes_it_incompressible():
    path = np.linspace(0.6, 1.8, 7)
    stiff = stresses(COMPRESSIBLE, Yeoh(), [0.0129, -1e-4, 9e-5, 1e4], FREE, path)
    exact = stresses(INCOMPRESSIBLE, Yeoh(), [0.0129, -1e-4, 9e-5, 1.0], FREE, path)
    for mode in FREE:
        np.testing.assert_allclose(stiff[mode], exact[mode], atol=1e-4 * np.abs(exact[mode]).max())


def test_equilibrium_is_found_far_out_on_an_exponential():
    """The search starts where the energy is of order exp(480)."""
    got = stresses(COMPRESSIBLE, Demiray(), [0.05, 4.0, 1.0], ("equibiaxial",), np.array([0.5, 0.4, 0.3]))
    P = got["equibiaxial"]
    assert (np.diff(P) < 0).all()
    assert (np.abs(P) < 50).all()


class Torn(IsotropicMaterial):
    """Loses its energy beyond λ = 2."""

    name = "torn"
    summary = "test material"
    parameters = NeoHookean.parameters

    def energy(self, stretches, theta):
        xp = stretches.__array_namespace__()
        whole = xp.max(stretches, axis=-1) < 2.0
        return xp.where(whole, NeoHookean().energy(stretches, theta), xp.nan)


class Broken(NeoHookean):
    name = "broken"

    def energy(self, stretches, theta):
        raise RuntimeError("no such tissue")


PATH = np.array([1.0, 1.5, 1.9, 2.5, 3.0])


def test_a_failure_keeps_the_curve_before_it():
    simulation = COMPRESSIBLE.simulate(job(Torn(), [0.1, 0.45], {"uniaxial": PATH}), None)
    assert simulation.status is Status.DIVERGED
    assert "uniaxial: no equilibrium at 2.5 (index 3)" in simulation.message
    np.testing.assert_array_equal(simulation.response["uniaxial"].abscissa, PATH[:3])


def test_failure_at_the_first_point_has_no_response():
    simulation = COMPRESSIBLE.simulate(job(Torn(), [0.1, 0.45], {"uniaxial": PATH[::-1]}), None)
    assert simulation.status is Status.DIVERGED
    assert simulation.response is None


def test_an_energy_that_raises_is_a_crash_of_its_jobs():
    jobs = [
        job(Broken(), [0.1, 0.45], {"uniaxial": PATH}, 0),
        job(NeoHookean(), [0.1, 0.45], {"uniaxial": PATH}, 1),
        job(NeoHookean(), [0.1, 0.60], {"uniaxial": PATH}, 2),
        job(NeoHookean(), [0.2, 0.45], {"uniaxial": PATH}, 3),
    ]
    done = list(COMPRESSIBLE.simulate_many(jobs, None))
    assert [s.job.set_id for s in done] == [0, 1, 2, 3]
    assert [s.status for s in done] == [Status.CRASHED, Status.OK, Status.DIVERGED, Status.OK]
    assert "no such tissue" in done[0].message
    assert "'nu' = 0.6" in done[2].message
    np.testing.assert_allclose(
        done[3].response["uniaxial"].ordinate, 2 * done[1].response["uniaxial"].ordinate, rtol=1e-9
    )


def test_equal_materials_share_what_was_compiled():
    solver = HomogeneousSolver()
    for _ in range(2):
        solver.simulate(job(NeoHookean(), [0.1, 0.45], {"confined_compression": PATH}), None)
    assert len(solver._compiled) == 1
    assert not pickle.loads(pickle.dumps(solver))._compiled


@pytest.mark.parametrize(
    ("solver", "bad", "error", "what"),
    [
        (COMPRESSIBLE, {"paths": {"torsion": PATH}}, SolverError, "channel 'torsion'"),
        (COMPRESSIBLE, {"paths": {"uniaxial": PATH - 1.0}}, CurveError, "value 0.0 at index 0"),
        (COMPRESSIBLE, {"paths": {"uniaxial": [1.0, np.nan]}}, CurveError, "at index 1"),
        (INCOMPRESSIBLE, {"paths": {"confined_compression": PATH}}, SolverError, "changes the volume"),
        (COMPRESSIBLE, {"theta": [0.1, 0.5]}, MaterialError, "physical range"),
        (COMPRESSIBLE, {"theta": [0.1]}, MaterialError, "takes 2 parameters"),
    ],
)
def test_check_refuses(solver, bad, error, what):
    defaults = {"material": NeoHookean(), "theta": [0.1, 0.45], "paths": {"uniaxial": PATH}}
    with pytest.raises(error, match=what):
        solver.check(job(**defaults | bad), None)


def test_check_refuses_two_regions_and_indentation():
    one = job(NeoHookean(), [0.1, 0.45], {"uniaxial": PATH})
    two = Job(
        spot="specimen",
        set_id=0,
        materials={"skin": NeoHookean(), "fat": NeoHookean()},
        thetas={"skin": one.thetas["rubber"], "fat": one.thetas["rubber"]},
        protocol=one.protocol,
    )
    with pytest.raises(SolverError, match="one region, not 2"):
        COMPRESSIBLE.check(two, None)

    pressed = Job(
        spot="specimen",
        set_id=0,
        materials=one.materials,
        thetas=one.thetas,
        protocol=Indentation(indenter=Sphere(radius_mm=7.5), path=[[0, 0], [1, 0]], friction=1.0),
    )
    with pytest.raises(SolverError, match="cannot indent"):
        COMPRESSIBLE.check(pressed, None)
    assert COMPRESSIBLE.simulate(pressed, None).status is Status.DIVERGED


@pytest.mark.parametrize(
    ("material", "volumetric"), [(Yeoh(), "kappa"), (Ogden(), "kappa"), (MooneyRivlin(), "kappa")]
)
def test_an_incompressible_specimen_does_not_use_the_bulk_modulus(material, volumetric):
    assert HomogeneousSolver(HomogeneousSettings(incompressible=True)).ignored(material) == (volumetric,)
    assert HomogeneousSolver().ignored(material) == ()


def test_parameters_that_are_felt_are_not_ignored():
    assert HomogeneousSolver(HomogeneousSettings(incompressible=True)).ignored(NeoHookean()) == ()


@pytest.mark.slow
@pytest.mark.parametrize("solver", [COMPRESSIBLE, INCOMPRESSIBLE])
def test_a_result_has_the_same_bits_in_any_batch(solver):
    paths = dict.fromkeys(FREE, STRETCHES)
    jobs = [job(Ogden(), [0.02 * (1 + i), 2.0 + 0.1 * i, 1.0], paths, set_id=i) for i in range(21)]
    together = {s.job.set_id: s for s in solver.simulate_many(jobs, None)}
    for some in (jobs[::-1], jobs[3:5], jobs[7:8], jobs[4:21]):
        for found in solver.simulate_many(some, None):
            for mode in FREE:
                expected = together[found.job.set_id].response[mode].ordinate
                assert np.array_equal(found.response[mode].ordinate, expected)
