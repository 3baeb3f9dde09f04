"""Curves in files of columns have the rules of the same table in text, for names and units too."""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from palpate.domain import FloatArray
from palpate.errors import CurveError
from palpate.plugins.interfaces import ExperimentLoader
from palpate.testing import Expected, LoaderContract
from palpate_indentation import CsvLoader, CsvSettings
from palpate_robot_log import ColumnsLoader, ColumnsSettings
from palpate_robot_log.reading.inspection import inspect_log

from . import log_writers as write

DEPTH_MM = 0.2 * np.arange(41)
FORCE_N = 0.4 * DEPTH_MM**1.5
Columns = Mapping[str, FloatArray]


def write_matlab(path: Path, columns: Columns) -> None:
    """Vectors in the file itself, as ``save`` of MATLAB has them; names have no blanks and brackets there."""
    savemat(path, {name: values[:, None] for name, values in columns.items()})


def write_hdf5(path: Path, columns: Columns) -> None:
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            label, _, unit = name.rpartition("_")
            file[f"test/{label}"] = values
            file[f"test/{label}"].attrs["units"] = unit


WRITERS: Mapping[str, Callable[[Path, Columns], None]] = {
    "vectors.mat": write_matlab,
    "structure.mat": write.write_matlab5,
    "structure_of_7.3.mat": write.write_matlab73,
    "press.npz": write.write_npz,
    "press.parquet": write.write_parquet,
    "press.h5": write_hdf5,
}


def proposed(path: Path) -> tuple[ExperimentLoader, str]:
    """Loader that the proposal of a file names, with its settings, and the problem of reading the file so."""
    found = inspect_log(path)
    table = tomllib.loads(found.study_text)["experiment"]
    kinds = {"csv": (CsvLoader, CsvSettings), "columns": (ColumnsLoader, ColumnsSettings)}
    loader, settings = kinds[table["loader"]]
    return loader(settings.model_validate(table.get("settings", {}))), found.record["problem"]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "writer"), WRITERS.items(), ids=WRITERS)
