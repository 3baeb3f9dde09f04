"""The laws that every executor holds to."""

import pytest

from palpate.testing import ExecutorContract
from palpate_dask.executor import DaskExecutor


@pytest.mark.slow
class TestDask(ExecutorContract):
    n_sets = 4

    @pytest.fixture
    def executor(self):
        return DaskExecutor()
