"""Strain and stress as components of tensors, and curves whose first row is not at rest."""

from pathlib import Path

import numpy as np
import pytest

from palpate.domain import FloatArray

from .layouts_of_makers import DEPTH, FORCE, SECONDS, STRAIN, STRESS_KPA, rows
from .test_layouts_of_makers import proposed

pytestmark = pytest.mark.usefixtures("in_this_process")


def of_text(head: str, *columns: FloatArray) -> bytes:
    return "\n".join([head, *rows(*columns), ""]).encode()


@pytest.mark.parametrize(
    ("names", "strain", "stress", "question"),
    [
        ("LE11,S11 (kPa)", np.log1p(STRAIN), 1.0 + STRAIN, ""),
        ("NE22,S22 (kPa)", STRAIN, 1.0 + STRAIN, ""),
        ("E11,S11 (kPa)", STRAIN, 1.0, "E11: nominal, logarithmic or Green-Lagrange strain?"),
        ("Exx [-],sigma_xx [kPa]", STRAIN, 1.0, "sigma_xx [kPa]: true, second Piola-Kirchhoff or nominal?"),
        (
            "X, E:E11 PI: CUBE-1 E: 1 IP: 1, S:S11 PI: CUBE-1 E: 1 IP: 1",
            STRAIN,
            1.0,
            "shows no unit of stress",
        ),
    ],
)
def test_a_component_of_a_tensor_has_the_measure_of_its_letters(
    names: str, strain: FloatArray, stress: FloatArray, question: str, tmp_path: Path
) -> None:
    columns = [SECONDS, strain, STRESS_KPA * stress][0 if names.startswith("X") else 1 :]
    (tmp_path / "t.csv").write_bytes(of_text(names, *columns))
    curves, problem = proposed(tmp_path / "t.csv")
    assert question in problem
    if not question:
        assert curves is not None, problem
        found = curves["uniaxial"]
        assert (found.abscissa.max(), found.ordinate.max()) == pytest.approx((1.2, 0.012), rel=1e-4)


@pytest.mark.parametrize(
    ("names", "is_open"),
    [
        ("LE11,S22 (kPa)", True),
        ("Strain X (%),Stress Y (kPa)", True),
        ("Shear strain xy,Stress xx (kPa)", True),
        ("lambda_1,nominal stress P22 (kPa)", True),
        ("Transverse strain,Axial stress (kPa)", True),
        ("Strain 1,Nominal stress xx (kPa)", False),
        ("Green strain E11,PK2 stress (kPa)", False),
        ("Strain,Stress yy (kPa)", False),
    ],
)
def test_components_along_two_axes_are_asked_about(names: str, *, is_open: bool, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_bytes(of_text(names, STRAIN, STRESS_KPA))
    assert ("are of two directions" in proposed(tmp_path / "t.csv")[1]) == is_open


@pytest.mark.parametrize("names", ["LE12,S12 (MPa)", "NE23,S23 (MPa)", "Exy,nominal stress Sxy (MPa)"])
def test_a_shear_component_is_no_pull(names: str, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_bytes(of_text(names, STRAIN, STRESS_KPA))
    curves, problem = proposed(tmp_path / "t.csv")
    assert curves is None or "uniaxial" not in curves, problem


def test_a_measure_in_the_name_comes_before_that_of_a_program(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_bytes(of_text("NE11,nominal stress S11 (kPa)", STRAIN, STRESS_KPA))
    curves, problem = proposed(tmp_path / "t.csv")
    assert curves is not None, problem
    assert curves["uniaxial"].ordinate.max() == pytest.approx(1e-3 * STRESS_KPA.max(), rel=1e-4)


def test_a_stretch_below_a_half_is_pushed_or_asked_about(tmp_path: Path) -> None:
    stretch = np.linspace(0.45, 0.2, 41)
    stress = 10.0 * (stretch - stretch**-2)
    for sign in (1.0, -1.0):
        (tmp_path / "t.csv").write_bytes(of_text("Stretch,Nominal stress (kPa)", stretch, sign * stress))
        curves, problem = proposed(tmp_path / "t.csv")
        if sign < 0.0:
            assert "Stretch: stretch, or strain λ - 1? no row is at rest" in problem
        else:
            assert curves is not None, problem
            assert curves["uniaxial"].abscissa.max() == pytest.approx(0.45)


def test_a_rotation_that_never_moves_is_no_twist(tmp_path: Path) -> None:
    head = "Disp (mm),Load (N),Rotation (deg),Torque (N-mm)"
    (tmp_path / "t.csv").write_bytes(of_text(head, DEPTH, FORCE, 0.0 * DEPTH, 0.0 * DEPTH))
    curves, problem = proposed(tmp_path / "t.csv")
    assert curves is not None, problem
    assert [*curves] == ["force"]