def test_a_press_is_read_at_the_first_try(
    tmp_path: Path, name: str, writer: Callable[[Path, Columns], None]
) -> None:
    path = tmp_path / name
    writer(path, {"depth_m": 1e-3 * DEPTH_MM, "force_kgf": FORCE_N / 9.80665})
    loader, problem = proposed(path)
    assert (loader.name, problem) == ("columns", "")
    curve = loader.load(path, "force")["force"]
    np.testing.assert_allclose(curve.abscissa, DEPTH_MM, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(curve.ordinate, FORCE_N, rtol=1e-12, atol=1e-12)


def test_a_homogeneous_test_has_the_rules_of_text(tmp_path: Path) -> None:
    strain = np.linspace(0.0, 0.3, 31)
    columns = {"true_strain": strain, "true_stress_kPa": 60.0 * strain}
    write_matlab(tmp_path / "pull.mat", columns)
    lines = [",".join(columns), *(f"{a!r},{b!r}" for a, b in np.column_stack([*columns.values()]).tolist())]
    (tmp_path / "pull.csv").write_text("\n".join(lines) + "\n")
    curves = [proposed(tmp_path / f"pull{kind}")[0].load(tmp_path / f"pull{kind}", "uniaxial")["uniaxial"]
              for kind in (".mat", ".csv")]  # fmt: skip
    np.testing.assert_allclose(curves[0].abscissa, np.exp(strain), rtol=1e-12)
    np.testing.assert_array_equal(curves[0].ordinate, curves[1].ordinate)


def test_a_unit_that_is_not_known_is_a_question(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["depth_mm"], file["force"] = DEPTH_MM, FORCE_N
        file["force"].attrs["units"] = "counts"
    assert "the file gives 'counts', which is no unit of force" in inspect_log(tmp_path / "a.h5").study_text
    columns = {"force": {"abscissa": "depth_mm", "ordinate": "force"}}
    loader = ColumnsLoader(ColumnsSettings.model_validate({"channels": columns}))
    with pytest.raises(CurveError, match="the file gives the unit 'counts', which is not known; give scale"):
        loader.load(tmp_path / "a.h5")


def test_channels_of_two_lengths_are_in_one_file(tmp_path: Path) -> None:
    angle = np.linspace(-20.0, 20.0, 17)
    write_matlab(tmp_path / "a.mat", {"depth_mm": DEPTH_MM, "force_N": FORCE_N})
    both = {"depth_mm": DEPTH_MM, "force_N": FORCE_N, "angle_deg": angle, "torque_Nmm": 1.2 * angle}
    write_matlab(tmp_path / "a.mat", both)
    found = ColumnsLoader().load(tmp_path / "a.mat")
    assert (found["force"].abscissa.size, found["torque"].abscissa.size) == (41, 17)
    mixed = ColumnsSettings.model_validate(
        {"channels": {"force": {"abscissa": "depth_mm", "ordinate": "torque_Nmm"}}}
    )
    with pytest.raises(
        CurveError, match=r"depth_mm, torque_Nmm are in different streams \(41 rows, 17 rows\)"
    ):
        ColumnsLoader(mixed).load(tmp_path / "a.mat")


def test_a_row_without_a_number_is_named(tmp_path: Path) -> None:
    force = FORCE_N.copy()
    force[7] = np.nan
    write_matlab(tmp_path / "a.mat", {"depth_mm": DEPTH_MM, "force_N": force})
    with pytest.raises(CurveError, match="row 7, column 'force_N': no number"):
        ColumnsLoader().load(tmp_path / "a.mat", "force")


def test_text_is_left_to_its_own_loader(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("depth_mm,force_N\n0,0\n1,2\n")
    with pytest.raises(CurveError, match='is delimited text; set loader = "csv"'):
        ColumnsLoader().load(tmp_path / "a.csv", "force")


@pytest.mark.slow
def test_init_writes_a_study_that_reads_the_file(call, tmp_path):
    strain = np.linspace(0.0, 0.3, 31)
    write_matlab(tmp_path / "pull.mat", {"strain": strain, "stress_kPa": 60.0 * strain})
    assert call("init", "rubber", "--measured", "pull.mat", plugin=None).code == 0
    done = call("experiment", "rubber", "--json", plugin=None)
    assert done.code == 0, done.err
    assert done.json[0]["largest"] == pytest.approx(0.018)


@pytest.mark.slow
class TestColumns(LoaderContract):
    channel = "force"

    @pytest.fixture
    def loader(self) -> ExperimentLoader:
        return ColumnsLoader()

    @pytest.fixture
    def good_file(self, tmp_path: Path) -> Path:
        write_matlab(tmp_path / "a.mat", {"depth_mm": DEPTH_MM, "force_N": FORCE_N})
        return tmp_path / "a.mat"

    @pytest.fixture
    def expected(self) -> Mapping[str, Expected]:
        return {"force": Expected(abscissa=(0.0, 8.0), ordinate=(0.0, 9.0509668))}

    @pytest.fixture
    def bad_files(self, tmp_path: Path) -> Sequence[Path]:
        (tmp_path / "empty.mat").write_bytes(b"")
        write_matlab(tmp_path / "lacking.mat", {"depth_mm": DEPTH_MM})
        write_matlab(tmp_path / "still.mat", {"depth_mm": 0.0 * DEPTH_MM, "force_N": FORCE_N})
        return [tmp_path / name for name in ("empty.mat", "lacking.mat", "still.mat")]


def test_a_file_without_numbers_says_so_once(tmp_path: Path) -> None:
    savemat(tmp_path / "words.mat", {"note": "a press", "image": np.zeros((2, 3, 4))})
    with pytest.raises(CurveError) as caught:
        inspect_log(tmp_path / "words.mat")
    assert str(caught.value).count("no columns of numbers") == 1
    assert "'image' (2, 3, 4) of float64" in str(caught.value)
