"""Names are read for their meaning: the proposal of `inspect` gives the truth at the first try, or asks."""

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.api.files import Column, unit_in
from palpate.domain import FloatArray
from palpate_indentation import CsvLoader, CsvSettings
from palpate_robot_log import RobotLogLoader
from palpate_robot_log.reading.inspection import inspect_log
from palpate_robot_log.reading.names import pick, test_of as measures_of, words_of
from palpate_robot_log.reading.processed_curves import _stepped
from palpate_robot_log.reading.quantities import time_of
from palpate_robot_log.reading.raw import Stream
from palpate_robot_log.robot_log import RobotLogSettings

from . import log_writers as write
from .known_presses import DEPTH_MM, FORCE_N, Table, press, robot

DATA = Path(__file__).parent / "data" / "tables"


pytestmark = pytest.mark.usefixtures("in_this_process")


def experiment(path: Path) -> Any:
    return tomllib.loads(inspect_log(path).study_text)["experiment"]


def curve_of(path: Path, channel: str) -> Any:
    table = experiment(path)
    assert table["loader"] == "csv"
    only = channel if channel not in ("force", "torque") else None
    return CsvLoader(CsvSettings.model_validate(table.get("settings", {}))).load(path, only)[channel]


# ------------------------------------------------------------------------- tables


@pytest.mark.parametrize(
    ("file", "channel", "along", "of"),
    [
        ("true_stress.csv", "uniaxial", (1.0, 1.25), (0.0, 0.02421)),
        ("compressive_positive.csv", "uniaxial", (0.75, 1.0), (-0.04067, 0.0)),
        ("shear_strain.csv", "simple_shear", (0.0, 0.5), (0.0, 0.01977)),
        ("strain_percent.csv", "uniaxial", (1.0, 1.15), (0.0, 0.01571)),
        ("angle_taken_for_time.csv", "torque", (0.0, 20.0), (0.0, 22.0)),
        ("load_and_unload.csv", "force", (0.0, 10.0), (0.0, 9.051)),
        ("load_hold_unload.csv", "force", (0.0, 10.0), (0.0, 9.051)),
        ("depth_negative.csv", "force", (0.0, 10.0), (0.0, 9.051)),
        ("stage_position.csv", "force", (0.0, 10.0), (0.0, 9.051)),
        ("stroke_load.csv", "force", (0.0, 8.0), (0.0, 9.051)),
        ("weg_kraft.csv", "force", (0.0, 8.0), (0.0, 9.051)),
        ("micro_units.txt", "force", (0.0, 0.008), (0.0, 9.051e-5)),
    ],
)
def test_a_table_gives_its_curve_at_the_first_try(
    file: str, channel: str, along: tuple[float, float], of: tuple[float, float]
) -> None:
    assert inspect_log(DATA / file).record["problem"] == ""
    curve = curve_of(DATA / file, channel)
    assert len(curve.branches) == 1
    for values, ends in ((curve.abscissa, along), (curve.ordinate, of)):
        np.testing.assert_allclose((values.min(), values.max()), ends, rtol=1e-3, atol=1e-9)


def written(path: Path, names: str, *columns: FloatArray) -> Path:
    delimiter = ";" if ";" in names else ","
    write.write_text(path, dict(zip(names.split(delimiter), columns, strict=True)), delimiter)
    return path


STRETCH = np.linspace(1.0, 1.3, 31)
NOMINAL = 0.02 * (STRETCH - STRETCH**-2)
SQUASHED = np.linspace(1.0, 0.7, 31)
SQUEEZED = 0.02 * (SQUASHED - SQUASHED**-2)


