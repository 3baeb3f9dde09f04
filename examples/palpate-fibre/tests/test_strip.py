"""The contract of a loader over a strip's file."""

import pytest

from palpate.api import CurveError
from palpate.testing import Expected, LoaderContract
from palpate_fibre import Strip

GOOD = """\
machine: any
gauge_length_mm: 20
area_mm2: 10
0 0
1 0.5
4 3
0 0.25
"""


class TestStrip(LoaderContract):
    channel = "uniaxial"

    @pytest.fixture
    def loader(self):
        return Strip()

    @pytest.fixture
    def good_file(self, tmp_path):
        path = tmp_path / "good.txt"
        path.write_text(GOOD)
        return path

    @pytest.fixture
    def bad_files(self, tmp_path):
        texts = {
            "empty": "",
            "size": GOOD.replace("area_mm2: 10\n", ""),
            "flat": GOOD.replace("area_mm2: 10", "area_mm2: 0"),
            "word": GOOD.replace("0.5", "half"),
            "colon": GOOD.replace("4 3", "4: 3"),
            "late": GOOD + "area_mm2: 20\n",
            "one": GOOD.split("1 0.5")[0],
            "nan": GOOD.replace("4 3", "4 nan"),
        }
        for name, text in texts.items():
            (tmp_path / f"{name}.txt").write_text(text)
        return [tmp_path / f"{name}.txt" for name in texts]

    @pytest.fixture
    def expected(self):
        return {"uniaxial": Expected(abscissa=(1.0, 1.2), ordinate=(0.0, 0.3), n_branches=2)}


def test_the_study_must_name_its_test(tmp_path):
    (tmp_path / "good.txt").write_text(GOOD)
    with pytest.raises(CurveError, match="say which test it is"):
        Strip().load(tmp_path / "good.txt")
