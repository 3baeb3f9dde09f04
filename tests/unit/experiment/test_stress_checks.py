"""Stresses of homogeneous tests: what the ranges give is the textbook's, and good curves pass."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from palpate.domain import Curve
from palpate.errors import CurveError, PluginError
from palpate.experiment.measured import load_measured
from palpate.experiment.stress_checks import check_modes, check_stress, stresses_of_ranges
from palpate.plugins.catalogue import Plugins
from palpate.study.reading import Study, read_study

MODES = ("uniaxial", "equibiaxial", "pure_shear", "simple_shear", "confined_compression")
PULL = np.linspace(1.0, 3.0, 21)
PRESS = np.linspace(1.0, 0.6, 21)
MIDDLE = (0.2, -2e-3, 5e-5)


@cache
def plugins() -> Plugins:
    return Plugins.load()


@cache
def study() -> Study:
    return read_study(Path(plugins().studies["treloar"].directory), plugins())


def yeoh(mode: str, t: np.ndarray, c: tuple[float, float, float]) -> np.ndarray:
    """Nominal stress of an incompressible Yeoh material by the textbook's formulas."""
    invariant, slope = {
        "uniaxial": lambda: (t**2 + 2.0 / t, 2.0 * (t - t**-2)),
        "equibiaxial": lambda: (2.0 * t**2 + t**-4, 2.0 * (t - t**-5)),
        "pure_shear": lambda: (t**2 + t**-2 + 1.0, 2.0 * (t - t**-3)),
        "simple_shear": lambda: (3.0 + t**2, 2.0 * t),
    }[mode]()
    return slope * sum(k * c[k - 1] * (invariant - 3.0) ** (k - 1) for k in (1, 2, 3))


def warnings(mode: str, x: np.ndarray, y: np.ndarray, space=None) -> list[str]:
    curve = Curve(channel=mode, abscissa=x, ordinate=y)
    return check_stress(curve, plugins().channels[mode], space or study().space)


def no_ranges():
    """Parameter space of two regions, whose stresses are not known."""
    (region,) = study().space.regions
    return replace(study().space, regions=(region, replace(region, region="other")))


@pytest.mark.parametrize("mode", MODES[:4])
def test_the_stresses_of_the_ranges_are_the_textbooks(mode):
    x = PULL - 1.0 if mode == "simple_shear" else PULL
    (region,) = study().space.regions
    ranges = [np.linspace(p.lower, p.upper, 3) for p in region.searched]
    expected = [yeoh(mode, x, c) for c in np.stack(np.meshgrid(*ranges, indexing="ij"), -1).reshape(-1, 3)]
    np.testing.assert_allclose(stresses_of_ranges(study().space, mode, x), expected, rtol=1e-6, atol=1e-9)


def test_confined_compression_is_the_bulk_and_the_shear_modulus_at_small_strain():
    (region,) = study().space.regions
    stress = stresses_of_ranges(study().space, "confined_compression", np.array([0.9999]))
    shear = 2.0 * np.array([p for p in (0.1, 0.2, 0.3) for _ in range(9)])
    np.testing.assert_allclose(stress[:, 0], -1e-4 * (region.fixed["kappa"] + 4.0 / 3.0 * shear), rtol=1e-3)


@pytest.mark.parametrize("mode", MODES[:3])
@pytest.mark.parametrize("x", [PULL, PRESS, np.concatenate([PULL, PULL[-2::-1]]), PULL[4:]])
def test_a_curve_of_the_ranges_passes_with_noise_and_hysteresis(mode, x):
    rng = np.random.default_rng(1)
    for c in ((0.1, -1e-4, 1e-5), (0.3, -4e-3, 1e-4), MIDDLE):
        y = yeoh(mode, x, c)
        y *= np.where(np.arange(x.size) > 20, 0.75, 1.0)  # less on the way back
        y += 0.005 * np.abs(y).max() * rng.standard_normal(x.size)
        assert warnings(mode, x, y) == []


def test_ranges_that_miss_the_curve_a_little_pass():
    for times in (0.6, 1.6):
        assert warnings("uniaxial", PULL, times * yeoh("uniaxial", PULL, MIDDLE)) == []


