"""Reports have the units in which a study writes its ranges, and nothing else changes."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from palpate import AnisotropicMaterial
from palpate.api.fit import initial_moduli
from palpate.domain import ParameterSpace, RegionMaterial, Tie
from palpate.fit.least_squares import LeastSquares
from palpate_report.answer.methods import methods
from palpate_report.answer.result import make_conclusion
from palpate_report.data.display_units import in_display_units, rows_in_display_units
from palpate_report.data.tables import make_tables
from palpate_report.from_run import write_report

STIFFNESS = "soft_tissue.stiffness"
RELATIVE = ("relative_width", "identifiability", "correlation", "fopt_threshold", "n_as_good")


@pytest.fixture
def both(content):
    """A run in the units of the material, and with the stiffness in kPa."""
    truth = {STIFFNESS: 0.4, "soft_tissue.grip": 20.0}
    made = content(assessed=False, search=LeastSquares(), truth=truth, units={STIFFNESS: "kPa"})
    row = {
        "fit": "all spots",
        "scenario": "I",
        "parameter": f"{STIFFNESS}@p1",
        "coarse": 0.3,
        "corrected": 0.4,
    }
    made = replace(made, fit=replace(made.fit, mesh=pl.DataFrame([row])))
    return made, in_display_units(made)


def test_every_value_is_a_thousand_times_that_in_mpa_and_no_judgement_changes(both):
    made, shown = both
    one, other = (make_conclusion(each, make_tables(each)) for each in both)
    assert one.parameters == ("stiffness (MPa)", "grip (MPa)")
    assert other.parameters == ("stiffness (kPa)", "grip (MPa)")
    for a, b in zip(one.bests, other.bests, strict=True):
        assert b.values[0].value == pytest.approx(1000.0 * a.values[0].value)
        if a.values[0].lower is None:
            assert b.values[0].lower is None
        else:
            assert b.values[0].lower == pytest.approx(1000.0 * a.values[0].lower)
        assert b.values[1] == a.values[1]
        assert [m.value for m in b.moduli] == pytest.approx([1000.0 * m.value for m in a.moduli])
    assert [w.what for w in one.warnings] == [w.what for w in other.warnings]
    assert f"stiffness = {other.bests[0].values[0].text} kPa" in other.lead
    assert "initial shear modulus" in other.lead.partition("MPa, ")[2].partition(" kPa")[0]
    assert (
        shown.table("identifiability").select(RELATIVE).equals(made.table("identifiability").select(RELATIVE))
    )
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
    assert [mesh[key] for key in ("coarse", "corrected", "unit")] == [300.0, 400.0, "kPa"]
    for name in ("fit", "generalised"):
        assert shown[name][f"{STIFFNESS} [kPa]"].to_list() == pytest.approx(
            (1000.0 * made[name][STIFFNESS]).to_list()
        )
    far = [tables["distance_to_truth"].filter(parameter=STIFFNESS) for tables in (made, shown)]
    assert far[1]["difference_percent"].to_list() == pytest.approx(
        far[0]["difference_percent"].to_list(), abs=1e-9
    )
    assert set(far[1]["truth"]) == {400.0}


@pytest.fixture
def tied(content, tissue):
    """A run in which the grip is 50 times the stiffness."""
    material, grip = tissue.Spongy(), "soft_tissue.grip"
    searched = tuple(p for p in material.parameters if p.name == "stiffness")
    ties = {"grip": Tie(source=STIFFNESS, factor=50.0)}
    region = RegionMaterial(region="soft_tissue", material=material, searched=searched, fixed={}, tied=ties)
    truth = {STIFFNESS: 0.4, grip: 20.0}
    return content(
        assessed=False, search=LeastSquares(), truth=truth, space=ParameterSpace(regions=(region,)),
        units={STIFFNESS: "kPa", grip: "kPa"},
    )  # fmt: skip


def test_what_is_not_searched_is_said_where_the_answer_is(tied):
    assert "assuming grip = 50 × stiffness" in methods(tied, (), ())
    assert make_conclusion(tied, {}).facts["Assumed"] == "grip = 50 × stiffness"


def test_what_the_solver_has_no_use_for_is_not_assumed(tied, monkeypatch):
    monkeypatch.setattr(type(tied.study.solver), "ignored", lambda *_: ("grip",), raising=False)
    assert "Assumed" not in make_conclusion(tied, {}).facts


def test_what_is_tied_has_the_unit_of_what_it_follows(tied):
    made, shown = make_tables(tied), make_tables(in_display_units(tied))
    for tables, unit, truth in ((made, "MPa", 20.0), (shown, "kPa", 20000.0)):
        assert set(tables["table1_fit"]["unit"]) == set(tables["distance_to_truth"]["unit"]) == {unit}
        grip = pl.col("parameter").str.ends_with("grip")
        stiffness, tied_to = (tables["table1_fit"].filter(rows)["value"] for rows in (~grip, grip))
        assert tied_to.to_list() == pytest.approx((50.0 * stiffness).to_list())
        assert set(tables["distance_to_truth"].filter(grip)["truth"]) == {truth}
    fit = shown["fit"]
    assert fit["soft_tissue.grip [kPa]"].to_list() == pytest.approx(
        (50.0 * fit[f"{STIFFNESS} [kPa]"]).to_list()
    )


class Fibred(AnisotropicMaterial):
    """One family of fibres along e1: stiffer along them than across."""

    name, summary = "fibred", "fibres along e1"

    def energy_from_F(self, F, theta, fields=None):  # noqa: N802 - the interface's name
        strain = F.mT @ F - np.eye(3)
        return theta[0] * strain[..., 0, 0] ** 2 + theta[1] * (strain**2).sum(axis=(-1, -2))


def test_fibres_have_no_modulus_that_is_the_same_in_every_direction(content, tissue):
    """Along fibres a tissue may be ten times stiffer than across: a mean of the two is nobody's."""
    made = content(assessed=False, search=LeastSquares(), truth={STIFFNESS: 0.4, "soft_tissue.grip": 20.0})
    assert dict(initial_moduli(made.study.space, made.study.truth, made.factors, made.modulus_unit))
    material = Fibred()
    material.parameters = tissue.Spongy().parameters
    region = replace(made.study.space.regions[0], material=material)
    fibred = replace(made, study=replace(made.study, space=ParameterSpace(regions=(region,))))
    assert not dict(initial_moduli(fibred.study.space, made.study.truth, fibred.factors, fibred.modulus_unit))
    conclusion = make_conclusion(fibred, make_tables(fibred))
    assert conclusion.moduli == ()
    assert "modulus" not in conclusion.lead


