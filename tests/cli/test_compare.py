"""``palpate compare``: runs side by side, as tables and as a page."""

import shutil
from pathlib import Path

import pytest

from .test_json_output import valid

pytestmark = pytest.mark.usefixtures("one_figure")


@pytest.fixture
def undrawn(monkeypatch):
    """A figure without the cost of drawing it."""

    def save(figure, stem):
        files = [stem.with_suffix(suffix) for suffix in (".svg", ".pdf", ".png")]
        for file in files:
            file.write_text("<svg></svg>")
        return files

    monkeypatch.setattr("palpate_report.figures.drawings.save", save)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_two_runs_are_compared_without_their_study(call, study, ran):
    names = ("runs/first", "runs/second")
    for name in names:
        shutil.copytree(ran, name)
    (study / "s1.txt").unlink()
    outcome = call("compare", *names, "--into", "both")
    assert outcome.code == 0, outcome.err
    for word in ("Parameters", "Errors", "first", "second", Path("both/index.html").resolve().as_uri()):
        assert word in outcome.out
    found = valid("compare", call("compare", *names, "--into", "both", "--json").json)
    assert [row["run"] for row in found["tables"]["parameters"]] == ["first", "second"]
    assert all(Path(file).is_file() for file in found["files"])


def test_one_run_is_nothing_to_compare(call, ran):
    outcome = call("compare", ran, ran)
    assert outcome.code == 2
    assert "name two or more" in outcome.err
    assert not Path("comparison").exists()
