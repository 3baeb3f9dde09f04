"""State of the process that plugins share: restored after each call, and reported by contracts."""

import locale
import os
import random
import signal
import warnings
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

from palpate.cli.doctor_checks import examine
from palpate.plugins.catalogue import Plugins
from palpate.plugins.guard import answering_for
from palpate.plugins.process_state import STATES, restored
from palpate.testing import ComponentContract, bench

from .conftest import Write

CHANGES = {
    "working directory": lambda: os.chdir("/"),
    "locale": lambda: locale.setlocale(locale.LC_ALL, "C.UTF-8" if in_c() else "C"),
    "numpy's error state": lambda: np.seterr(over="raise"),
    "filter of all warnings": lambda: warnings.simplefilter("always"),
    "handler of Ctrl-C": lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    "environment": lambda: os.environ.update(PALPATE_TEST_STATE="1"),
    "state of `random`": lambda: random.seed(3),
    "state of `numpy.random`": lambda: np.random.seed(3),  # noqa: NPY002 -- what it restores
    "matplotlib's style": lambda: mpl.rcParams.update({"font.size": 31.0}),
}


def in_c() -> bool:
    return locale.setlocale(locale.LC_ALL) == "C"


@pytest.mark.parametrize("name", STATES)
def test_a_change_is_named_and_restored(name: str) -> None:
    _, read, _ = STATES[name]
    before = read()
    with restored(STATES) as changed:
        CHANGES[name]()
        assert read() != before
    assert changed == [name]
    assert read() == before


@pytest.mark.parametrize("name", STATES)
def test_a_contract_reports_it(name: str) -> None:
    watch = ComponentContract._leaves_the_process_as_it_was.__wrapped__(ComponentContract())
    next(watch)
    CHANGES[name]()
    with pytest.raises(AssertionError, match=f"it changes the {name}, which all plugins share"):
        next(watch, None)


def test_an_import_and_a_call_leave_the_working_directory(write: Write) -> None:
    here = Path.cwd()
    text = "import os\nimport numpy\nos.chdir('/')\nnumpy.seterr(all='raise')\n"
    with np.errstate(all="ignore"):
        plugins = Plugins.load([write("moves", text)], entry_points=False)
        assert np.geterr()["over"] == "ignore"
    assert Path.cwd() == here
    assert plugins.restored == {"moves": ["working directory", "numpy's error state"]}
    (found,) = (each for each in examine(plugins, here, 0.0) if (each.what, each.level) == ("moves", "note"))
    assert found.found == "changes at import: working directory, numpy's error state"
    with answering_for(bench.HalfSpace(), "moving"):
        os.chdir("/")
    assert Path.cwd() == here


def test_filters_of_single_warnings_stay_and_others_go(monkeypatch: pytest.MonkeyPatch) -> None:
    before = [("error", None, Warning, None, 0), ("ignore", None, ImportWarning, None, 0)]
    monkeypatch.setattr(warnings, "filters", list(before))
    with answering_for(bench.HalfSpace(), "importing"):
        warnings.simplefilter("ignore")
        warnings.filterwarnings("ignore", category=UserWarning, module="one_library")
        warnings.simplefilter("always")
        warnings.simplefilter("error")
    assert [entry[:3:2] for entry in warnings.filters] == [
        ("ignore", UserWarning),
        *(e[:3:2] for e in before),
    ]
    with answering_for(bench.HalfSpace(), "resetting"):
        warnings.resetwarnings()
    assert before[0] in warnings.filters
