"""Strains and stresses of homogeneous tests: converted to stretch and nominal stress, as the settings say."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from pydantic import ValidationError

from palpate.domain import Curve, FloatArray, Response
from palpate.errors import CurveError
from palpate_indentation import CsvLoader, CsvSettings

DATA = Path(__file__).parent / "data" / "homogeneous"
STRETCH_MODES = ("uniaxial", "equibiaxial", "pure_shear", "confined_compression")


def loader(channel: str, **settings: object) -> CsvLoader:
    named = {"abscissa": "x", "ordinate": "y"}
    return CsvLoader(CsvSettings.model_validate({"channels": {channel: named | settings}}))


def piola(mode: str, stretch: float, cauchy: np.ndarray) -> np.ndarray:
    """First Piola-Kirchhoff stress P = J σ F⁻ᵀ of a mode's deformation gradient."""
    across = {"uniaxial": (-0.5, -0.5), "equibiaxial": (1.0, -2.0), "pure_shear": (0.0, -1.0)}
    powers = (1.0, *across.get(mode, (0.0, 0.0)))
    gradient = np.diag([stretch**power for power in powers])
    return np.asarray(np.linalg.det(gradient) * cauchy @ np.linalg.inv(gradient).T)


@given(
    mode=st.sampled_from(STRETCH_MODES),
    stretches=st.lists(st.floats(0.3, 4.0), min_size=2, max_size=12, unique=True),
    modulus=st.floats(1e-3, 10.0),
)
def test_every_measure_is_the_stress_of_the_textbook(
    tmp_path_factory: pytest.TempPathFactory, mode: str, stretches: list[float], modulus: float
) -> None:
    stretch = np.sort(np.array(stretches))
    true = modulus * (stretch**2 - 1.0 / stretch)
    nominal = np.array(
        [piola(mode, t, np.diag([s, 0.0, 0.0]))[0, 0] for t, s in zip(stretch, true, strict=True)]
    )
    stresses = {"nominal": nominal, "true": true, "pk2": nominal / stretch}
    strains = {"stretch": stretch, "log": np.log(stretch), "green": (stretch**2 - 1.0) / 2.0}
    path = tmp_path_factory.mktemp("measures") / "test.csv"
    for strain, x in strains.items():
        for stress, y in stresses.items():
            rows = np.stack([x, y], axis=1).tolist()
            path.write_text("x,y\n" + "".join(f"{a!r},{b!r}\n" for a, b in rows))
            curve = loader(mode, strain=strain, stress=stress).load(path, mode)[mode]
            np.testing.assert_allclose(curve.abscissa, stretch, rtol=1e-12)
            np.testing.assert_allclose(curve.ordinate, nominal, rtol=1e-9, atol=1e-12 * modulus)


