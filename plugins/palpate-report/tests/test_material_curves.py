"""Stress of the fitted material: its slopes at rest, its band, and its units."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest

from palpate.api import Curve, Response
from palpate.api.fit import Adequacy, initial_moduli
from palpate.fit.least_squares import LeastSquares
from palpate.mechanics.homogeneous import MODES
from palpate_report.answer.headline import draws_of
from palpate_report.answer.material import PATHS, MaterialCurves, _paths, material_curves, rows_of
from palpate_report.answer.model_verdict import ModelVerdict
from palpate_report.sections.fits import MaterialItself
from palpate_report.testing import small_runs

from .fits import with_tables

TRUTH = {"soft_tissue.stiffness": 0.45, "soft_tissue.grip": 22.0}


@pytest.fixture
def fitted(content):
    return content(search=LeastSquares(), truth=TRUTH)


def test_paths_keep_the_volume():
    for path in PATHS:
        np.testing.assert_allclose(np.prod(MODES[path.mode](path.amounts), axis=-1), 1.0, rtol=1e-12)


def test_slopes_at_rest_are_those_of_the_initial_shear_modulus(fitted):
    (tension, shear) = material_curves(fitted, "I")
    for label, row in (("all spots", next(fitted.fit.ends.iter_rows(named=True))), ("true value", TRUTH)):
        ((_, mu), _) = initial_moduli(fitted.study.space, row, fitted.factors, fitted.modulus_unit)
        x, at_rest = tension.path.amounts, tension.path.amounts.size // 2
        slope = np.gradient(tension.stress[label], x)[at_rest]
        assert slope == pytest.approx(3.0 * mu, rel=2e-3)
        assert tension.stress[label][at_rest] == pytest.approx(0.0, abs=1e-6)
        assert shear.stress[label][1] / shear.path.amounts[1] == pytest.approx(mu, rel=2e-3)


def test_the_band_is_that_of_the_draws_and_has_the_fit(fitted):
    (tension, _) = material_curves(fitted, "I")
    draws = draws_of(fitted, "I", 200)
    assert draws.height == 200
    factor = draws["soft_tissue.stiffness"] / fitted.fit.ends["soft_tissue.stiffness"][0]
    # The energy of the analytic tissue is stiffness Σ(λ − 1)²: all of its stress scales with it.
    ends = np.quantile(factor, (0.025, 0.975))
    stress = tension.stress["all spots"]
    np.testing.assert_allclose(tension.upper[-1], ends[1] * stress[-1], rtol=1e-6)
    np.testing.assert_allclose(tension.lower[-1], ends[0] * stress[-1], rtol=1e-6)


def test_the_table_of_a_stretched_specimen_has_the_stress_at_its_labels():
    stretch = np.linspace(1.0, 7.6, 9)
    measured = Response(curves={"uniaxial": Curve(channel="uniaxial", abscissa=stretch, ordinate=stretch)})
    data = SimpleNamespace(study=SimpleNamespace(protocol=None), measured={"p1": measured})
    for path in _paths(data):
        every = MaterialCurves(region="specimen", path=path, stress={"p1": 100.0 * path.amounts})
        for _, _, label, value, *_ in rows_of(every, "p1"):
            assert float(value) == pytest.approx(100.0 * float(label.split()[-1]))


def test_without_draws_there_is_no_band_and_without_a_fit_no_curve(fitted):
    bare = with_tables(fitted, draws=pl.DataFrame())
    assert all(each.lower is None for each in material_curves(bare, "I"))
    assert {label for each in material_curves(bare, "I") for label in each.stress} == {
        "all spots", "p1", "p2", "true value",
    }  # fmt: skip
    data, _ = small_runs()["a sweep"]
    assert not list(material_curves(data, "both"))


def test_no_stress_is_shown_of_a_material_that_does_not_fit(fitted):
    data, report = small_runs()["a fit alone"]
    assert len(list(MaterialItself().blocks(data, report))) == 2
    conclusion = replace(
        report.conclusion, model=ModelVerdict(verdict=Adequacy.FAILS, sentence="No parameters")
    )
    assert not list(MaterialItself().blocks(data, replace(report, conclusion=conclusion)))
