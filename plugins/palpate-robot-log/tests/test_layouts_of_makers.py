"""Files in makers' layouts are read right as ``inspect`` proposes, or asked about: never read wrong."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from palpate.domain import Response
from palpate.errors import CurveError
from palpate.experiment.delimited.layout import lines_of
from palpate_indentation import CsvLoader, CsvSettings
from palpate_robot_log import ColumnsLoader, ColumnsSettings, RobotLogLoader, RobotLogSettings
from palpate_robot_log.reading.inspection import inspect_log

from .known_presses import DEPTH_MM, FORCE_N, TORQUE_NMM, press, robot
from .layouts_of_makers import DEPTH, FORCE, LAYOUTS, STRAIN, STRESS_KPA, presses, rows
from .log_writers import write_text

pytestmark = pytest.mark.usefixtures("in_this_process")

ENDS = {
    "curve": ("force", (0.0, 8.0), (0.0, 9.0510)),
    "torque": ("torque", (0.0, 8.0), (0.0, 9.0510)),
    "micro": ("force", (0.0, 8e-3), (0.0, 9.0510e-6)),
    "uniaxial": ("uniaxial", (1.0, 1.2), (0.0, 0.012)),
    "simple_shear": ("simple_shear", (0.0, 0.2), (0.0, 0.012)),
    "compression": ("uniaxial", (0.8, 1.0), (-0.012, 0.0)),
}
"""Channel, and least and largest abscissa and ordinate, of what a file holds."""
QUESTIONS = {
    "Arduino and HX711": "which is the depth, and which the force",
    "specimen by strain and force": "give scale, by the area of the specimen",
    "force over time alone": "a curve needs depth and force at each time; log both",
    "turn in German degrees": "the file gives 'grad', which is no unit of angle",
    "numbers alone": "column 1, column 2: which is the depth, and which the force? name them",
    "two columns without names": "which is the depth, and which the force",
    "stress by a letter": "true, second Piola-Kirchhoff or nominal",
    "strain gauge in volts": "the file gives 'V', which is no unit of force",
    "specimen by force alone": "give both scales, by the length and the area of the specimen",
    "stress of an unknown measure": "palpate does not convert a measure 'almansi'",
    "biaxial machine": "XDisplacement_um or YDisplacement_um, and XForce_mN or YForce_mN? name one",
    "a unit that its capital leaves open": "the file gives 'UN?', which is no unit of force",
    "commas between thousands": "'1,000' next to '200' has marks between its thousands",
    "two decimal values in a cell": "'100 300.0' has marks between its thousands; export the file",
    "two values in a cell": "'100 300' has marks between its thousands; export the file",
    "two sensors in two units": "force: Load (N) or Load (lbf)? name one",
    "nanometres in capitals": "the file gives 'NM?'",
    "creep": "Stress (Pa) hardly changes, as in creep or fatigue",
    "creep from zero": "Stress (kPa) hardly changes, as in creep or fatigue",
    "fatigue": "Stress (kPa) hardly changes, as in creep or fatigue",
    "shear by its preamble": "give both scales, by the length and the area of the specimen",
    "specimen by stretch and force": "give scale, by the area of the specimen",
    "samples by number": "which is the depth, and which the force",
    "a sample by its letter": "which is the depth, and which the force",
    "two axes without a mode": "name one pair of strain and stress",
    "cantilever": "depth is the way less the deflection of the cantilever",
    "counts in hexadecimal": "enc_z, enc_f: hexadecimal counts; write decimal numbers in their units",
    "counts of four hexadecimal digits": "tick, enc, adc: hexadecimal counts; write decimal numbers",
    "newest row first": "Force (N) falls from its largest value to 0: reverse the rows",
    "stress of an indentation": "palpate does not convert a measure 'indentation'",
    "shear of a plate": "give both scales, by the length and the area of the specimen",
    "percent that R has no letter for": "the file gives '...', which is no unit of strain",
    "force in volts by its name": "the file gives 'V', which is no unit of force",
    "a unit in capitals that leaves it open": "the file gives 'MN?', which is no unit of force",
    "FemtoTools": "force: Force A [uN] or Force B [uN]? name one",
    "tension by its preamble": "give both scales, by the length and the area of the specimen",
    "bending by its preamble": "the file states a bending test",
    "bending": "palpate does not convert a measure 'flexure'",
    "amplitudes of an oscillation": "amplitudes of an oscillation are no curve",
    "moduli over frequency": "amplitudes of an oscillation are no curve",
    "inflation": "an inflation is no curve; give a test of loading",
    "flow": "a test needs strain or stretch next to stress; add its column",
    "sensor alone": "not found: position, orientation; name their columns",
    "forces of a sensor alone": "a curve needs depth and force at each time; log both",
    "metres without a word": "Displacement spans 0.008 and shows no unit; give scale, the factor to mm",
    "tracker without a wrench": "not found: time, force, moment",
    "robot without a time": "not found: time; name their columns; or add a column of seconds",
    "sensor in volts": "the file gives the unit 'V', which is no unit of force",
    "sensor in counts": "the file gives the unit 'counts', which is not known",
}
SLOW = {*presses(), "preamble of 450 lines"}
"""Layouts that take half a second or more."""


def proposed(path: Path) -> tuple[Response | None, str]:
    """Curves by the tables that are proposed for a file, or the question that they leave."""
    found = inspect_log(path)
    if problem := found.record["problem"]:
        return None, str(problem)
    table = tomllib.loads(found.study_text)["experiment"]
    settings = table.get("settings", {})
    if table["loader"] == "csv":
        return CsvLoader(CsvSettings.model_validate(settings)).load(path, found.test or None), ""
    if table["loader"] == "columns":
        return ColumnsLoader(ColumnsSettings.model_validate(settings)).load(path, found.test or None), ""
    return RobotLogLoader(RobotLogSettings.model_validate(settings)).load(path), ""


@pytest.mark.parametrize("exponent", [1.5, 2.0])
@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize(
    ("begins", "sense", "zero"),
    [(31.5, 1.0, 0.0), (62.5, -1.0, 0.0), (62.5, -1.0, -0.5)],
    ids=["rises", "falls", "a sensor that nobody zeroed"],
)
def test_a_machine_that_stops_at_its_deepest_has_depth_0_at_contact(
    tmp_path: Path, begins: float, sense: float, zero: float, noise: float, exponent: float
) -> None:
    """Free travel before contact and no rest behind it, as most machines record a compression."""
    depth = np.linspace(-2.0, 6.0, 161)
    force = np.clip(depth, 0.0, None) ** exponent * 8.0 / 6.0**exponent
    force += np.random.default_rng(1).normal(0.0, noise, force.size)
    path = tmp_path / "file.csv"
    lines = rows((depth + 2.0) / 0.25, begins + sense * (depth + 2.0), force + zero)
    path.write_text("\n".join(["Time (s),Position (mm),Load (N)", *lines]) + "\n", encoding="utf-8")
    curves, problem = proposed(path)
    assert curves is not None, problem
    found = curves["force"]
    assert found.abscissa.max() == pytest.approx(6.0, abs=0.3)
    assert found.ordinate.max() == pytest.approx(8.0, abs=0.05)
    assert found.abscissa.min() >= -0.1


def test_a_stage_without_a_turn_is_read_by_its_three_forces(tmp_path: Path) -> None:
    p = press(twist=False, retract=True)
    names = "Time [ms],Stage X [mm],Stage Y [mm],Stage Z [mm],FX [mN],FY [mN],FZ [mN]"
    path = tmp_path / "file.csv"
    lines = rows(1e3 * p.time_s, p.tip_mm, 1e3 * p.pose.apply(p.force_N), form="{:.13g}")
    path.write_text("\n".join([names, *lines]) + "\n", encoding="utf-8")
    curves, problem = proposed(path)
    assert curves is not None, problem
    assert [*curves] == ["force"]
    assert curves["force"].ordinate.max() == pytest.approx(FORCE_N, abs=0.1)


def test_the_way_of_grips_is_a_test_of_a_specimen(tmp_path: Path) -> None:
    lines = ["Grip separation (mm),Load (N)", *rows(DEPTH, FORCE)]
    (tmp_path / "t.csv").write_text("\n".join(lines))
    assert "give both scales, by the length" in proposed(tmp_path / "t.csv")[1]


def test_messages_as_text_are_no_table(tmp_path: Path) -> None:
    message = "header:\n  frame_id: tool0\nwrench:\n  force:\n    x: 0.1\n    y: 0.2\n    z: -3.1\n---\n"
    path = tmp_path / "echo.txt"
    path.write_text(30 * message, encoding="utf-8")
    with pytest.raises(CurveError, match="rostopic echo -p"):
        inspect_log(path)
    path.write_text(30 * "t= 0.1 s  X: 4.0 mm  Y: -2.5 mm  Fz: .4 N\n", encoding="utf-8")
    with pytest.raises(CurveError, match="a name before each number of a line, and no table"):
        inspect_log(path)


def test_a_table_whose_lines_are_columns_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("".join(f"{name},{','.join(map(str, range(40)))}\n" for name in ("depth_mm", "force_N")))
    with pytest.raises(CurveError, match="transpose the table"):
        inspect_log(path)


def test_a_unit_in_every_cell_is_read(tmp_path: Path) -> None:
    lines = [f"{depth:.2f} mm,{force:.4f} N" for depth, force in zip(DEPTH, FORCE, strict=True)]
    (tmp_path / "t.csv").write_text("\n".join(["depth,force", *lines]))
    curves, problem = proposed(tmp_path / "t.csv")
    assert curves is not None, problem
    np.testing.assert_allclose(curves["force"].ordinate, FORCE, atol=1e-4)


def test_whole_numbers_without_a_unit_may_be_counts(tmp_path: Path) -> None:
    made = press(twist=True)
    table = robot(made) | {f"f{axis}": np.round(1e6 * made.force_N[:, k]) for k, axis in enumerate("xyz")}
    write_text(tmp_path / "t.csv", {"t": made.time_s} | {k: v for k, v in table.items() if k[2:] != "_N"})
    found = inspect_log(tmp_path / "t.csv")
    assert any("without a unit, as of counts" in each for each in found.findings)
    assert "shows no unit" in found.record["problem"]


@pytest.mark.filterwarnings("ignore:Gimbal lock")
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in LAYOUTS],
)
def test_a_makers_file_is_read_right_or_asked_about(name: str, tmp_path: Path) -> None:
    layout = LAYOUTS[name]()
    path = tmp_path / f"file.{layout.ending}"
    path.write_bytes(layout.content)
    if layout.holds == "refused":
        with pytest.raises(CurveError, match=QUESTIONS[name]):
            inspect_log(path)
        return
    curves, question = proposed(path)
    if layout.holds == "question":
        assert QUESTIONS[name] in question
        return
    assert curves is not None, question
    if layout.holds == "press":
        assert {*curves} == {"force", "torque"}
        force, torque = curves["force"], curves["torque"]
        assert force.abscissa.max() == pytest.approx(DEPTH_MM, abs=0.1)
        assert force.ordinate.max() == pytest.approx(FORCE_N, abs=0.1)
        assert torque.abscissa.max() == pytest.approx(22.5, abs=0.1)
        assert torque.ordinate.max() == pytest.approx(TORQUE_NMM, abs=0.5)
        return
    channel, along, of = ENDS[layout.holds]
    assert [*curves] == [channel]
    for values, ends in ((curves[channel].abscissa, along), (curves[channel].ordinate, of)):
        assert (values.min(), values.max()) == pytest.approx(ends, rel=2e-5, abs=1e-9)
    assert len({*np.sign(np.diff(curves[channel].abscissa))} - {0.0}) == 1


def test_marks_of_inches_join_no_lines() -> None:
    texts = ['Tool: 1/2" sphere', "Operator A", 'Depth ("),Force (lbf)', "0.1,2.0"]
    assert lines_of("\n".join(texts))["text"].to_list() == texts


@pytest.mark.parametrize("names", ["Odkształcenie [%];Naprężenie [kPa]", "Deformação (%);Tensão (kPa)"])
def test_strain_and_stress_have_names_in_other_languages(names: str, tmp_path: Path) -> None:
    lines = [names, *rows(100.0 * STRAIN, STRESS_KPA, between=";", decimal=",")]
    (tmp_path / "t.csv").write_text("\n".join(lines), encoding="utf-8")
    curves, problem = proposed(tmp_path / "t.csv")
    assert curves is not None, problem
    assert curves["uniaxial"].ordinate.max() == pytest.approx(0.012)
    assert curves["uniaxial"].abscissa.max() == pytest.approx(1.2)


@pytest.mark.parametrize(("name", "unloaded"), [("Strain", 0.0), ("Stretch", 1.0)])
def test_a_strain_that_begins_where_the_stress_was_zeroed_is_asked_about(
    name: str, unloaded: float, tmp_path: Path
) -> None:
    for begin in (0.0, 0.05):
        lines = [f"{name},Nominal stress (kPa)", *rows(unloaded + begin + STRAIN, STRESS_KPA)]
        (tmp_path / "t.csv").write_text("\n".join(lines))
        question = f"{name} is {unloaded + begin:.4g} where the stress begins: is it zeroed there?"
        assert (question in proposed(tmp_path / "t.csv")[1]) == (begin > 0.0)


@pytest.mark.parametrize("name", ["lambda - 1", "λ-1", "Stretch (%)"])
def test_a_stretch_that_begins_at_0_is_a_strain(name: str, tmp_path: Path) -> None:
    values = (100.0 if "%" in name else 1.0) * STRAIN
    lines = [f"{name},Nominal stress (kPa)", *rows(values, STRESS_KPA)]
    (tmp_path / "t.csv").write_text("\n".join(lines), encoding="utf-8")
    curves, problem = proposed(tmp_path / "t.csv")
    assert curves is not None, problem
    found = curves["uniaxial"].abscissa
    assert (found.min(), found.max()) == pytest.approx((1.0, 1.2))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("farthest", [1.0, 3.0])
def test_a_stretch_whose_first_row_is_the_most_compressed_is_no_strain(
    sign: float, farthest: float, tmp_path: Path
) -> None:
    stretch = np.linspace(0.4, farthest, 61)
    names = "lambda,Nominal stress (kPa)" if sign > 0.0 else "Stretch,Compressive stress (kPa)"
    lines = [names, *rows(stretch, sign * 10.0 * (stretch - stretch**-2))]
    (tmp_path / "t.csv").write_text("\n".join(lines))
    curves, problem = proposed(tmp_path / "t.csv")
    assert curves is not None, problem
    found = curves["uniaxial"].abscissa
    assert (found.min(), found.max()) == pytest.approx((0.4, farthest))


@pytest.mark.parametrize("unloaded", [0.0, 1.0])
def test_a_stretch_next_to_force_is_a_strain_where_it_begins_at_0(unloaded: float, tmp_path: Path) -> None:
    lines = ["Grip stretch,Force (N)", *rows(unloaded + STRAIN, STRESS_KPA)]
    (tmp_path / "t.csv").write_text("\n".join(lines))
    channels = inspect_log(tmp_path / "t.csv").record["channels"]["uniaxial"]
    assert channels["abscissa"] == ("Grip stretch" if unloaded else {"name": "Grip stretch", "offset": 1.0})


def test_a_stretch_in_percent_is_read_and_without_a_unit_asked_about(tmp_path: Path) -> None:
    for name in ("Stretch (%)", "Stretch"):
        lines = [f"{name},Nominal stress (kPa)", *rows(100.0 + 100.0 * STRAIN, STRESS_KPA)]
        (tmp_path / "t.csv").write_text("\n".join(lines))
        curves, problem = proposed(tmp_path / "t.csv")
        if name == "Stretch":
            assert problem == "Stretch goes to 120: in percent? give scale, 0.01 or 1"
        else:
            assert curves is not None, problem
            assert curves["uniaxial"].abscissa.max() == pytest.approx(1.2)
