"""Presses of living limbs: laws of the finite elements, their emulator, and the fit to people left out."""

import json
from dataclasses import replace
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings, strategies as st

from palpate.cli.app import main
from palpate.errors import PalpateError
from palpate_multis import (
    Population,
    Presses,
    fit,
    left_out,
    person_factor,
    read_presses,
    simulate_press,
    with_sites,
)
from palpate_multis.emulator import LENGTHS, LOWER, UPPER, WIDTHS_MM, PressEmulator, emulator, simulated

FEW = settings(max_examples=4)
thicknesses = st.tuples(*(st.floats(low, high) for low, high in zip(LOWER[:3], UPPER[:3], strict=True)))


@cache
def presses() -> Presses:
    return read_presses()


@cache
def population() -> Population:
    return fit(presses())


@pytest.mark.slow
@FEW
@given(thicknesses, st.floats(1.1, 3.0))
def test_stiffer_layers_and_a_wider_probe_need_more_force(layers: tuple[float, ...], factor: float) -> None:
    soft = simulate_press(layers, (20.0, 0.4), 8.0)
    assert simulate_press(layers, (20.0, 0.4 * factor), 8.0).compliance < soft.compliance
    force_per_mm = [
        45.0 * width / simulate_press(layers, (20.0, 0.4), width).compliance for width in (8.0, 15.0)
    ]
    assert force_per_mm[1] > force_per_mm[0]
    assert soft.shares.sum() == pytest.approx(1.0)


