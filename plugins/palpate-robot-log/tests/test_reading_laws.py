"""Laws of reading: fast is slow, forms of a turn agree, and no bytes lead a reader astray."""

import math
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from scipy.spatial.transform import Rotation

from palpate.api.files import (
    UNITS,
    Kind,
    TextTable,
    factor_to_base,
    kind_of,
    unit_in,
)
from palpate.domain import FloatArray
from palpate.errors import CurveError
from palpate.experiment.delimited.header_units import bare_unit
from palpate_robot_log.reading.assembly import quaternions
from palpate_robot_log.reading.formats import read_here
from palpate_robot_log.reading.raw import RawLog
from palpate_robot_log.reading.robots import propose

from . import log_writers as write

pytest.importorskip("h5py")
pytest.importorskip("rosbags")

numbers = st.floats(-1e300, 1e300)
tables = st.integers(2, 5).flatmap(
    lambda width: st.lists(st.lists(numbers, min_size=width, max_size=width), min_size=2, max_size=12)
)
marks = st.sampled_from([(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), ("|", ",")])


def _written(rows: list[list[float]], delimiter: str, decimal: str, ending: str = "\n") -> str:
    lines = [delimiter.join(f"c{i}" for i in range(len(rows[0])))]
    lines += [delimiter.join(repr(value).replace(".", decimal) for value in row) for row in rows]
    return ending.join(lines) + ending


def _columns(path: Path, wanted: list[str] | None = None) -> FloatArray:
    _, columns = TextTable(path).read(wanted)
    return np.column_stack([column.values for column in columns.values()])


# ------------------------------------------------------------------------- text


@given(rows=tables, mark=marks, ending=st.sampled_from(["\n", "\r\n"]))
def test_what_is_written_as_text_is_read_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, rows: list[list[float]], mark: tuple[str, str], ending: str
) -> None:
    path = tmp_path_factory.mktemp("text") / "t.csv"
    path.write_text(_written(rows, *mark, ending), newline="")
    np.testing.assert_array_equal(_columns(path), np.array(rows))


cells = st.one_of(
    numbers.map(repr),
    st.sampled_from(
        [
            "",
            "nan",
            "NaN",
            "inf",
            "-Infinity",
            "1e999",
            "1_0",
            "0x1p3",
            " 1",
            "1 ",
            "+1",
            "--1",
            "1e",
            ".5",
            "5.",
        ]
    ),
    st.sampled_from(
        ["1,5", "1.5.2", "ja", "١", "1e+05", "1E-3", "-.5e2", "true", '"1"', "1d3", "e5", "+", "."]
    ),
)


def _number(cell: str) -> float | None:
    """Number of a cell by the rule of the reader; NaN where it is empty, None where it is a word."""
    plain = cell.strip().removeprefix('"').removesuffix('"')
    if plain.lower() in {"", "nan"}:
        return math.nan
    if not re.fullmatch(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eEdD][+-]?[0-9]+)?", plain):
        return None
    value = float(plain.lower().replace("d", "e"))
    return value if math.isfinite(value) else None


@given(rows=st.lists(st.lists(cells, min_size=3, max_size=3), min_size=6, max_size=8))
def test_a_cell_is_a_number_by_one_rule(
    tmp_path_factory: pytest.TempPathFactory, rows: list[list[str]]
) -> None:
    """Numbers are Python's, and the first cell that is none is refused by its line."""
    path = tmp_path_factory.mktemp("text") / "t.csv"
    # The rows at both ends are whole, so that none is a line of results.
    whole = [["0.5", "1.5", "2.5"]] * 8
    table = [*whole, *(row for row in rows if any(re.search(r"\w", cell) for cell in row)), *whole]
    path.write_text("\n".join(",".join(row) for row in [["a", "b", "c"], *table]) + "\n")
    expected = [[_number(cell) for cell in row] for row in table]
    lengths = [len(",".join(row).replace('"', "").split(",")) for row in table]
    bad = [line for line, row in enumerate(expected, start=2) if None in row or lengths[line - 2] != 3]
    if not bad:
        np.testing.assert_array_equal(_columns(path, ["a", "b", "c"]), np.array(expected))
        return
    with pytest.raises(CurveError, match=rf"line {bad[0]}\b|has \d cells where|quotation marks|tables: "):
        _columns(path, ["a", "b", "c"])