@pytest.mark.parametrize(
    ("names", "x", "y"),
    [
        ("Engineering strain,Engineering stress (MPa)", STRETCH - 1.0, NOMINAL),
        ("Nominal strain (%),Nominal stress (kPa)", 100.0 * (STRETCH - 1.0), 1e3 * NOMINAL),
        ("Strain,Cauchy stress (Pa)", STRETCH - 1.0, 1e6 * NOMINAL * STRETCH),
        ("Hencky strain,True stress (MPa)", np.log(STRETCH), NOMINAL * STRETCH),
        ("log_strain,cauchy_stress_kPa", np.log(STRETCH), 1e3 * NOMINAL * STRETCH),
        ("Green strain,PK2 stress (kPa)", (STRETCH**2 - 1.0) / 2.0, 1e3 * NOMINAL / STRETCH),
        (
            "Green-Lagrange strain,2nd Piola-Kirchhoff stress (MPa)",
            (STRETCH**2 - 1.0) / 2.0,
            NOMINAL / STRETCH,
        ),
        ("Stretch,PK1 stress (MPa)", STRETCH, NOMINAL),
        ("Stretch ratio,Kirchhoff stress (MPa)", STRETCH, NOMINAL * STRETCH),
        ("Dehnung (%);Spannung (MPa)", 100.0 * (STRETCH - 1.0), NOMINAL),
        ("Déformation (%);Contrainte (MPa)", 100.0 * (STRETCH - 1.0), NOMINAL),
        ("Compressive strain (%),Compressive stress (kPa)", 100.0 * (1.0 - SQUASHED), -1e3 * SQUEEZED),
        ("Compressive strain,Compressive stress (kPa)", SQUASHED - 1.0, 1e3 * SQUEEZED),
        ("True compressive strain,True compressive stress (MPa)", -np.log(SQUASHED), -SQUEEZED * SQUASHED),
        ("Compression stretch,Compression stress (MPa)", SQUASHED, -SQUEEZED),
    ],
)
def test_a_homogeneous_test_is_converted_by_its_names(
    names: str, x: FloatArray, y: FloatArray, tmp_path: Path
) -> None:
    curve = curve_of(written(tmp_path / "test.csv", names, x, y), "uniaxial")
    is_squashed = "ompress" in names
    np.testing.assert_allclose(curve.abscissa, SQUASHED if is_squashed else STRETCH, rtol=1e-9)
    np.testing.assert_allclose(curve.ordinate, SQUEEZED if is_squashed else NOMINAL, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("names", "question"),
    [
        ("Almansi strain,Stress (MPa)", "does not convert a measure 'almansi'"),
        ("Strain,Biot stress (MPa)", "does not convert a measure 'biot'"),
        ("Strain,Piola-Kirchhoff stress (MPa)", "first or second Piola-Kirchhoff"),
        ("True strain,Stress (MPa)", "true, second Piola-Kirchhoff or nominal"),
        ("True engineering strain,True stress (MPa)", "the name has two measures"),
        ("Shear strain,PK2 shear stress (MPa)", "needs the normal stress"),
        ("Strain,Stress", "Stress shows no unit of stress"),
        ("Strain,Stress (bananas)", "the file gives 'bananas', which is no unit of stress"),
        ("Strain A,Strain B,Stress (MPa)", "Strain A or Strain B? name one pair"),
        ("Strain,Stress (kPa)", "Strain goes to 15: in percent? give scale, 0.01 or 1"),
        ("Depth (mm),Load (V)", "the file gives 'V', which is no unit of force"),
        ("Tensile extension (mm),Tensile load (N)", "the length and the area of the specimen"),
        ("Displacement_mm,Force_N,Size_mm", "the length and the area of the specimen"),  # it grows
        ("F11,P11 (kPa)", "needs strain or stretch next to stress; is it F11? name it"),
        ("DEPTH_MM,FORCE_MN", "the file gives 'MN?', which is no unit of force"),
        ("Depth (mm),Force stat,Force dyn", "Force dyn or Force stat? name one"),  # dynamic, not in dyn
    ],
)
def test_a_name_that_is_not_certain_is_asked_about(names: str, question: str, tmp_path: Path) -> None:
    columns = [STRETCH - 1.0 + 0.1 * k for k in range(names.count(",") + 1)]
    columns[0] = 50.0 * columns[0] if "percent" in question else columns[0]
    found = inspect_log(written(tmp_path / "t.csv", names, *columns))
    assert question in found.record["problem"]
    assert any(question in finding for finding in found.findings)
    assert "experiment" not in tomllib.loads(found.study_text)


