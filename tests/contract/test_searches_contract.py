"""The searches of the core keep the contract of searches."""

import contextlib
import re
import threading
from pathlib import Path

import numpy as np
import pytest

from palpate.fit.least_squares import LeastSquares
from palpate.fit.searches import BestSet, DifferentialEvolution
from palpate.plugins.registry import load_file
from palpate.plugins.search import Evaluation, asking
from palpate.testing.fits import SearchContract

GUIDE = Path(__file__).parents[2] / "docs" / "plugins-fit.md"
IMPORTS = """
import numpy as np
from palpate.api.fit import Search
from palpate.testing import Rehearsal
"""


class TestLeastSquares(SearchContract):
    @pytest.fixture
    def search(self):
        return LeastSquares()


class TestDE(SearchContract):
    @pytest.fixture
    def search(self):
        return DifferentialEvolution()


class TestNelderMead(SearchContract):
    """The optimiser with a callback of docs/plugins-fit.md."""

    @pytest.fixture
    def search(self, tmp_path):
        blocks = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), flags=re.DOTALL)
        (code,) = [block for block in blocks if "class NelderMead" in block]
        file = tmp_path / "nelder_mead.py"
        file.write_text(f"{IMPORTS}\n{code}")
        return load_file(file).NelderMead()


def test_an_abandoned_optimiser_ends_even_if_it_goes_on_asking(until):
    started, ended = threading.Event(), threading.Event()

    def optimise(evaluate):
        started.set()
        try:
            for _ in range(3):
                with contextlib.suppress(BaseException):
                    evaluate(np.zeros(3))
        finally:
            ended.set()

    generator = asking(optimise)
    next(generator)
    assert started.is_set()
    assert not ended.is_set()
    generator.close()
    until(ended.is_set)


def test_what_an_optimiser_raises_ends_the_search():
    def optimise(evaluate):
        raise ZeroDivisionError(evaluate(np.zeros(3)).objective)

    generator = asking(optimise)
    (trial,) = next(generator)
    with pytest.raises(ZeroDivisionError, match=r"0\.5"):
        generator.send([Evaluation(point=trial.point, objective=0.5, fopt=0.5)])


class TestBestSet(SearchContract):
    @pytest.fixture
    def search(self):
        return BestSet()

    @pytest.fixture
    def left(self):
        return 1.0
