"""The CSV loader keeps the loaders' contract, and the contract catches one that does not."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from palpate.domain import Response
from palpate.interfaces import ExperimentLoader
from palpate.testing import LoaderContract
from palpate_experiments import CsvLoader

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


class Rounded(CsvLoader):
    """Writes fewer digits than it read."""

    def save(self, path: Path, response: Response, channel: str | None = None) -> None:
        super().save(path, response, channel)
        path.write_text(path.read_text().replace("0.5", "0.4"))


def test_the_contract_catches_a_loader_that_writes_something_else(tmp_path: Path) -> None:
    (tmp_path / "good.csv").write_text(GOOD)
    with pytest.raises(AssertionError):
        TestCsv().test_reads_back_what_it_writes(Rounded(), tmp_path / "good.csv")