@pytest.mark.parametrize(
    ("names", "mode"),
    [
        ("Strain|Stress", "uniaxial"),
        ("Equibiaxial strain|Stress", "equibiaxial"),
        ("Pure shear strain|Stress", "pure_shear"),
        ("Shear strain|Shear stress", "simple_shear"),
        ("Confined compression strain|Stress", "confined_compression"),
        ("Unconfined compression strain|Stress", "uniaxial"),
    ],
)
def test_the_mode_of_a_test_is_in_its_names(names: str, mode: str) -> None:
    strain, stress = (Column(name=name, values=np.arange(3.0)) for name in names.split("|"))
    assert measures_of(strain, stress, (), set()).mode == mode


@pytest.mark.parametrize(
    ("text", "states"),
    [
        ("Machine: CellScale biaxial tester / Test: uniaxial tension", None),
        ("Sample from shear wave elastography study / Test: unconfined compression", None),
        ("strain rate 0.1 /s, shear modulus n/a / Test: compression", None),
        ("Load cell: 10 N tension/compression / Test: uniaxial", None),
        ("Operator: Pure Steel Planar Inc.", "pure_shear"),
        ("Test: uniaxial tension", "uniaxial"),
        ("Test: uniaxial", "uniaxial"),
        ("Test: confined compression", "confined_compression"),
        ("Specimen of pure gelatine", ""),
        *((f"Test: {word}", "uniaxial") for word in ("uniaxial compression", "Druckversuch", "Druckprüfung")),
        *((f"Test: {word}", "uniaxial") for word in ("compresión", "Compressione", "Compressão")),
        *((f"Test: {word}", "simple_shear") for word in ("Scherversuch", "cisaillement", "cizalladura")),
        *((f"Test: {word}", "simple_shear") for word in ("cizallamiento", "Taglio")),
    ],
)
def test_the_text_above_the_names_states_one_test_or_is_asked_about(text: str, states: str | None) -> None:
    strain, stress = (Column(name=name, values=np.arange(3.0)) for name in ("strain", "nominal stress_kPa"))
    test = measures_of(strain, stress, (), {*words_of(text)})
    assert test.questions == ("the text above the names has several tests: write the mode",) * (
        states is None
    )
    assert test.remarks == (f"the text above the names states {states}; correct it if that is wrong",) * bool(
        states
    )
    assert test.mode == (states or "uniaxial")
    assert test.is_compressive == bool(states and re.search("(?i)compr|druck", text))


