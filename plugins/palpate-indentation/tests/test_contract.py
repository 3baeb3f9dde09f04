"""The CSV loader keeps the loaders' contract, and the contract catches one that does not."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from palpate.domain import Response
from palpate.plugins.interfaces import ExperimentLoader
from palpate.testing import Expected, LoaderContract
from palpate_indentation import CsvLoader, CsvSettings

GOOD = "depth_mm,angle_deg,force_N,torque_Nmm\n0,0,0,0\n5,0,2,0\n10,0,7,0.5\n10,-9,6,-3\n10,9,6,3\n"


class TestCsv(LoaderContract):
    @pytest.fixture
    def loader(self) -> ExperimentLoader:
        return CsvLoader()

    @pytest.fixture
    def good_file(self, tmp_path: Path) -> Path:
        path = tmp_path / "good.csv"
        path.write_text(GOOD)
        return path

    @pytest.fixture
    def bad_files(self, tmp_path: Path) -> Sequence[Path]:
        texts = {"empty": "", "text": GOOD.replace("10,0", "ten,0"), "short": GOOD[:50]}
        for name, text in texts.items():
            (tmp_path / f"{name}.csv").write_text(text)
        return [tmp_path / f"{name}.csv" for name in texts]

    @pytest.fixture
    def expected(self) -> Mapping[str, Expected]:
        return {
            "force": Expected(abscissa=(0.0, 10.0), ordinate=(0.0, 7.0)),
            "torque": Expected(abscissa=(-9.0, 9.0), ordinate=(-3.0, 3.0), n_branches=2),
        }


class Rounded(CsvLoader):
    """Writes fewer digits than it read."""

    def save(self, path: Path, response: Response, channel: str | None = None) -> None:
        super().save(path, response, channel)
        path.write_text(path.read_text().replace("0.5", "0.4"))


class TestCsvWithStd(TestCsv):
    @pytest.fixture
    def loader(self) -> ExperimentLoader:
        force = {"abscissa": "depth_mm", "ordinate": "force_N", "std": "std_N"}
        return CsvLoader(CsvSettings.model_validate({"channels": {"force": force}}))

    @pytest.fixture
    def good_file(self, tmp_path: Path) -> Path:
        path = tmp_path / "good.csv"
        path.write_text(GOOD.replace("-3", "3").replace("torque_Nmm", "std_N"))
        return path

    @pytest.fixture
    def expected(self) -> Mapping[str, Expected]:
        return {"force": Expected(abscissa=(0.0, 10.0), ordinate=(0.0, 7.0))}


class Telling(CsvLoader):
    """Records what JSON does not hold, and draws outside its folder."""

    def load(self, path: Path, channel: str | None = None) -> Response:
        if not path.read_bytes().isascii():
            raise KeyError(path)
        return Response(curves=super().load(path, channel).curves, record={"bias": np.float32(1.0)})

    def draw(self, path: Path, folder: Path, channel: str | None = None) -> tuple[Path, ...]:
        (folder.parent / "here.png").touch()
        return (folder.parent / "here.png",)


@pytest.mark.parametrize(
    ("test", "caught"),
    [
        ("test_its_record_is_plain", TypeError),
        ("test_draws_in_the_given_folder", AssertionError),
        ("test_a_corrupt_file_is_refused_or_read_but_never_falls_over", pytest.fail.Exception),
    ],
)
def test_the_contract_catches_a_loader_without_manners(
    tmp_path: Path, test: str, caught: type[BaseException]
) -> None:
    (tmp_path / "good.csv").write_text(GOOD)
    extra = () if "plain" in test else (tmp_path,)
    with pytest.raises(caught):
        getattr(TestCsv(), test)(Telling(), tmp_path / "good.csv", *extra)


def test_the_contract_catches_a_loader_that_writes_something_else(tmp_path: Path) -> None:
    (tmp_path / "good.csv").write_text(GOOD)
    with pytest.raises(AssertionError):
        TestCsv().test_reads_back_what_it_writes(Rounded(), tmp_path / "good.csv")
