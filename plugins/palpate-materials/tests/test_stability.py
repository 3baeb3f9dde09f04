"""The Drucker filter against closed forms and the counts that its settings imply."""

import numpy as np
import pytest
from pydantic import ValidationError

from palpate import _core
from palpate.domain import ParameterSpace, RegionMaterial
from palpate.domain.material import AnisotropicMaterial
from palpate_materials import ArrudaBoyce, Drucker, Gent, MooneyRivlin, NeoHookean, Ogden, Yeoh
from palpate_materials.stability import DruckerSettings
from palpate_materials.uncoupled import PAPER_RANGES, OgdenSettings, modulus

YEOH = Yeoh()
KAPPA = 1.0


def incompressible_2x2(c, stretches):
    """Textbook stiffness of dτ1 - dτ3, dτ2 - dτ3 over dε1, dε2 for Ψ(I1), and whether it is positive."""
    I1 = np.sum(stretches**2)
    slope = sum(k * ck * (I1 - 3) ** (k - 1) for k, ck in enumerate(c, 1))
    bend = sum(k * (k - 1) * ck * (I1 - 3) ** (k - 2) for k, ck in enumerate(c, 1) if k > 1)
    sq = stretches**2
    change = np.array([2 * (sq[0] - sq[2]), 2 * (sq[1] - sq[2])])
    D = 4 * slope * (np.diag(sq[:2]) + sq[2]) + bend * np.outer(change, change)
    return D[0, 0] + D[1, 1] > 0 and np.linalg.det(D) > 0


def paths(t):
    return {"uniaxial": [t, t**-0.5, t**-0.5], "equibiaxial": [t, t, t**-2], "planar": [t, 1.0, 1 / t]}


def draw(n_sets, seed):
    """Yeoh sets over the paper's ranges, in the paper's numbers."""
    lower, upper = np.array([*PAPER_RANGES, (0.25, 2.5)]).T
    return lower + (upper - lower) * _core.latin_hypercube(n_sets, 4, seed)


@pytest.mark.parametrize("mode", ["uniaxial", "equibiaxial", "planar"])
def test_equals_the_classic_check_of_incompressible_rubber(mode):
    drucker = Drucker(DruckerSettings(modes=(mode,), n_stretches=21))
    thetas = draw(100, 3)
    stretches = [np.array(paths(t)[mode]) for t in np.geomspace(0.3, 3.0, 21)]
    expected = [all(incompressible_2x2(theta[:3], s) for s in stretches) for theta in thetas]
    stable = drucker.stable(YEOH, thetas)
    np.testing.assert_array_equal(stable, expected)
    assert 0 < stable.sum() < 100


def test_bulk_modulus_plays_no_part_but_its_sign():
    thetas = draw(50, 1)
    softer = thetas * [1, 1, 1, 0.1]
    stable = Drucker().stable(YEOH, thetas)
    np.testing.assert_array_equal(Drucker().stable(YEOH, softer), stable)
    assert not Drucker().stable(YEOH, thetas * [1, 1, 1, -1]).any()


@pytest.mark.slow
def test_counts_for_the_papers_ranges():
    """Of 250 sets the paper kept 140; no usual choice of modes comes that low on average."""
    counts = {"textbook": [], "febio4": [], "uniaxial": []}
    uniaxial = Drucker(DruckerSettings(modes=("uniaxial",)))
    for seed in range(5):
        values = draw(250, seed)
        textbook = np.array([YEOH.to_textbook(v, "febio4") for v in values])
        counts["textbook"].append(Drucker().stable(YEOH, values).sum())
        counts["febio4"].append(Drucker().stable(YEOH, textbook).sum())
        counts["uniaxial"].append(uniaxial.stable(YEOH, values).sum())
    mean = {key: np.mean(values) for key, values in counts.items()}
    assert mean["textbook"] == pytest.approx(150, abs=6)
    assert mean["febio4"] == pytest.approx(170, abs=6)
    assert mean["uniaxial"] == pytest.approx(153, abs=6)


@pytest.mark.slow
def test_positive_energies_are_always_stable():
    rng = np.random.default_rng(0)
    for material in (Ogden(), NeoHookean(), MooneyRivlin()):
        lower, upper = np.array([[p.lower, p.upper] for p in material.parameters]).T
        assert Drucker().stable(material, lower + (upper - lower) * rng.random((20, lower.size))).all()


def test_a_set_without_an_energy_is_not_stable():
    assert not Drucker().stable(Ogden(), np.array([[0.1, 0.0, 1.0]])).any()


