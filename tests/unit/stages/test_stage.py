"""Stages of plugins: the example of one file, and what goes wrong with others."""

import json
from pathlib import Path
from types import SimpleNamespace

import polars as pl
import pytest

from palpate.errors import PluginError, StudyError
from palpate.fit.least_squares import LeastSquares
from palpate.plugins.registry import load_file
from palpate.plugins.table import StageTable, TableColumn
from palpate.run.directory import RunDirectory
from palpate.stages import pipeline
from palpate.stages.order import in_order
from palpate.stages.stage import Run, Stage, read_run
from palpate.testing import StageContract

LOOP = Path(__file__).parents[3] / "examples" / "loop_work.py"


class TestLoopWork(StageContract):
    @pytest.fixture
    def stage(self):
        return load_file(LOOP).LoopWork()


NUMBER = StageTable("One number.", {"number": TableColumn("It.", unit="mm")})


class Table(Stage):
    name, summary, tables = "table", "one table", {"table": NUMBER}

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
    directory = SimpleNamespace(folder=tmp_path, write_stage=lambda *given: pytest.fail("written"))
    with pytest.raises(PluginError, match=message):
        Run(study=make_study(), directory=directory).make(Table())


def test_a_run_goes_on_without_a_stage_that_fails(
    make_study, plugins, tmp_path, monkeypatch, notes, one_figure
):
    class Failing(Table):
        def run(self, inputs, progress):
            raise StudyError("no such curve")

    study = make_study(stages=(Failing(),))
    monkeypatch.setattr(plugins.stages, "_entries", {**plugins.stages._entries, "table": (Failing, "test")})
    result = pipeline.run_study(study, tmp_path / "run", plugins, notes)
    assert result.selected.selection.height
    assert "warning: no results of `palpate table`: no such curve" in notes.texts
    assert "table" not in json.loads((tmp_path / "run" / "stages.json").read_text())


def test_every_stage_makes_the_columns_that_it_declares(make_study, plugins, tmp_path, one_figure):
    study = make_study(n_sets=12, search=LeastSquares())
    pipeline.run_study(study, tmp_path / "run", plugins)
    run = read_run(study, RunDirectory(tmp_path / "run"), plugins)
    declared = {name: table for stage in run.stages.values() for name, table in stage.tables.items()}
    made = {name: run.directory.table(name) for name in declared}
    assert {"scores", "fit", "intervals", "budget", "identifiability", "answer"} <= {
        name for name, frame in made.items() if frame.width
    }
    assert {name: lacking for name in made if (lacking := declared[name].missing(made[name]))} == {}
    for name, frame in made.items():
        kinds = {column: frame.schema[column] for column in declared[name].columns if frame.height}
        assert kinds == {column: declared[name].schema[column] for column in kinds}, name


def test_a_table_that_is_not_there_has_its_columns(make_study, plugins, tmp_path):
    run = read_run(make_study(), RunDirectory(tmp_path / "run"), plugins)
    assert run.table("budget").columns == [*run.stages["intervals"].tables["budget"].columns]
    assert run.current("budget").filter(cause="mesh").is_empty()
    assert run.table("no_table").width == 0


def test_a_table_that_is_declared_by_text_is_refused():
    with pytest.raises(TypeError, match=r"class Bare: table 'table' is no palpate\.api\.StageTable"):
        type("Bare", (Table,), {"tables": {"table": "One number."}})


def test_rows_have_every_declared_column_and_its_type():
    assert NUMBER.frame([]).schema == {"number": pl.Float64}
    rows = NUMBER.frame([{"spot": "p1"}, {"spot": "p2", "more": 1}])
    assert rows.to_dicts() == [
        {"spot": "p1", "more": None, "number": None},
        {"spot": "p2", "more": 1, "number": None},
    ]
    assert NUMBER.missing(pl.DataFrame({"other": [1]})) == ["number"]
    assert NUMBER.missing(pl.DataFrame()) == []
    assert str(NUMBER.columns["number"]) == "It. [mm]"


def test_a_stage_asks_for_the_fit_again_until_its_inputs_are_good_enough(
    make_study, plugins, tmp_path, monkeypatch, one_figure
):
    asked = []

    class Twice(Table):
        needs, of_every_run = ("fit",), True

        def again(self, inputs):
            asked.append(inputs.inputs)
            return inputs.inputs if len(asked) < 3 else None

    monkeypatch.setattr(plugins.stages, "_entries", {**plugins.stages._entries, "table": (Twice, "test")})
    made, make = [], Run.make

    def counted(run, stage, *given):
        made.append(stage.name)
        make(run, stage, *given)

    monkeypatch.setattr(Run, "make", counted)
    pipeline.run_study(make_study(), tmp_path / "run", plugins)
    assert (len(asked), made.count("fit"), made.count("table")) == (3, 3, 3)
