# ruff: noqa: E501 - a line of a layout is a line here
"""Sizes of a specimen that a file states scale its force and travel, or the missing one is asked for."""

import json
from pathlib import Path
from zipfile import ZipFile

import pytest

from palpate.errors import CurveError
from palpate_robot_log.reading.specimen import sizes_in

from .layouts_of_makers import DEPTH, FORCE, SECONDS, STRAIN, STRESS_KPA, rows
from .test_layouts_of_makers import proposed

pytestmark = pytest.mark.usefixtures("in_this_process")

TRAVEL, LOAD = 40.0 * STRAIN, 20e-3 * STRESS_KPA  # of a length of 40 mm and a section of 20 mm²
HEADS = {
    "Instron": ['"Width","10.00","mm"', '"Thickness","2.00","mm"', '"Gauge length","40.00","mm"', "", '"Extension (mm)","Load (N)"'],
    "an area": ['"Area","20.00","mm^2"', '"Length","4","cm"', '"Tensile extension (mm)","Load (N)"'],
    "Zwick": ["Probendicke a0;2;mm", "Probenbreite b0;10;mm", "Anfangsmesslänge L0;40;mm", "", "Standardweg;Standardkraft", "mm;N"],
    "Zwick, units in brackets": ["Specimen thickness [mm];2,00", "Specimen width [mm];10,00", "Grip separation [mm];40,00", "Standard travel [mm];Standard force [N]"],
    "Shimadzu": ['"Thickness","Width","Gauge Length"', '"mm","mm","mm"', '"2.0000","10.0000","40.0000"', '"Stroke","Force"', '"mm","N"'],
    "MTS": ["Width:\t10.000\tmm", "Thickness:\t2.000\tmm", "Gage Length:\t40.000\tmm", "", "Crosshead (mm)\tLoad (N)"],
    "a round one": ['"Diameter","5.04627","mm"', '"Gauge length","1.574803","in"', '"Tensile extension (mm)","Load (N)"'],
}  # fmt: skip


@pytest.mark.parametrize("name", HEADS)
def test_sizes_above_a_table_scale_it(name: str, tmp_path: Path) -> None:
    between = next(mark for mark in "\t;," if mark in HEADS[name][-1])
    decimal = "," if between == ";" else "."
    lines = [*HEADS[name], *rows(TRAVEL, LOAD, between=between, decimal=decimal)]
    (tmp_path / "t.csv").write_text("\n".join(lines), encoding="utf-8")
    curves, problem = proposed(tmp_path / "t.csv")
    assert curves is not None, problem
    found = curves["uniaxial"]
    assert (found.abscissa.min(), found.abscissa.max()) == pytest.approx((1.0, 1.2), rel=1e-5)
    assert found.ordinate.max() == pytest.approx(0.012, rel=1e-5)


@pytest.mark.parametrize("kind", ["unconfined compression", "compression"])
def test_a_cylinder_between_plates_is_pushed(kind: str, tmp_path: Path) -> None:
    head = [f"# {kind}", "# diameter = 5.04627 mm", "# height = 40 mm", "displacement_mm,force_N"]
    (tmp_path / "t.csv").write_text("\n".join([*head, *rows(TRAVEL, LOAD)]))
    curves, problem = proposed(tmp_path / "t.csv")
    assert curves is not None, problem
    found = curves["uniaxial"]
    assert (found.abscissa.min(), found.ordinate.min()) == pytest.approx((0.8, -0.012), rel=1e-5)


def test_sizes_of_a_press_are_no_specimens(tmp_path: Path) -> None:
    head = ["Indentation test", "Indenter diameter,15,mm", "Sample thickness,20,mm", "Depth (mm),Force (N)"]
    (tmp_path / "t.csv").write_text("\n".join([*head, *rows(DEPTH, FORCE)]))
    curves, problem = proposed(tmp_path / "t.csv")
    assert curves is not None, problem
    assert curves["force"].abscissa.max() == pytest.approx(8.0)


@pytest.mark.parametrize(
    "head",
    [
        "Width,10,mm\nWidth,11,mm\nThickness,2,mm",  # two specimens
        "Width,10\nThickness,2",  # no unit
        "Final width,10,mm\nFinal thickness,2,mm",
        "Width at break,10,mm\nThickness,2,mm",
        "Rate,10,mm/s\nPlaten diameter,50,mm",
    ],
)
def test_a_size_that_is_not_sure_is_not_taken(head: str) -> None:
    assert "area" not in sizes_in(head)


@pytest.mark.parametrize(
    "text",
    [
        {"depth": {"value": 1.0, "unit": "um"}, "force": {"value": 2.0, "unit": "mN"}},
        {"depth": {"um": 1.0}, "force": {"mN": 2.0}},
    ],
)
def test_units_in_each_object_count(text: dict[str, dict[str, object]], tmp_path: Path) -> None:
    samples = zip((1e3 * DEPTH).tolist(), (1e3 * FORCE).tolist(), strict=True)
    lines = [
        json.dumps(
            {
                name: {k: v if isinstance(v, str) else value for k, v in text[name].items()}
                for name, value in zip(text, of, strict=True)
            }
        )
        for of in samples
    ]
    (tmp_path / "t.jsonl").write_text("\n".join(lines))
    curves, problem = proposed(tmp_path / "t.jsonl")
    assert curves is not None, problem
    assert (curves["force"].abscissa.max(), curves["force"].ordinate.max()) == pytest.approx(
        (8.0, 9.051), rel=1e-4
    )


def test_sizes_beside_arrays_count(tmp_path: Path) -> None:
    sizes = {"width_mm": 10.0, "thickness_mm": 2.0, "gauge_length_mm": 40.0}
    table = {
        "sizes": sizes,
        "time_s": SECONDS.tolist(),
        "extension_mm": TRAVEL.tolist(),
        "load_N": LOAD.tolist(),
    }
    (tmp_path / "t.json").write_text(json.dumps(table))
    curves, problem = proposed(tmp_path / "t.json")
    assert curves is not None, problem
    assert curves["uniaxial"].ordinate.max() == pytest.approx(0.012)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"<?xml version='1.0'?><row depth='1'/>", "XML or YAML is not read; save .* its table as CSV"),
        (b"<html><table><tr><td>1</td></tr></table></html>", "XML or YAML is not read"),
    ],
)
def test_pages_are_named(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "t.dat").write_bytes(content)
    with pytest.raises(CurveError, match=message):
        proposed(tmp_path / "t.dat")


def test_an_archive_is_named(tmp_path: Path) -> None:
    with ZipFile(tmp_path / "t.zip", "w") as archive:
        archive.writestr("press.csv", "depth_mm,force_N\n0,0\n")
    with pytest.raises(CurveError, match="an archive of other files; unpack it"):
        proposed(tmp_path / "t.zip")


def test_a_moment_without_a_unit_that_is_too_small_is_asked_about(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("\n".join(["Rotation (deg),Torque", *rows(DEPTH, 2.5e-3 * FORCE)]))
    assert "Torque spans 0.02263 and shows no unit" in proposed(tmp_path / "t.csv")[1]
