"""Stages of plugins: the example of one file, and what goes wrong with others."""

import json
from pathlib import Path
from types import SimpleNamespace

import polars as pl
import pytest

from palpate.errors import PluginError, StudyError
from palpate.plugins.registry import load_file
from palpate.progress import SILENT
from palpate.stages import pipeline
from palpate.stages.stage import Run, Stage, in_order
from palpate.testing import StageContract

LOOP = Path(__file__).parents[3] / "examples" / "loop_work.py"


class TestLoopWork(StageContract):
    @pytest.fixture
    def stage(self):
        return load_file(LOOP).LoopWork()


class Table(Stage):
    name, summary, tables = "table", "one table", {"table": "One number."}

    def run(self, inputs, progress):
        return {"table": pl.DataFrame({"number": [1.0]})}


def stages(**needs):
    return {name: SimpleNamespace(name=name, needs=given) for name, given in needs.items()}


def test_each_stage_follows_those_that_it_needs():
    found = in_order(stages(c=("b", "a"), b=("a",), a=()), ["c", "a"])
    assert [each.name for each in found] == ["a", "b", "c"]


@pytest.mark.parametrize(
    ("needs", "message"),
    [
        ({"a": ("b",), "b": ("a",)}, "need each other: a → b → a"),
        ({"a": ("fitt",), "fit": ()}, "no stage 'fitt' that 'a' needs; did you mean 'fit'"),
    ],
)
def test_stages_that_cannot_be_ordered_are_refused(needs, message):
    with pytest.raises(PluginError, match=message):
        in_order(stages(**needs), ["a"])


@pytest.mark.parametrize(
    ("found", "message"),
    [
        ({"other": pl.DataFrame()}, "table 'other', which it does not declare"),
        ({"table": [1.0]}, "gave list as table 'table'"),
    ],
)
def test_what_is_no_table_is_refused(found, message, make_study, plugins, tmp_path, monkeypatch):
    monkeypatch.setattr(Table, "run", lambda self, inputs, progress: found)
    directory = SimpleNamespace(write_stage=lambda *given: pytest.fail("written"))
    with pytest.raises(PluginError, match=message):
        Run(study=make_study(), directory=directory).make(Table())


def test_a_run_goes_on_without_a_stage_that_fails(make_study, plugins, tmp_path, monkeypatch, one_figure):
    class Failing(Table):
        def run(self, inputs, progress):
            raise StudyError("no such curve")

    notes = []
    progress = SimpleNamespace(
        **{name: getattr(SILENT, name) for name in ("begin", "step", "should_continue")}
    )
    progress.note = notes.append
    study = make_study(stages=(Failing(),))
    monkeypatch.setattr(plugins.stages, "_entries", {**plugins.stages._entries, "table": (Failing, "test")})
    result = pipeline.run_study(study, tmp_path / "run", plugins, progress)
    assert result.selected.selection.height
    assert "warning: no results of `palpate table`: no such curve" in notes
    assert "table" not in json.loads((tmp_path / "run" / "stages.json").read_text())
