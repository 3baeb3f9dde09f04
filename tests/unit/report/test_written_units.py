"""Reports have the units in which a study writes its ranges, and nothing else changes."""

from dataclasses import replace

import polars as pl
import pytest

from palpate.fit.least_squares import LeastSquares
from palpate.report import make_tables, write_report
from palpate.report.verdict import make_verdict
from palpate.report.written_units import in_written_units

STIFFNESS = "soft_tissue.stiffness"
RELATIVE = ("relative_width", "identifiability", "correlation", "fopt_threshold", "n_as_good")


@pytest.fixture
def both(content):
    """A run in the units of the material, and with the stiffness in kPa."""
    truth = {STIFFNESS: 0.4, "soft_tissue.grip": 20.0}
    made = content(assessed=False, search=LeastSquares(), truth=truth, units={STIFFNESS: "kPa"})
    row = {"fit": "all spots", "scenario": "I", "parameter": f"{STIFFNESS}@p1", "coarse": 0.3, "fine": 0.4,
           "extrapolated": 0.5}  # fmt: skip
    made = replace(made, fit=replace(made.fit, mesh=pl.DataFrame([row])))
    return made, in_written_units(made)


def test_every_value_is_a_thousand_times_that_in_mpa_and_no_judgement_changes(both):
    made, shown = both
    one, other = (make_verdict(each, make_tables(each)) for each in both)
    assert one.parameters == ("stiffness [MPa]", "grip [MPa]")
    assert other.parameters == ("stiffness [kPa]", "grip [MPa]")
    for a, b in zip(one.bests, other.bests, strict=True):
        assert b.values[0].value == pytest.approx(1000.0 * a.values[0].value)
        if a.values[0].lower is None:
            assert b.values[0].lower is None
        else:
            assert b.values[0].lower == pytest.approx(1000.0 * a.values[0].lower)
        assert b.values[1] == a.values[1]
        assert b.moduli["soft_tissue"] == pytest.approx([1000.0 * m for m in a.moduli["soft_tissue"]])
    assert [w.what for w in one.warnings] == [w.what for w in other.warnings]
    assert f"stiffness = {other.bests[0].values[0].value:.4g} kPa" in other.lead
    assert "initial shear modulus" in other.lead.partition("MPa, ")[2].partition(" kPa")[0]
    assert shown.identifiability.select(RELATIVE).equals(made.identifiability.select(RELATIVE))
    assert (shown.design.values / made.design.values).max(axis=0) == pytest.approx([1000.0, 1.0])
    assert shown.study.space is made.study.space


def test_tables_name_the_unit(both):
    made, shown = (make_tables(each) for each in both)
    for name in ("table1_fit", "table1_coefficients", "identifiability"):
        units = dict(shown[name].select("parameter", "unit").iter_rows())
        assert {key.removeprefix("soft_tissue."): unit for key, unit in units.items()} == {
            "stiffness": "kPa", "grip": "MPa",
        }  # fmt: skip
    mesh = shown["fit_mesh"].row(0, named=True)
    assert [mesh[key] for key in ("coarse", "fine", "extrapolated", "unit")] == [300.0, 400.0, 500.0, "kPa"]
    for name in ("fit", "generalised"):
        assert shown[name][f"{STIFFNESS} [kPa]"].to_list() == pytest.approx(
            (1000.0 * made[name][STIFFNESS]).to_list()
        )
    far = [tables["distance_to_truth"].filter(parameter=STIFFNESS) for tables in (made, shown)]
    assert far[1]["difference_percent"].to_list() == pytest.approx(
        far[0]["difference_percent"].to_list(), abs=1e-9
    )
    assert set(far[1]["truth"]) == {400.0}


def test_the_written_report_is_in_them(undrawn, both, tmp_path):
    made, _ = both
    report = write_report(made, tmp_path)
    assert "kPa" in report.verdict.lead
    assert "stiffness [kPa]" in (tmp_path / "index.html").read_text()


def test_without_other_units_nothing_is_converted(content):
    made = content(n_sets=12)
    assert in_written_units(made) is made