def test_a_thin_layer_is_compressed_as_a_column_that_cannot_bulge() -> None:
    """Far from the edges of the probe, p/u = E(1 − ν)/((1 + ν)(1 − 2ν))/h."""
    press = simulate_press((0.05, 0.05, 0.1), (1.0, 1.0), 60.0)
    assert press.compliance == pytest.approx(0.2 * 1.49 * 0.02 / 0.51, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("width", WIDTHS_MM)
def test_the_kept_lengths_are_the_most_likely_ones(width: float) -> None:
    searched, rng = PressEmulator(width, simulated(width)), np.random.default_rng(1)
    np.testing.assert_allclose(LENGTHS[width], searched._process.lengths, rtol=1e-3)
    inputs = np.exp(rng.uniform(np.log(LOWER), np.log(UPPER), (200, 5)))
    for kept, again in zip(emulator(width)(inputs), searched(inputs), strict=True):
        np.testing.assert_allclose(kept, again, rtol=1e-3, atol=1e-4)


@pytest.mark.slow
def test_the_emulator_reproduces_its_runs_and_those_left_out() -> None:
    for width in WIDTHS_MM:
        compliance, share = np.sqrt((emulator(width).left_out ** 2).mean(axis=0))
        assert compliance < 0.025
        assert share < 0.01
    press = simulate_press((1.4, 6.0, 30.0), (40.0, 0.4), 15.0)
    compliance, _ = emulator(15.0)(np.array([[1.4, 6.0, 30.0, 40.0, 0.4]]))
    assert compliance[0] == pytest.approx(press.compliance, rel=0.03)


@pytest.mark.slow
def test_runs_of_the_embedded_solver_with_finite_strain_agree() -> None:
    """Neo-Hookean, a rounded box with contact, 10 % of the thickness deep: every fourth of 55 runs."""
    with (files("palpate_multis") / "data" / "runs_jax.csv").open("rb") as stream:
        runs = pl.read_csv(stream)
    names = ["skin_mm", "fat_mm", "muscle_mm", "skin_ratio", "fat_ratio"]
    logs = []
    for row in runs.gather_every(4).iter_rows(named=True):
        values = [row[name] for name in names]
        small = simulate_press(values[:3], values[3:], float(row["width_mm"])).compliance
        logs.append(np.log(row["compliance_mm_per_MPa"] / small))
    assert abs(np.mean(logs)) < 0.05
    assert np.std(logs) < 0.09


@pytest.mark.slow
def test_people_left_out_are_predicted() -> None:
    folds = [np.arange(k, presses().n_people, 5) for k in range(5)]
    predicted = left_out(presses(), folds)
    assert np.mean(np.abs(predicted / presses().compliance - 1.0)) < 0.315
    lower, upper = population().interval(predicted)
    assert 0.92 < np.mean((presses().compliance > lower) & (presses().compliance < upper)) < 0.98


@pytest.mark.slow
def test_people_left_out_are_predicted_better_where_the_site_is_known() -> None:
    folds = [np.arange(k, presses().n_people, 5) for k in range(5)]
    predicted = left_out(presses(), folds, by_site=True)
    assert np.mean(np.abs(predicted / presses().compliance - 1.0)) < 0.255
    by_site = with_sites(population(), presses())
    assert by_site.press_spread < 0.9 * population().press_spread
    lower, upper = by_site.interval(predicted)
    assert 0.92 < np.mean((presses().compliance > lower) & (presses().compliance < upper)) < 0.98
    with pytest.raises(PalpateError, match="press 2: site 'neck' is not one of LA_A, LA_P"):
        by_site.site_factor(np.array(["LA_A", "neck"]))


@given(st.lists(st.floats(0.2, 5.0), min_size=1, max_size=9))
def test_a_sites_factor_has_the_least_mean_relative_error(factors: list[float]) -> None:
    chosen = presses()[np.arange(len(factors))]
    middle = population().predict(chosen.layers_mm, chosen.width_mm, chosen.force_N)[0]
    ratios = np.array(factors)
    made = replace(chosen, compliance=middle * ratios, site=np.full(len(factors), "here"))
    (found,) = with_sites(population(), made).sites.values()
    error = np.abs(found / ratios - 1.0).mean()
    assert all(error <= np.abs(other / ratios - 1.0).mean() + 1e-12 for other in ratios)


def test_fats_share_of_the_compression_was_never_fitted() -> None:
    table = presses()
    _, share = population().predict(table.layers_mm, table.width_mm, table.force_N)
    thick = table.layers_mm[:, 1] > 5.0
    assert np.corrcoef(share[thick], table.fat_share[thick])[0, 1] > 0.65


def test_a_fit_finds_the_numbers_that_made_the_presses() -> None:
    truth, table = Population(muscle_MPa=0.02, fat_MPa=0.006, load_exponent=0.5), presses()
    compliance, share = truth.predict(table.layers_mm, table.width_mm, table.force_N)
    made = Presses(
        person=table.person,
        layers_mm=table.layers_mm,
        width_mm=table.width_mm,
        force_N=table.force_N,
        compliance=compliance,
        fat_share=share,
        site=table.site,
    )
    found = fit(made)
    assert found.muscle_MPa == pytest.approx(0.02, rel=0.02)
    assert found.fat_MPa == pytest.approx(0.006, rel=0.03)
    assert found.load_exponent == pytest.approx(0.5, abs=0.02)


def test_a_person_with_other_presses_has_a_narrower_interval() -> None:
    middle = np.array([500.0])
    widths = [np.subtract(*population().interval(middle, n)[::-1])[0] for n in (0, 1, 7)]
    assert widths[0] > widths[1] > widths[2]
    assert person_factor(population(), np.zeros(0)) == 1.0


@pytest.mark.slow
def test_the_command_predicts_a_table_without_results(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = "max_force_N,area_mm2,skin_mm,fat_mm,muscle_mm\n7,675,1.4,6,30\n5,360,1.2,3,15\n"
    (tmp_path / "new.csv").write_text(table)
    assert main(["predict-press", str(tmp_path / "new.csv"), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["presses"]
    assert [row["lower"] < row["compliance_mm_per_MPa"] < row["upper"] for row in rows] == [True, True]
    assert main(["predict-press", str(tmp_path / "new.csv")]) == 0
    assert "fat's share" in capsys.readouterr().out


@pytest.mark.slow
def test_presses_outside_of_what_was_simulated_have_a_status(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    head, good = "max_force_N,area_mm2,skin_mm,fat_mm,muscle_mm,site", "7,675,1.4,6,30,LL_A"
    new = tmp_path / "new.csv"
    new.write_text(f"{head}\n{good}\n7,675,1.4,60,30,LL_A\n7,675,1.4,6,30,neck\n{good}\n")
    assert main(["predict-press", str(new), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["presses"]
    assert [row["status"] for row in rows] == ["predicted", "outside", "outside", "predicted"]
    assert rows[0] == rows[3]
    assert rows[0]["compliance_mm_per_MPa"] > 0.0
    assert [rows[1][name] for name in ("compliance_mm_per_MPa", "lower", "upper", "fat_share")] == [None] * 4
    assert rows[1]["reason"] == "fat [mm] is 60; simulated presses have 0.45 to 42"
    assert "site 'neck' is not one of LA_A" in rows[2]["reason"]
    assert main(["predict-press", str(new)]) == 0
    assert "outside: fat [mm] is 60" in " ".join(capsys.readouterr().out.split())
    new.write_text(f"{head}\n7,675,14,60,300,LL_A\n")
    assert main(["predict-press", str(new)]) == 2
    assert "no press can be predicted; the first: skin [mm] is 14" in " ".join(
        capsys.readouterr().err.split()
    )


@pytest.mark.slow
def test_the_command_fits_other_presses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Presses that are 1.2 times as stiff predict such a press."""
    _measured().with_columns(pl.col("stiffness_MPa_per_mm") * 1.2).write_csv(tmp_path / "stiffer.csv")
    new, fits = tmp_path / "new.csv", []
    new.write_text("max_force_N,area_mm2,skin_mm,fat_mm,muscle_mm\n7,675,1.4,6,30\n")
    for more in ([], ["--fitted-to", str(tmp_path / "stiffer.csv")]):
        assert main(["predict-press", str(new), "--json", *more]) == 0
        fits.append(json.loads(capsys.readouterr().out))
    assert fits[0]["fit"]["muscle_MPa"] == pytest.approx(population().muscle_MPa)
    first, stiffer = (fit["presses"][0]["compliance_mm_per_MPa"] for fit in fits)
    assert stiffer == pytest.approx(first / 1.2, rel=0.05)


@pytest.mark.slow
def test_the_command_takes_sites(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    new, own = tmp_path / "new.csv", tmp_path / "own.csv"
    head, row = "max_force_N,area_mm2,skin_mm,fat_mm,muscle_mm", "7,675,1.4,6,30"
    new.write_text(f"{head},site\n{row},LL_A\n{row},UA_A\n")
    assert main(["predict-press", str(new), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    leg, arm = (press["compliance_mm_per_MPa"] for press in shown["presses"])
    assert arm / leg == pytest.approx(shown["fit"]["sites"]["UA_A"] / shown["fit"]["sites"]["LL_A"])
    assert main(["predict-press", str(new)]) == 0
    assert "UA_A" in capsys.readouterr().out
    _measured().drop("site").write_csv(own)
    assert main(["predict-press", str(new), "--fitted-to", str(own)]) == 2
    assert "give both the column 'site', or neither" in " ".join(capsys.readouterr().err.split())
    new.write_text(f"{head},site\n{row},\n")
    assert main(["predict-press", str(new)]) == 2
    assert "row 2: no site" in " ".join(capsys.readouterr().err.split())


def _measured() -> pl.DataFrame:
    with (files("palpate_multis") / "data" / "presses.csv").open("rb") as stream:
        return pl.read_csv(stream)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("table", "words"),
    [
        (_measured().head(1), "1 presses of 1 people; a fit and its spreads need 10"),
        (_measured().filter(pl.col("person") == pl.col("person").first()), "of 1 people"),
        (_measured().unique("person", maintain_order=True), "somebody who was pressed twice"),
        (_measured().with_columns(pl.col("stiffness_MPa_per_mm") * 1e4), "over muscle is 1, at the end"),
        (_measured().with_columns(pl.col("stiffness_MPa_per_mm") * 1e-4), "over muscle is 60, at the end"),
    ],
)
def test_presses_that_cannot_be_fitted_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], table: pl.DataFrame, words: str
) -> None:
    new, own = tmp_path / "new.csv", tmp_path / "own.csv"
    new.write_text("max_force_N,area_mm2,skin_mm,fat_mm,muscle_mm\n7,675,1.4,6,30\n")
    table.write_csv(own)
    assert main(["predict-press", str(new), "--fitted-to", str(own)]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("7,675,1.4,,30", "row 2: fat_mm is 'None'"),
        ("7,500,1.4,6,30", "the probes have 360 and 675"),
        ("-7,675,1.4,6,30", "row 2: max_force_N is '-7'"),
    ],
)
def test_a_bad_row_is_named(tmp_path: Path, row: str, words: str) -> None:
    (tmp_path / "bad.csv").write_text(f"max_force_N,area_mm2,skin_mm,fat_mm,muscle_mm\n{row}\n")
    with pytest.raises(PalpateError, match=words):
        read_presses(tmp_path / "bad.csv", measured=False)


def test_what_was_not_simulated_is_refused() -> None:
    layers, width, force = np.array([[1.4, 60.0, 30.0]]), np.array([15.0]), np.array([7.0])
    with pytest.raises(PalpateError, match=r"press 1: fat \[mm\] is 60"):
        population().predict(layers, width, force)
    with pytest.raises(PalpateError, match="45 × 8 and 45 × 15"):
        population().predict(np.array([[1.4, 6.0, 30.0]]), np.array([12.0]), force)
    with pytest.raises(PalpateError, match="no column"):
        read_presses(Path(str(files("palpate_multis") / "data" / "runs.csv")))


def test_runs_are_those_of_the_finite_elements() -> None:
    runs = simulated(8.0)
    press = simulate_press(runs.inputs[5, :3], runs.inputs[5, 3:], 8.0)
    assert press.compliance == pytest.approx(runs.compliance[5], rel=1e-4)
    assert press.shares[1] == pytest.approx(runs.fat_share[5], abs=1e-4)