@pytest.mark.parametrize(
    ("times", "refused"), [(1e3, True), (30.0, True), (5.0, False), (1 / 40, False), (1e-3, True)]
)
def test_a_stress_that_the_ranges_cannot_give_is_named(times, refused):
    y = times * yeoh("uniaxial", PULL, MIDDLE)
    message = "stress that the ranges of the study give"
    if refused:
        with pytest.raises(CurveError, match=message):
            warnings("uniaxial", PULL, y)
    else:
        (found,) = warnings("uniaxial", PULL, y)
        assert message in found


def test_strain_in_compression_is_a_strain():
    with pytest.raises(CurveError, match=r"this is a strain; .*offset = 1 in channels\.uniaxial\.abscissa"):
        warnings("uniaxial", PRESS - 1.0, yeoh("uniaxial", PRESS, (0.2, 0.0, 0.0)))


def test_pushed_back_after_a_pull_is_a_warning():
    y = yeoh("uniaxial", PULL, (0.2, 0.0, 0.0))
    (found,) = warnings("uniaxial", np.append(PULL, [2.0, 1.2]), np.append(y, [0.3, -0.06]))
    assert "stress_MPa is -0.06 at stretch 1.2" in found
    assert "slack" in found


def test_nothing_is_known_of_several_regions():
    assert warnings("uniaxial", PULL, 1e3 * yeoh("uniaxial", PULL, MIDDLE), no_ranges()) == []


def test_tests_of_one_material_are_not_exchanged_until_they_are():
    c = (0.15, -1e-3, 2e-5)
    curves = {m: Curve(channel=m, abscissa=PULL, ordinate=yeoh(m, PULL, c)) for m in MODES[:3]}
    assert list(check_modes(curves, study().space)) == []
    for one, other in (
        ("uniaxial", "equibiaxial"),
        ("uniaxial", "pure_shear"),
        ("equibiaxial", "pure_shear"),
    ):
        swapped = {one: curves[other].ordinate, other: curves[one].ordinate}
        pair = {m: Curve(channel=m, abscissa=PULL, ordinate=y) for m, y in swapped.items()}
        (found,) = check_modes(pair, study().space)
        assert f"'{one}' and '{other}'" in found
        assert "exchanged" in found


def test_a_shear_that_begins_at_1_is_refused():
    shear = np.linspace(0.0, 0.5, 21)
    assert warnings("simple_shear", shear, yeoh("simple_shear", shear, MIDDLE)) == []
    with pytest.raises(
        CurveError, match=r"begins at 0, without the 1 of a stretch; lower its offset by 1: .*"
    ):
        warnings("simple_shear", shear + 1.0, yeoh("simple_shear", shear, MIDDLE))


@pytest.mark.parametrize("top", [0.06, 0.15, 0.19])
def test_a_strain_in_percent_that_a_stretch_could_be_is_asked_about(top):
    strain = np.linspace(0.0, top, 201)
    stress = yeoh("uniaxial", 1.0 + strain, MIDDLE)
    assert warnings("uniaxial", 1.0 + strain, stress) == []
    message = "as of a strain in percent; if it is one, with loader csv, set scale = 0.01, offset = 1 in"
    if top < 0.1:  # the ranges cannot give it
        with pytest.raises(CurveError, match=message):
            warnings("uniaxial", 1.0 + 100.0 * strain, stress)
    (found,) = warnings("uniaxial", 1.0 + 100.0 * strain, stress, no_ranges())
    assert message in found


@pytest.mark.parametrize("c3", [0.0, 2e-5, 1e-4, 1e-3])
def test_a_large_stretch_of_a_soft_material_is_none_in_percent(c3):
    stretch = np.linspace(1.0, 6.0, 41)
    found = warnings("uniaxial", stretch, yeoh("uniaxial", stretch, (0.2, -1e-3, c3)), no_ranges())
    assert not any("percent" in text for text in found)


def test_a_material_that_raises_is_no_fault_of_the_measured_file(monkeypatch):
    def fails(*_: object) -> None:
        raise RuntimeError("my table is missing")

    monkeypatch.setattr(type(study().space.regions[0].material), "energy", fails)
    with pytest.raises(PluginError, match=r"^energy at the ends of the ranges: 'yeoh' .* correct the plugin"):
        load_measured(study(), plugins().channels)