@pytest.mark.parametrize(
    "names",
    [
        "Stress [MPa],Time [s],Force [N],Displacement [mm],Strain [%]",
        "Engineering stress (MPa),t (s),F (N),Ext (mm),Engineering strain (%),True strain,True stress (MPa)",
        "Axial stress (MPa),Time (s),Load (N),Stroke (mm),Axial strain (%),Transverse strain (%)",
    ],
)
def test_a_table_with_a_stress_and_a_strain_is_a_homogeneous_test(names: str, tmp_path: Path) -> None:
    table = dict.fromkeys(names.split(","), 1.0 + STRETCH)
    first, fifth = names.split(",")[0], names.split(",")[4]
    table |= {first: NOMINAL, fifth: 100.0 * (STRETCH - 1.0)}
    write.write_text(tmp_path / "t.csv", table)
    curve = curve_of(tmp_path / "t.csv", "uniaxial")
    np.testing.assert_allclose(curve.abscissa, STRETCH, rtol=1e-9)
    np.testing.assert_allclose(curve.ordinate, NOMINAL, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("names", "times"),
    [
        ("Eindringtiefe (mm);Normalkraft (N)", (1.0, 1.0)),
        ("Profondeur (mm);Effort (daN)", (1.0, 0.1)),
        ("Profundidad [cm];Carga [kgf]", (0.1, 1.0 / 9.80665)),
        ("z_um;Fz_mN", (-1e3, 1e3)),
        ("Position (mm);Load cell (N)", (-1.0, -1.0)),
        ("Depth (mm);Force (N);Force filtered (N);Target depth (mm)", (1.0, 1.0)),
    ],
)
def test_a_curve_is_read_in_its_words(names: str, times: tuple[float, float], tmp_path: Path) -> None:
    depth = np.linspace(0.0, 8.0, 41)
    table = dict.fromkeys(names.split(";"), depth)
    first, second, *_ = table
    table |= {first: times[0] * depth, second: times[1] * 0.4 * depth**1.5}
    write.write_text(tmp_path / "curve.csv", table)
    curve = curve_of(tmp_path / "curve.csv", "force")
    np.testing.assert_allclose(curve.abscissa, depth, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(curve.ordinate, 0.4 * depth**1.5, rtol=1e-9, atol=1e-9)


def test_sizes_above_the_names_are_of_a_specimen(tmp_path: Path) -> None:
    path = written(tmp_path / "t.csv", "Extension (mm),Load (N)", STRETCH - 1.0, NOMINAL)
    path.write_text("Gauge length (mm),20\nOperator,A\n\n" + path.read_text())
    assert "give scale, by the area of the specimen" in inspect_log(path).record["problem"]


@pytest.mark.parametrize(
    "above", ["Contact area,20\nSample thickness,9", "Punch area,20\nTissue thickness,9"]
)
def test_the_area_of_a_tool_is_of_no_specimen(above: str, tmp_path: Path) -> None:
    path = written(tmp_path / "t.csv", "Displacement (mm),Load (N)", STRETCH - 1.0, NOMINAL)
    path.write_text(f"{above}\n\n{path.read_text()}")
    assert inspect_log(path).record["problem"] == ""


@pytest.mark.parametrize("names", ["Depth (mm),Force (N),Size (mm)", "Displacement (mm),Force (N),Step size"])
@pytest.mark.parametrize("times", [1.0, 100.0])
def test_a_size_that_is_not_the_specimens_leaves_a_press(names: str, times: float, tmp_path: Path) -> None:
    path = written(tmp_path / "t.csv", names, STRETCH - 1.0, NOMINAL, times * (STRETCH - 1.0))
    assert inspect_log(path).record["problem"] == ""


@pytest.mark.parametrize("names", ["Depth (mm),Force (N)", "Strain,Stress (kPa)"])
@pytest.mark.parametrize(("n_steps", "is_asked"), [(10, True), (2, False), (200, False)])
def test_rests_on_the_way_are_a_question(names: str, n_steps: int, is_asked: bool, tmp_path: Path) -> None:
    depth = np.linspace(0.0, 1.0, n_steps + 1).repeat(400 // n_steps)
    found = inspect_log(written(tmp_path / "t.csv", names, depth, 5.0 * depth))
    assert ("as in stepwise relaxation" in found.record["problem"]) == is_asked


WAIT = np.random.default_rng(0).normal(scale=0.002, size=1000)


@pytest.mark.parametrize(
    "depth",
    [
        np.r_[np.zeros(800), np.linspace(0.0, 4.0, 200)] + WAIT,
        np.round(np.r_[np.zeros(300), np.linspace(0.0, 4.0, 200)] + WAIT[:500], 3),
        np.r_[np.linspace(0.0, 2.0, 100), np.full(300, 2.0), np.linspace(2.0, 4.0, 100)] + WAIT[:500],
        np.round(np.linspace(0.0, 4.0, 1000), 1),
        np.linspace(0.0, 4.0, 29).repeat(100),
    ],
    ids=["noise before", "rounded noise before", "one rest", "steps of 0.1 mm", "10 Hz in 1 kHz"],
)
def test_a_wait_or_a_coarse_depth_is_no_stepwise_test(depth: FloatArray) -> None:
    assert not [*_stepped(Column(name="Depth (mm)", values=depth))]


@pytest.mark.parametrize("n_steps", [4, 10])
def test_steps_with_noise_and_ramps_are_counted(n_steps: int) -> None:
    each = np.r_[np.linspace(0.0, 1.0, 15, endpoint=False), np.ones(35)]
    depth = np.r_[np.zeros(200), *(4.0 / n_steps * (k + each) for k in range(n_steps))]
    (asked,) = _stepped(Column(name="Depth (mm)", values=depth + WAIT[: depth.size]))
    assert f"rests {n_steps - 1} times on its way" in asked


@pytest.mark.parametrize(("unit", "is_odd"), [("kPa", False), ("MPa", True)])
def test_a_stiffness_of_no_soft_tissue_is_stated(unit: str, is_odd: bool, tmp_path: Path) -> None:
    path = written(tmp_path / "t.csv", f"Strain,Stress ({unit})", STRETCH - 1.0, 5e3 * NOMINAL)
    assert ("is of no soft tissue" in "".join(inspect_log(path).findings)) == is_odd


@pytest.mark.parametrize(
    ("names", "is_asked"), [("Extension", True), ("Displacement", True), ("Depth", False)]
)
def test_a_press_that_no_word_shows_is_stated(names: str, is_asked: bool, tmp_path: Path) -> None:
    found = inspect_log(written(tmp_path / "t.csv", f"{names} (mm),Load (N)", STRETCH - 1.0, NOMINAL))
    remark = next((f for f in found.findings if "a press is assumed, as the file states no test" in f), "")
    assert bool(remark) == is_asked
    # The settings of a tension test of the specimen, to fill in.
    of_specimen = f'abscissa = {{ name = "{names} (mm)", scale = 1/L, offset = 1 }} and ordinate'
    assert (of_specimen in remark) == is_asked


@pytest.mark.parametrize("base", [0.0, 20.0, -20.0])
@pytest.mark.parametrize("push", [1.0, -1.0])
def test_a_force_is_one_of_a_push_whatever_it_is_in_free_air(
    base: float, push: float, tmp_path: Path
) -> None:
    travel = np.linspace(0.0, 10.0, 101)
    force = 0.4 * np.maximum(travel - 4.0, 0.0) ** 1.5
    path = written(tmp_path / "t.csv", "Displacement (mm),Load (N)", travel, base + push * force)
    curve = curve_of(path, "force")
    np.testing.assert_allclose(curve.ordinate[-1], force[-1], rtol=1e-6)
    assert curve.ordinate.min() > -1e-6
    turned = [finding for finding in inspect_log(path).findings if "falls under load" in finding]
    assert len(turned) == (push < 0.0)


def test_the_plainer_of_two_columns_is_taken_with_a_remark() -> None:
    columns = [
        Column(name=name, values=np.arange(3.0))
        for name in (
            "Force filtered (N)",
            "Force (N)",
            "Peak force (N)",
            "Commanded depth (mm)",
            "Depth (mm)",
        )
    ]
    force, depth = pick(columns, "force"), pick(columns, "travel")
    assert force is not None
    assert depth is not None
    assert force.column.name == "Force (N)"
    assert "and not Force filtered (N), Peak force (N)" in force.remarks[0]
    assert depth.column.name == "Depth (mm)"
    commanded = pick(columns[:4], "travel")
    assert commanded is not None
    assert any("commanded, not measured" in remark for remark in commanded.remarks)
    alike = [Column(name=f"Force {k} (N)", values=np.arange(3.0)) for k in "12"]
    assert pick(alike, "force") is None


# ---------------------------------------------------------------- machines of one axis


def machine(names: str, sign: float = 1.0, start: float = 0.0, push: float = 1.0) -> Callable[[], Table]:
    """Table of time, travel and load in this order, where the load is ``push`` times the force."""

    def table() -> Table:
        made = press()
        down = -(made.tip_mm[:, 2] - made.tip_mm[0, 2])
        columns = (made.time_s, start + sign * down, -push * made.force_N[:, 2])
        return dict(zip(names.split("|"), columns, strict=True))

    return table


MACHINES: dict[str, Callable[[], Table]] = {
    "crosshead": machine("Time (s)|Crosshead (mm)|Load (N)"),
    "texture analyser": machine("Time (sec)|Distance (mm)|Force (gf)", push=101.972),
    "instron": machine("Time (s)|Compressive extension (mm)|Compressive load (kN)", push=1e-3),
    "electroforce": machine("Elapsed Time (s)|Disp (mm)|Load (N)", sign=-1.0, push=-1.0),
    "german": machine("Prüfzeit [s]|Traversenweg [mm]|Standardkraft [N]", start=5.0),
    "french": machine("Temps (ms)|Déplacement (mm)|Charge (N)", sign=1.0),
    "spanish": machine("Tiempo (s)|Desplazamiento (mm)|Fuerza (N)"),
    "height of a stage": machine("t (s)|Position (mm)|Force (N)", sign=-1.0, start=120.0),
    "units by their size": machine("time|travel|force"),
    "names of no role": machine("Time (s)|Ch1 (mm)|Ch2 (N)"),
}


@pytest.mark.parametrize("name", MACHINES)
def test_a_machine_of_one_axis_is_proposed_as_such(name: str, tmp_path: Path) -> None:
    table = MACHINES[name]()
    if name == "french":
        table["Temps (ms)"] = 1e3 * table["Temps (ms)"]
    write.write_text(tmp_path / "log.csv", table)
    found = inspect_log(tmp_path / "log.csv")
    assert found.record["problem"] == ""
    assert any("a testing machine of one axis" in finding for finding in found.findings)
    assert any("its curves: force " in finding for finding in found.findings)
    settings = tomllib.loads(found.study_text)["experiment"]["settings"]
    response = RobotLogLoader(RobotLogSettings.model_validate(settings)).load(tmp_path / "log.csv")
    assert [*response.curves] == ["force"]
    assert response.curves["force"].ordinate[-1] == pytest.approx(FORCE_N, rel=0.01)
    assert response.curves["force"].abscissa[-1] == pytest.approx(DEPTH_MM, abs=0.08)


def test_a_machine_that_stops_under_load_needs_no_free_air_after_it(tmp_path: Path) -> None:
    made = press(retract=False)
    down = made.tip_mm[0, 2] - made.tip_mm[:, 2]
    table = {"Time (s)": made.time_s, "Stroke (mm)": down, "Load (N)": -made.force_N[:, 2]}
    write.write_text(tmp_path / "log.csv", table)
    settings = experiment(tmp_path / "log.csv")["settings"]
    assert settings["drift"] == {"enabled": False}
    curve = RobotLogLoader(RobotLogSettings.model_validate(settings)).load(tmp_path / "log.csv")["force"]
    assert curve.ordinate[-1] == pytest.approx(FORCE_N, rel=0.01)


# ------------------------------------------------------------------------------ time


@pytest.mark.parametrize(
    "name",
    ["Displacement (mm)", "Rotation (deg)", "Height (nm)", "Strain", "stretch", "Angle", "Volume (ml)"],
)
def test_a_quantity_that_rises_is_no_time(name: str, tmp_path: Path) -> None:
    table = write.press()
    del table["time_s"]
    write.write_text(tmp_path / "log.csv", {name: np.linspace(0.0, 5.0, 240)} | table)
    found = inspect_log(tmp_path / "log.csv")
    assert found.record["problem"].startswith("not found: time")


@pytest.mark.parametrize("name", ["frame", "sample_no", "Index", "count", "seq", "row", "i"])
def test_a_counter_is_asked_for_its_rate(name: str, tmp_path: Path) -> None:
    made = press()
    table = {name: np.arange(float(made.time_s.size))} | robot(made)
    write.write_text(tmp_path / "log.csv", table)
    found = inspect_log(tmp_path / "log.csv")
    assert f'or give time = {{ column = "{name}", rate = "… Hz" }}' in found.record["problem"]
    assert any(f"{name} counts rows and is no time: give the rate" in finding for finding in found.findings)
    text = found.study_text.replace(f'# time = {{ column = "{name}", rate = "… Hz" }}', 'time = "?"')
    settings = tomllib.loads(text)["experiment"]["settings"]
    settings["channels"]["time"] = {"column": name, "rate": "25 Hz"}
    loader = RobotLogLoader(RobotLogSettings.model_validate(settings))
    force = loader.load(tmp_path / "log.csv")["force"]
    assert force.ordinate[-1] == pytest.approx(FORCE_N, rel=0.01)
    assert force.time_s is not None
    assert force.time_s[-1] - force.time_s[0] == pytest.approx(4.0, abs=0.3)


def test_a_dynamic_force_is_in_dyn_in_brackets_alone() -> None:
    assert [unit_in(name)[1] for name in ("force_dyn", "Fx dyn", "Force [dyn]")] == ["", "", "dyn"]


def test_a_rate_is_no_unit() -> None:
    with pytest.raises(ValueError, match="leave unit and nanoseconds out"):
        write.channel_map(time={"column": "frame", "rate": "25 Hz", "unit": "s"})


def test_a_clock_that_is_coarser_than_the_rows_keeps_the_first(tmp_path: Path) -> None:
    made = press(100.0)
    write.write_text(tmp_path / "log.csv", {"time_s": np.floor(made.time_s * 70.0) / 70.0} | robot(made))
    found = inspect_log(tmp_path / "log.csv")
    assert found.record["problem"] == ""
    assert found.record["channels"]["repeated_time"] == "keep_first"
    assert any("rows repeat the time of the row before" in finding for finding in found.findings)


@pytest.mark.parametrize(
    ("step", "n_rows", "unit"),
    [
        (0.24, 60, "s"),
        (1.0, 40, "s"),
        (4.0, 9000, "ms"),
        (20.0, 358, "ms"),
        (1e3, 30_000, "us"),
        (2e7, 900, "ns"),
    ],
)
def test_the_unit_of_a_time_is_judged_by_the_length_of_the_log(step: float, n_rows: int, unit: str) -> None:
    column = Column(name="stamp", values=1e9 + step * np.arange(n_rows))
    time = time_of(Stream.of([column]))
    assert time is not None
    assert time.entry["unit"] == unit


@pytest.mark.slow
def test_a_homogeneous_test_leads_to_a_study_without_a_mesh(call: Any, tmp_path: Path) -> None:
    (tmp_path / "pull.csv").write_text((DATA / "true_stress.csv").read_text())
    shown = call("experiment", "inspect", "pull.csv", plugin=None)
    assert "palpate init my-study --measured pull.csv" in shown.err
    assert "--mesh" not in shown.out + shown.err
    assert call("init", "rubber", "--measured", "pull.csv", plugin=None).code == 0
    study = tomllib.loads((tmp_path / "rubber" / "study.toml").read_text())
    assert study["spot"] == [{"name": "specimen", "measured": {"uniaxial": "../pull.csv"}}]
    assert study["selection"] == {"scenarios": ["test"]}
    assert study["experiment"]["settings"]["channels"]["uniaxial"]["stress"] == "true"
    assert call("check", "rubber", plugin=None).code == 0
    (tmp_path / "limb.vtu").write_text("never read")
    with_mesh = call("init", "b", "--measured", "pull.csv", "--mesh", "limb.vtu", plugin=None)
    assert "needs no mesh; leave --mesh out" in with_mesh.err.replace("\n", " ")
