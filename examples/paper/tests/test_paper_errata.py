"""Each misprint and trap of the paper, decided and held."""

import csv
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from palpate import _core
from palpate.domain import Normaliser, Parameter
from palpate.errors import ParameterError, ScoringError
from palpate.plugins.score import Nmse, NmseSettings, ScoringRules
from palpate.scoring.scores import check_scorable
from palpate_materials.uncoupled import Ogden, Yeoh

TABLE_2 = Path(str(files("papers_study") / "printed" / "table2_nmse.csv"))
YEOH = np.array([0.0129, -2.016e-3, 2.7623e-4, 0.8])


def loop(amplitude=28.0):
    """A torque over 0 → −22.5° → 22.5° → 0 with hysteresis, off centre by a few per cent."""
    turns = np.array([0.0, -22.5, 22.5, 0.0])
    x = np.interp(np.linspace(0.0, 4.0, 201), [0.0, 1.0, 3.0, 4.0], turns)
    way = np.sign(np.gradient(x))
    return x, amplitude * (np.tanh(x / 10) + 0.2 * way * (1 - (x / 22.5) ** 2) + 0.05)


def test_erratum_1a_the_isochoric_stretches_take_out_the_volume():
    """F̃ = J^(−1/3) F, not J^(1/3) F: a pure change of volume costs no isochoric energy."""
    swollen = np.full(3, 1.2)
    volumetric = 0.8 / 2 * np.log(1.2**3) ** 2
    assert Yeoh().energy(swollen, YEOH) == pytest.approx(volumetric, rel=1e-12)
    ogden = Ogden()
    theta = np.array([p.lower for p in ogden.parameters])
    bulk = theta[[p.name for p in ogden.parameters].index("kappa")]
    assert ogden.energy(swollen, theta) == pytest.approx(bulk / 2 * np.log(1.2**3) ** 2, rel=1e-12)


def test_erratum_1b_every_yeoh_term_is_a_power_of_the_first_invariant():
    """(I1 − 3)^k in every term, not (I_i − 3): only the first invariant matters."""
    stretches = np.array([1.4, 0.9, 1.0 / (1.4 * 0.9)])
    x = (stretches**2).sum() - 3.0
    expected = YEOH[0] * x + YEOH[1] * x**2 + YEOH[2] * x**3
    assert Yeoh().energy(stretches, YEOH) == pytest.approx(expected, rel=1e-12)


def test_erratum_1c_a_reversed_range_is_refused_and_the_default_runs_low_to_high():
    with pytest.raises(ParameterError, match=r"lower -4.14e-05 must be less than upper -0.003"):
        Parameter(name="c2", unit="MPa", lower=-4.14e-5, upper=-3e-3, kind="modulus", description="")
    c2 = next(p for p in Yeoh().parameters if p.name == "c2")
    assert (2 * c2.lower, 2 * c2.upper) == pytest.approx((-3e-3, -4.14e-5), rel=1e-12)


def test_erratum_2_febio_leaves_out_the_factor_k():
    """FEBio's dΨ/dI1 = Σ c_k x^(k−1) with printed c_k is the textbook's with c_k/k."""
    printed = YEOH[:3]
    x = 0.7
    febio = sum(c * x**k for k, c in enumerate(printed))
    textbook = Yeoh().to_textbook(YEOH, "febio4")[:3]
    assert sum((k + 1) * c * x**k for k, c in enumerate(textbook)) == pytest.approx(febio, rel=1e-14)
    wrong = sum((k + 1) * c * x**k for k, c in enumerate(printed))
    assert abs(wrong - febio) > 0.05 * abs(febio)


def test_erratum_3_the_mean_of_a_twist_is_degenerate_and_the_default_is_not(make_study):
    _, torque = loop()
    assert abs(torque.mean()) < 0.1 * np.sqrt((torque**2).mean())
    with pytest.raises(ScoringError, match="degenerate"):
        _core.nmse(1.1 * torque, torque, "mean")
    literal = ((0.1 * torque) ** 2).mean() / torque.mean() ** 2
    assert literal > 1.0
    assert _core.nmse(1.1 * torque, torque, "mean_abs") < 0.02
    assert make_study().scoring.score.settings.normaliser is Normaliser.MEAN_ABS


def test_erratum_3_is_refused_before_the_sweep(make_study, plugins):
    from palpate.experiment.measured import load_measured

    study = make_study(scoring=ScoringRules(score=Nmse(NmseSettings(normaliser=Normaliser.MEAN))))
    with pytest.raises(ScoringError, match="spot 'p1', channel 'torque'"):
        check_scorable(load_measured(study, plugins.channels), study.scoring)


def test_erratum_4_a_twist_is_a_path_and_not_a_function_of_the_angle():
    x, torque = loop()
    values, covered = _core.interpolate(x, torque, x)
    assert covered.all()
    assert np.array_equal(values, torque)
    order = np.argsort(x, kind="stable")
    sorted_by_angle = np.interp(x, x[order], torque[order])
    assert np.abs(sorted_by_angle - torque).max() > 0.1 * np.abs(torque).max()


def test_erratum_5_a_factor_on_every_modulus_is_a_factor_on_the_energy():
    """The root of the scaling of force and torque: parameters of kind modulus scale the energy."""
    stretches = np.array([1.3, 0.9, 0.8])
    for material in (Yeoh(), Ogden()):
        theta = np.array([0.5 * (p.lower + p.upper) for p in material.parameters])
        scale = np.array([3.0 if p.kind == "modulus" else 1.0 for p in material.parameters])
        once, thrice = material.energy(stretches, theta), material.energy(stretches, theta * scale)
        assert thrice == pytest.approx(3.0 * once, rel=1e-12)


def test_erratum_7_table_2_and_not_the_text_holds_the_lowest_errors():
    """The text gives Ogden the lowest II and III, 0.0037 and 0.0274; the table has lower ones elsewhere."""
    with TABLE_2.open() as file:
        rows = list(csv.DictReader(file))
    for scenario, in_text, in_table, owner in (
        ("II", 0.0037, 0.0031, "neo_hookean"),
        ("III", 0.0274, 0.0259, "yeoh"),
    ):
        least = min((r for r in rows if r["scenario"] == scenario), key=lambda r: float(r["nmse"]))
        ogden = min(float(r["nmse"]) for r in rows if r["scenario"] == scenario and r["material"] == "ogden")
        assert (float(least["nmse"]), least["material"], ogden) == (in_table, owner, in_text)


def test_a_coefficient_carries_its_convention(space):
    region = replace(
        space.regions[0],
        material=Yeoh(),
        searched=Yeoh().parameters[:3],
        fixed={"kappa": 0.8},
        convention="febio4",
    )
    theta = region.theta({"c1": 0.0129, "c2": -2.016e-3, "c3": 2.7623e-4})
    np.testing.assert_allclose(theta, [0.0129, -1.008e-3, 2.7623e-4 / 3, 0.8], rtol=1e-15)