def test_the_written_report_is_in_them(undrawn, both, tmp_path):
    made, _ = both
    report = write_report(made, tmp_path)
    assert "kPa" in report.conclusion.lead
    assert "stiffness (kPa)" in (tmp_path / "index.html").read_text()


def test_rows_of_a_table_are_in_them(both):
    study = both[0].study
    rows = pl.DataFrame({"parameter": [STIFFNESS, "p1 force"], "unit": ["MPa", "N"], "value": [0.4, 7.0]})
    shown = rows_in_display_units(study, rows)
    assert shown.rows() == [(STIFFNESS, "kPa", pytest.approx(400.0)), ("p1 force", "N", 7.0)]
    assert rows_in_display_units(replace(study, units={}), rows) is rows


def test_without_other_units_nothing_is_converted(content):
    made = content(n_sets=12)
    assert in_display_units(made) is made


def test_the_methods_state_fixed_values_in_the_unit_of_the_ranges(content, tissue):
    material = tissue.Spongy()
    region = RegionMaterial(
        region="soft_tissue",
        material=material,
        searched=tuple(p for p in material.parameters if p.name == "stiffness"),
        fixed={"grip": 0.5},
    )
    made = content(
        assessed=False, space=ParameterSpace(regions=(region,)), truth={STIFFNESS: 0.4},
        units={STIFFNESS: "kPa"},
    )  # fmt: skip
    assert "assuming grip = 0.5 MPa" in methods(made, (), ())
    assert "assuming grip = 500 kPa" in methods(in_display_units(made), (), ())