# ------------------------------------------------------------------------ units


@given(unit=st.sampled_from(sorted(UNITS)), label=st.sampled_from(["fx", "pos_y", "Kraft 1"]))
def test_a_unit_is_found_however_it_is_written_behind_a_name(unit: str, label: str) -> None:
    for written in (f"{label} [{unit}]", f"{label}({unit})", f"{label} ({unit})"):
        assert unit_in(written) == (label, unit)
    if "_" not in unit and " " not in unit:
        assert unit_in(f"{label}_{unit}")[1].endswith(unit)


@pytest.mark.parametrize(
    ("name", "unit"),
    [("Force_test_N", "N"), ("load sample N", "N"), ("sampleN", ""), ("gel_test_N", ""), ("ft.m", "")],
)
def test_a_letter_behind_a_specimen_is_its_number_but_behind_a_force_a_unit(name: str, unit: str) -> None:
    assert unit_in(name)[1] == unit


G = 9.80665


@pytest.mark.parametrize("unit", sorted(UNITS))
def test_every_unit_that_is_believed_is_known(unit: str) -> None:
    kind = kind_of(unit)
    assert kind is not None or unit in ("counts", "cts", "mV/V")  # which are asked about
    if kind not in (None, "other"):
        factor = factor_to_base(unit, kind, "here")
        for spelt in (f"({unit})", f"[ {unit} ]"):
            assert factor_to_base(bare_unit(spelt), kind, "here") == factor


@pytest.mark.parametrize(
    ("unit", "kind", "factor"),
    [
        *(
            ("lb", "force", 0.45359237 * G),
            ("lbs", "force", 0.45359237 * G),
            ("lbf", "force", 0.45359237 * G),
        ),
        *(("kg", "force", G), ("g", "force", 1e-3 * G), ("gf", "force", 1e-3 * G), ("kp", "force", G)),
        *(("µN", "force", 1e-6), ("μN", "force", 1e-6), ("nN", "force", 1e-9), ("KN", "force", 1e3)),
        *(("min", "time", 60.0), ("h", "time", 3600.0), ("nm", "length", 1e-6), ("ft", "length", 304.8)),
        *(("lbf-in", "moment", 0.45359237 * G * 25.4), ("in·lb", "moment", 0.45359237 * G * 25.4)),
        *(("ozf·in", "moment", 0.45359237 / 16 * G * 25.4), ("kg·cm", "moment", 10.0 * G)),
        *(("N_m", "moment", 1e3), ("mN·m", "moment", 1.0), ("kNm", "moment", 1e6), ("Ncm", "moment", 10.0)),
        *(("%", "ratio", 0.01), ("mm/mm", "ratio", 1.0), ("N/mm²", "stress", 1.0), ("kPa", "stress", 1e-3)),
        *(("kgf/cm2", "stress", 1e-2 * G), ("°", "angle", math.pi / 180.0), ("mrad", "angle", 1e-3)),
        *(("mils", "length", 0.0254), ("ozF", "force", 0.45359237 * G / 16.0)),
        *(("0.001mm", "length", 1e-3), ("1/10 N", "force", 0.1), ("10^-3 in", "length", 0.0254)),
    ],
)
def test_units_have_the_factors_of_their_definitions(unit: str, kind: Kind, factor: float) -> None:
    assert factor_to_base(unit, kind, "here") == pytest.approx(factor, rel=1e-13)


@pytest.mark.parametrize("unit", ["counts", "raw", "100 N", "0.1 N", "a.u.", "bit/s?", "xyz", "gr", "px"])
def test_a_word_that_is_no_unit_stays_unknown(unit: str) -> None:
    assert kind_of(unit) is None
    with pytest.raises(CurveError, match="is not known"):
        factor_to_base(unit, "force", "here")


@pytest.mark.parametrize("unit", ["V", "°C", "mm/min", "A"])
def test_a_unit_of_another_kind_is_known_and_refused(unit: str) -> None:
    assert kind_of(unit) == "other"
    with pytest.raises(CurveError, match="a unit of another kind where one of force is needed"):
        factor_to_base(unit, "force", "here")


