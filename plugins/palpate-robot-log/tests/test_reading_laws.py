"""Laws of reading: fast is slow, forms of a turn agree, and no bytes lead a reader astray."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pint
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from scipy.spatial.transform import Rotation

from palpate.domain import FloatArray
from palpate.errors import CurveError
from palpate.experiment.delimited import (
    BASE_UNITS,
    UNITS,
    TextTable,
    factor_to_base,
    table as text_reader,
    unit_in,
)
from palpate_robot_log.reading.assembly import quaternions
from palpate_robot_log.reading.formats import Request, read_here
from palpate_robot_log.reading.proposal import propose
from palpate_robot_log.reading.raw import RawLog

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


@given(rows=st.lists(st.lists(cells, min_size=3, max_size=3), min_size=6, max_size=8))
def test_the_fast_reader_never_differs_from_the_slow_one(
    tmp_path_factory: pytest.TempPathFactory, rows: list[list[str]]
) -> None:
    path = tmp_path_factory.mktemp("text") / "t.csv"
    head = [["0.5", "1.5", "2.5"]] * 8
    path.write_text("\n".join(",".join(row) for row in [["a", "b", "c"], *head, *rows]) + "\n")

    def outcome() -> str | FloatArray:
        try:
            return _columns(path, ["a", "b", "c"])
        except CurveError as error:
            return str(error)

    fast = outcome()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(text_reader, "_fast", lambda *_: None)
        slow = outcome()
    if isinstance(slow, str) or isinstance(fast, str):
        assert fast == slow
    else:
        np.testing.assert_array_equal(fast, slow)


# ------------------------------------------------------------------------ units


@given(unit=st.sampled_from(sorted(UNITS)), label=st.sampled_from(["fx", "pos_y", "Kraft 1"]))
def test_a_unit_is_found_however_it_is_written_behind_a_name(unit: str, label: str) -> None:
    for written in (f"{label} [{unit}]", f"{label}({unit})", f"{label} ({unit})"):
        assert unit_in(written) == (label, unit)
    if "_" not in unit and " " not in unit:
        assert unit_in(f"{label}_{unit}")[1].endswith(unit)


REGISTRY = pint.UnitRegistry()


@pytest.mark.parametrize("unit", sorted(UNITS))
def test_factors_are_those_of_pint(unit: str) -> None:
    spelt = {"Nm": "N*m", "Nmm": "N*mm", "mNm": "mN*m", "Ncm": "N*cm", "kp": "kgf", "gf": "gram_force"}
    kind, factor = UNITS[unit]
    text = spelt.get(unit, unit.replace("·", "*").replace("_", "*").replace("-", "*"))
    if "." in text or " " in text:
        text = text.replace(".", "*").replace(" ", "*")
    text = {"sec": "s", "secs": "s", "msec": "ms", "usec": "us", "nsec": "ns"}.get(text, text)
    expected = REGISTRY.Quantity(1.0, text).to(BASE_UNITS[kind].replace("·", "*")).magnitude
    assert factor == pytest.approx(expected, rel=1e-12)
    assert factor_to_base(unit, kind, "here") == factor


# ------------------------------------------------------------------------ turns

turns = st.integers(0, 2**32 - 1).map(lambda seed: Rotation.random(9, rng=np.random.default_rng(seed)))


@given(turn=turns, sequence=st.sampled_from(["xyz", "zyx", "XYZ", "ZYX", "ZYZ"]))
def test_every_form_of_a_turn_gives_the_same_quaternion(turn: Rotation, sequence: str) -> None:
    q = turn.as_quat()
    forms = {
        "quaternion": 1.005 * q,
        "euler": turn.as_euler(sequence),
        "axis_angle": turn.as_rotvec(),
        "rotation_matrix": turn.as_matrix().reshape(-1, 9),
    }
    for form, values in forms.items():
        found = quaternions(form, values, sequence)
        np.testing.assert_allclose(np.abs(np.einsum("ij,ij->i", found, q)), 1.0, atol=1e-12)


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
        log = read_here(path, Request())
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
