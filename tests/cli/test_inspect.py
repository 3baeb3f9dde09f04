"""``palpate experiment inspect`` calls the loaders that can inspect, unlike ``palpate experiment``."""

from pathlib import Path

import pytest

from .conftest import PLUGIN, Call

LOADERS = '''
"""Two loaders that inspect and one that does not."""

from palpate import hookimpl
from palpate.errors import CurveError
from palpate.plugins.optional import InspectedTable, Inspection
from palpate.plugins.interfaces import ExperimentLoader


class Plain(ExperimentLoader):
    name = "plain"
    summary = "inspects nothing"

    def load(self, path, channel=None):
        raise CurveError(f"{path}: never read")


class Picky(Plain):
    name = "picky"

    @classmethod
    def inspect(cls, path):
        if path.name == "bug.log":
            raise ZeroDivisionError("by zero")
        if path.name != "picky.log":
            raise CurveError(f"{path}: is not picky; rename it")
        return Inspection(record={"by": "picky"})


class Wide(Plain):
    name = "wide"

    @classmethod
    def inspect(cls, path):
        if path.name == "none.log":
            raise CurveError(f"{path}: is empty; record again")
        table = InspectedTable(title="Columns of it", columns=("column", "unit"), rows=(("fx [raw]", "N"),))
        return Inspection(
            tables=(table,),
            findings=("a gap of [2] s",),
            study_text="[experiment]\\nloader = \\"wide\\"\\n",
            record={"by": "wide"},
        )


@hookimpl
def palpate_experiment_loaders():
    return [Plain, Picky, Wide]
'''


@pytest.fixture
def plugin(tmp_path: Path) -> str:
    path = tmp_path / "loaders_that_inspect.py"
    path.write_text(LOADERS)
    return str(path)


def test_a_person_sees_tables_findings_and_what_to_put_into_a_study(call: Call, plugin: str) -> None:
    outcome = call("experiment", "inspect", "some.log", "--loader", "wide", plugin=plugin)
    assert outcome.code == 0
    for text in ("Columns of it", "fx [raw]", "- a gap of [2] s", '[experiment]\nloader = "wide"'):
        assert text in outcome.out
    assert "next: palpate" in outcome.err


def test_a_script_gets_the_record_of_the_first_loader_that_can(call: Call, plugin: str) -> None:
    assert call("experiment", "inspect", "picky.log", "--json", plugin=plugin).json == {"by": "picky"}
    wide = call("experiment", "inspect", "some.log", "--json", "--loader", "wide", plugin=plugin)
    assert wide.json == {"by": "wide"}


def test_each_loaders_message_is_reported_when_none_can_read_the_file(call: Call, plugin: str) -> None:
    outcome = call("experiment", "inspect", "none.log", plugin=plugin)
    assert outcome.code == 2
    assert "picky: none.log: is not picky; rename it" in outcome.err
    assert "wide: none.log: is empty" in outcome.err


def test_a_loader_that_breaks_is_named(call: Call, plugin: str) -> None:
    outcome = call("experiment", "inspect", "bug.log", plugin=plugin)
    assert outcome.code == 2
    assert "inspecting bug.log: 'picky'" in outcome.err
    assert "raised ZeroDivisionError: by zero" in outcome.err


def test_a_loader_that_cannot_inspect_is_reported(call: Call, plugin: str) -> None:
    outcome = call("experiment", "inspect", "some.log", "--loader", "plain", plugin=plugin)
    assert outcome.code == 2
    assert "loader 'plain' cannot inspect files" in outcome.err
    assert call("experiment", "inspect", "some.log", "--loader", "plian", plugin=plugin).code == 2


@pytest.mark.parametrize("options", [(), ("--json",)])
def test_any_other_word_is_the_study(call: Call, study: Path, options: tuple[str, ...]) -> None:
    outcome = call("experiment", *options, study, "--out", "run", plugin=PLUGIN)
    assert outcome.code == 0
    assert Path("run/measured/s1.parquet").is_file()


def test_a_specimen_of_two_spots_is_named(call: Call, study: Path) -> None:
    file = study / "study.toml"
    file.write_text(file.read_text().replace('"s2.txt"', '"s1.txt"'))
    outcome = call("experiment", study, "--out", "run", plugin=PLUGIN)
    assert outcome.code == 2
    assert "s1.txt of spot 's2': it has the numbers of s1.txt of spot 's1'" in outcome.err


def test_help_shows_both(call: Call) -> None:
    outcome = call("experiment", "--help")
    assert "STUDY | inspect FILE" in outcome.out
    assert call("experiment", "inspect", "--help").code == 0


def test_a_mesh_in_place_of_a_study_names_the_command_that_looks_into_it(call: Call) -> None:
    Path("leg 1.msh").touch()
    outcome = call("limb", "leg 1.msh", plugin=None)
    assert outcome.code == 2
    assert "palpate limb inspect 'leg 1.msh'" in outcome.err