def test_the_reason_names_region_mode_and_stretch():
    material = Yeoh()
    region = RegionMaterial(region="fat", material=material, searched=material.parameters, fixed={})
    row = np.array([0.01, -0.01, 1e-6, 1.0])
    said = Drucker(DruckerSettings(n_stretches=5)).reason(ParameterSpace(regions=(region,)), row)
    assert said.startswith("fat has a stiffness of -")
    assert "stretch" in said


class Fibre(AnisotropicMaterial):
    """Neo-Hookean ground with fibres along e1 that may soften."""

    name = "fibre"
    summary = "test material"
    parameters = (modulus("c", 0.01, 0.1, "ground"), modulus("fibre", 0.01, 0.1, "fibre"))

    def energy_from_F(self, F, theta):  # noqa: N802 - the interface's name
        xp = F.__array_namespace__()
        C, J = F.T @ F, xp.linalg.det(F)
        ground = theta[0] / 2 * (xp.trace(C) * J ** (-2 / 3) - 3) + 0.5 * xp.log(J) ** 2
        return ground + theta[1] / 2 * (C[0, 0] - 1) ** 2


@pytest.mark.slow
def test_anisotropic_materials_are_checked_along_all_axes():
    drucker = Drucker(
        DruckerSettings(modes=("uniaxial",), least_stretch=0.5, largest_stretch=1.5, n_stretches=3)
    )
    # Fibre energy k/2 (C11 - 1)² has a negative log-strain stiffness 4 k C11 (2 C11 - 1) below C11 = ½.
    thetas = np.array([[0.1, 1e-3], [0.01, 1.0], [0.1, -1.0]])
    np.testing.assert_array_equal(drucker.stable(Fibre(), thetas), [True, False, False])


def space(*regions):
    return ParameterSpace(regions=tuple(regions))


def test_every_region_must_be_stable_searched_or_fixed():
    stable = {"c1": 0.02, "c2": -1e-4, "c3": 1e-4, "kappa": KAPPA}
    unstable = stable | {"c2": -0.05}
    by_name = {p.name: p for p in YEOH.parameters}
    skin = RegionMaterial(
        region="skin",
        material=YEOH,
        searched=(by_name["c2"],),
        fixed={k: v for k, v in stable.items() if k != "c2"},
    )
    values = np.array([[stable["c2"]], [unstable["c2"]]])
    for fixed, expected in ((stable, [True, False]), (unstable, [False, False])):
        bone = RegionMaterial(region="deep", material=YEOH, searched=(), fixed=fixed)
        np.testing.assert_array_equal(Drucker().accept(space(skin, bone), values), expected)


def test_values_are_read_in_their_convention():
    numbers = {"c1": 0.015, "c2": -0.003, "c3": 3e-4, "kappa": KAPPA}
    verdicts = [
        Drucker().accept(
            space(
                RegionMaterial(region="r", material=YEOH, searched=(), fixed=numbers, convention=convention)
            ),
            np.zeros((1, 0)),
        )[0]
        for convention in ("textbook", "febio4")
    ]
    assert verdicts == [False, True]


@pytest.mark.parametrize(
    "settings",
    [
        {"modes": ()},
        {"modes": ("torsion",)},
        {"modes": ("planar", "planar")},
        {"least_stretch": 1.2},
        {"largest_stretch": 0.8},
        {"least_stretch": -0.1},
    ],
)
def test_settings_that_make_no_sense_are_refused(settings):
    with pytest.raises(ValidationError):
        DruckerSettings(**settings)


def test_laws_of_limited_chains_are_stable_up_to_their_limit():
    """I1 - 3 is 120.6 at an equibiaxial stretch of 0.3, which no energy of these limits reaches."""
    gents = np.array([[0.04, limit, 1.0] for limit in (1.0, 14.0, 84.0, 200.0)])
    assert Drucker().stable(Gent(), gents).all()
    assert not Drucker().stable(Gent(), gents * [-1.0, 1.0, 1.0]).any()
    # A negative limit is none: the energy softens, and falls at last.
    assert not Drucker().stable(Gent(), gents[:1] * [1.0, -1.0, 1.0]).any()
    chains = np.array([[0.04, links, 1.0] for links in (1.0, 10.0, 50.0)])
    assert Drucker().stable(ArrudaBoyce(), chains).all()
    assert not Drucker().stable(ArrudaBoyce(), chains * [-1.0, 1.0, 1.0]).any()


def test_one_negative_term_of_ogden_can_be_stable_and_need_not_be():
    two = Ogden(OgdenSettings(terms=2))
    thetas = np.array([[0.06, 3.0, 0.01, -2.0, 1.0], [0.06, 3.0, -0.05, -4.0, 1.0]])
    assert Drucker().stable(two, thetas).tolist() == [True, False]
