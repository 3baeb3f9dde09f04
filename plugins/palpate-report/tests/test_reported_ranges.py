"""Ranges that a fit has widened, the values of the least Fopt, and small differences between spots."""

from types import SimpleNamespace

import polars as pl
import pytest
from matplotlib.figure import Figure

from palpate.api import Parameter
from palpate.api.fit import MODULI
from palpate.api.report import rounded_rows
from palpate_report.answer.card import _besides
from palpate_report.answer.headline import between_spots as sentence, least_fopt
from palpate_report.answer.material import PATHS, MaterialCurves
from palpate_report.answer.methods import _materials
from palpate_report.answer.warnings import _about_simulations, _by_scenario
from palpate_report.data.marks import Headline
from palpate_report.data.report_data import ReportData
from palpate_report.data.tables import between_spots
from palpate_report.figures.material import _draw
from palpate_report.sections.certainty import Identifiability
from palpate_report.sections.sweep import Generalisation

MESSAGE = "converged; range of specimen.c3 widened from 7.36e-06…7.36e-05 to 7.36e-06…0.000736 MPa"
SPREAD = {"fit": "all spots", "scenario": "I", "parameter": "specimen.c2", "unit": "kPa", "value": -4.0}


@pytest.fixture
def widened():
    """Data of a study in kPa whose fit has widened the range of c3."""
    c3 = Parameter(name="c3", unit="kPa", lower=0.00736, upper=0.0736, kind="modulus", description="")
    fit = SimpleNamespace(
        table=pl.DataFrame({"message": [MESSAGE], "specimen.c3": [0.4]}),
        ends=pl.DataFrame({"message": [MESSAGE]}),
    )
    data = SimpleNamespace(
        searched={"specimen.c3": c3},
        factors={"specimen.c3": 1000.0},
        fit=fit,
        leading_rows=lambda frame: frame,
        study=SimpleNamespace(space=SimpleNamespace(regions=())),
        spots=("p1", "p2"),
        design=SimpleNamespace(n_sets=9),
        unfinished="",
        verification=pl.DataFrame(),
    )
    data.widened = ReportData.widened.func(data)
    return data


def test_the_methods_and_the_warning_have_the_widened_range(widened):
    assert list(_materials(widened)) == [
        "The search ranges were c3 0.00736 to 0.736 kPa.",
        "The search began with narrower ranges, c3 0.00736 to 0.0736 kPa, and widened them.",
    ]
    warning = next(_about_simulations(widened))
    assert warning.why == "c3 0.00736 to 0.736 kPa (study: c3 0.00736 to 0.0736 kPa)."


def test_the_sweep_of_narrower_ranges_judges_no_value(widened):
    report = SimpleNamespace(tables={"identifiability": None, "generalised": None}, conclusion=None)
    assert not list(Identifiability().blocks(widened, report))
    assert not list(Generalisation().blocks(widened, report))


def test_a_least_fopt_outside_of_an_interval_is_stated_with_it(widened):
    def stated(lower, upper):
        known = Headline(
            parameter="c3", name="specimen.c3", unit="kPa", value=0.35, lower=lower, upper=upper, level=0.95
        )
        return least_fopt(widened, [known])

    assert stated(0.30, 0.45) == "The least Fopt, with the scenario's weights, is at c3 = 0.40 kPa."
    outside = stated(0.30, 0.39)
    assert "c3 = 0.400 kPa, outside (reported 0.350, 95 % interval 0.300 to 0.390 kPa)" in outside


def test_small_differences_between_spots_have_equal_digits():
    row = {**SPREAD, "sd": 8.1e-5, "lower": 0.0, "upper": 1.03, "n_spots": 3}
    intervals = pl.DataFrame({**SPREAD, "fit": "p1"}).extend(pl.DataFrame({**SPREAD, "fit": "p2"}))
    data = SimpleNamespace(
        table=lambda _: pl.DataFrame([row]),
        leading_rows=lambda frame: frame,
        brief_name=lambda name: name.rpartition(".")[2],
        fit=SimpleNamespace(intervals=intervals),
    )
    assert "c2 = 0.0 kPa (0.0 to 1.0), spots -4 to -4 kPa" in sentence(data)
    table = between_spots(data)
    shown = dict(zip(table.columns, rounded_rows(table)[0], strict=True))
    assert [shown[name] for name in ("unit", "sd", "sd_lower", "sd_upper")] == ["kPa", "0.0", "0.0", "1.0"]


def test_a_modulus_that_is_a_parameter_is_listed_once():
    known = {"unit": "kPa", "value": 45.0, "lower": 42.0, "upper": 47.0}
    young, shear = Headline(parameter="Young's modulus", **known), Headline(parameter=MODULI[0], **known)
    both = SimpleNamespace(estimates=(Headline(parameter="E", **known),), moduli=(shear, young))
    assert list(_besides(both)) == [shear]
    both.estimates = ()
    assert list(_besides(both)) == [shear, young]


def test_specimens_have_one_entry_and_the_fit_is_above_the_true_value():
    stress = dict.fromkeys(("all spots", "S1", "S2", "true value"), PATHS[0].amounts)
    axis = Figure().subplots()
    _draw(axis, MaterialCurves(region="specimen", path=PATHS[0], stress=stress), "all spots")
    assert axis.get_legend_handles_labels()[1] == ["all spots", "S1, S2", "true value"]
    fit, *_, true = axis.get_lines()
    assert fit.get_zorder() > true.get_zorder()


@pytest.mark.parametrize(("n", "what"), [(1, "1 fit is poor"), (2, "2 fits are poor")])
def test_a_number_of_fits_agrees_with_its_verb(n, what):
    data = SimpleNamespace(generalising=SimpleNamespace(name="I"))
    found = [("I", f"fit {k}") for k in range(n)]
    assert next(_by_scenario(data, "poor-fit", "{n} {fit} {is} poor", found)).what == what