# ------------------------------------------------------------------------ turns


@given(seed=st.integers(0, 2**32 - 1), sequence=st.sampled_from(["xyz", "zyx", "XYZ", "ZYX", "ZYZ"]))
def test_angles_about_any_axes_are_single_turns_in_their_order(seed: int, sequence: str) -> None:
    angles = np.random.default_rng(seed).uniform(-3.0, 3.0, (9, 3))
    first, second, third = (
        Rotation.from_rotvec(angles[:, [k]] * np.eye(3)["xyz".index(axis)])
        for k, axis in enumerate(sequence.lower())
    )
    expected = third * second * first if sequence.islower() else first * second * third
    overlap = np.einsum("ij,ij->i", quaternions("euler", angles, sequence), expected.as_quat())
    np.testing.assert_allclose(np.abs(overlap), 1.0, atol=1e-12)


# --------------------------------------------------------------------- mutations

SEEDS: dict[str, tuple[str, Callable[[Path, write.Table], None]]] = {
    "text": ("log.csv", write.write_text),
    "parquet": ("log.parquet", write.write_parquet),
    "npz": ("log.npz", write.write_npz),
    "npy": ("log.npy", write.write_npy),
    "matlab5": ("log.mat", write.write_matlab5),
    "matlab73": ("log.mat", write.write_matlab73),
    "bag1": ("log.bag", lambda path, table: write.write_bag1(path, table, compression="LZ4")),
    "bag2_sqlite": ("log", write.write_bag2),
    "bag2_mcap": ("log", lambda path, table: write.write_bag2(path, table, storage="MCAP")),
}


def _files(path: Path) -> list[Path]:
    return sorted(path.iterdir()) if path.is_dir() else [path]


def _mutate(content: bytes, rng: np.random.Generator) -> bytes:
    """Flip, set, cut out, double or cut off some bytes."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 6))):
        at = int(rng.integers(0, max(1, len(data)))) if rng.random() < 0.7 else int(rng.integers(0, 200))
        length = int(rng.integers(1, 40))
        match int(rng.integers(0, 5)):
            case 0 if at < len(data):
                data[at] ^= 1 << int(rng.integers(0, 8))
            case 1:
                data[at : at + length] = bytes([int(rng.choice([0, 255, 128, 10, 34]))]) * length
            case 2:
                del data[at : at + length]
            case 3:
                data[at:at] = data[at : at + length]
            case _ if rng.random() < 0.3:
                del data[at:]
    return bytes(data)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", SEEDS)
def test_damaged_bytes_give_a_log_or_a_curve_error(tmp_path: Path, kind: str) -> None:
    """For any bytes a reader raises no other error, and its results are well formed."""
    name, writer = SEEDS[kind]
    whole = tmp_path / "whole"
    whole.mkdir()
    writer(whole / name, write.press(60))
    rng = np.random.default_rng(20)
    n_refused = 0
    for trial in range(60):
        place = tmp_path / f"{trial}"
        shutil.copytree(whole, place)
        files = _files(place / name)
        victim = files[int(rng.integers(0, len(files)))]
        victim.write_bytes(_mutate(victim.read_bytes(), rng))
        n_refused += _is_refused(place / name)
        shutil.rmtree(place)
    assert n_refused > 0


def _is_refused(path: Path) -> bool:
    try:
        log = read_here(path)
    except CurveError as error:
        message = str(error)
    else:
        _check_well_formed(log)
        return False
    assert str(path) in message
    return True


def _check_well_formed(log: RawLog) -> None:
    assert log.streams
    for stream in log.streams:
        for column in stream.columns.values():
            assert column.values.shape == stream.rows.shape
            assert column.values.dtype == np.float64
    propose(log)  # no numbers raise an error


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=400), ending=st.sampled_from([".csv", ".mat", ".bag", ".npz", ".db3", ""]))
def test_any_bytes_are_a_log_or_a_curve_error(tmp_path: Path, content: bytes, ending: str) -> None:
    path = tmp_path / f"any{ending}"
    path.write_bytes(content)
    _is_refused(path)