def test_a_shear_stress_is_the_same_in_both_frames() -> None:
    gradient = np.array([[1.0, 0.4, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    cauchy = gradient @ gradient.T
    first = cauchy @ np.linalg.inv(gradient).T
    assert first[0, 1] == pytest.approx(cauchy[0, 1])
    loader("simple_shear", stress="true")


@pytest.mark.parametrize("strain", ["stretch", "log", "green"])
@pytest.mark.parametrize("stress", ["nominal", "true", "pk2"])
def test_what_is_saved_is_read_back(tmp_path: Path, strain: str, stress: str) -> None:
    stretch = np.linspace(1.0, 1.8, 9)
    curve = Curve(channel="uniaxial", abscissa=stretch, ordinate=stretch - stretch**-2.0, std=0.01 * stretch)
    both = loader("uniaxial", strain=strain, stress=stress, std="sd")
    both.save(tmp_path / "t.csv", Response(curves={"uniaxial": curve}))
    read = both.load(tmp_path / "t.csv")["uniaxial"]
    assert read.std is not None
    for name in ("abscissa", "ordinate", "std"):
        np.testing.assert_allclose(getattr(read, name), getattr(curve, name), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("channel", "settings", "message"),
    [
        ("force", {"strain": "log"}, r'channels\.force: strain = "log" is for homogeneous tests'),
        ("force", {"stress": "true"}, r'stress = "true" is for homogeneous tests'),
        ("simple_shear", {"strain": "green"}, "give the amount of shear and leave strain out"),
        ("simple_shear", {"stress": "pk2"}, "needs the normal stress"),
        ("uniaxial", {"stress": "cauchy"}, "'nominal', 'true' or 'pk2'"),
    ],
)
def test_a_measure_that_a_channel_has_not_is_refused(
    channel: str, settings: dict[str, str], message: str
) -> None:
    with pytest.raises(ValidationError, match=message):
        loader(channel, **settings)


def test_a_strain_of_no_stretch_is_refused(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("x,y\n0,0\n-0.6,-1\n")
    with pytest.raises(CurveError, match=r"column 'x': -0\.6 to 0 once scaled are no stretches"):
        loader("uniaxial", strain="green").load(tmp_path / "t.csv")


def read(name: str, x: dict[str, object], y: dict[str, object], **settings: object) -> Curve:
    columns = {"abscissa": x, "ordinate": y, **settings}
    made = CsvLoader(CsvSettings.model_validate({"channels": {"uniaxial": columns}}))
    return made.load(DATA / name, "uniaxial")["uniaxial"]


def yeoh(stretch: FloatArray) -> FloatArray:
    """Nominal stress [MPa] of the material that made the data (see their README)."""
    invariant = stretch**2 + 2.0 / stretch - 3.0
    return 2.0 * (stretch - stretch**-2.0) * (0.02 - 0.001 * invariant + 0.0003 * invariant**2)


def test_a_true_stress_over_a_logarithmic_strain_is_the_material_that_made_it() -> None:
    kPa = {"name": "True stress (kPa)", "scale": 1e-3}
    curve = read("true_stress.csv", {"name": "True strain"}, kPa, strain="log", stress="true")
    assert curve.abscissa[-1] == pytest.approx(1.25, abs=1e-4)
    np.testing.assert_allclose(curve.ordinate, yeoh(curve.abscissa), rtol=1e-4, atol=1e-7)


def test_a_positive_compression_is_turned_by_its_signs() -> None:
    kPa = {"name": "Compressive stress (kPa)", "scale": -1e-3}
    strain = {"name": "Compressive strain", "scale": -1.0, "offset": 1.0}
    curve = read("compressive_positive.csv", strain, kPa)
    np.testing.assert_allclose(curve.ordinate, yeoh(curve.abscissa), rtol=1e-4, atol=1e-7)


# ------------------------------------------------------------------- the way back


@given(
    n=st.integers(3, 40),
    n_hold=st.integers(0, 5),
    start=st.floats(-50.0, 50.0),
    depth=st.sampled_from([-10.0, 0.5, 10.0]),
)
@example(n=3, n_hold=0, start=0.0, depth=-10.0)
@example(n=5, n_hold=1, start=-4.0, depth=10.0)
@example(n=5, n_hold=0, start=4.0, depth=-10.0)
def test_loading_keeps_the_rows_up_to_the_farthest(
    tmp_path_factory: pytest.TempPathFactory, n: int, n_hold: int, start: float, depth: float
) -> None:
    way = start + depth * np.linspace(0.0, 1.0, n)
    path = tmp_path_factory.mktemp("way") / "c.csv"
    x = np.concatenate([way, np.full(n_hold, way[-1]), way[::-1]])
    path.write_text("x,y\n" + "".join(f"{value!r},{k}\n" for k, value in enumerate(x.tolist())))
    whole = loader("force").load(path)["force"]
    assert len(whole.branches) == 2
    loading = loader("force", rows="loading").load(path)["force"]
    ahead = np.sign(depth) * way
    first = np.flatnonzero(ahead <= 0.0)[-1] if ahead[0] < 0.0 < ahead[-1] else 0  # an approach is left out
    np.testing.assert_array_equal(loading.abscissa, way[first:])
    np.testing.assert_array_equal(loading.ordinate, np.arange(first, n))
