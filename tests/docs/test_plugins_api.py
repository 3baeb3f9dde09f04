"""The page for authors of plugins is true: its code runs, and its tables are those of the values."""

import dataclasses
import json
import re
import tomllib
from pathlib import Path

import pytest

from palpate import api
from palpate.api import experiment, fit, report
from palpate.cli.app import main
from palpate.cli.session import Session
from palpate.study.model import ScenarioTable
from palpate.testing import bench
from palpate.testing.studies import StudyRunner
from palpate_report.data import report_data
from palpate_report.data.report_data import CONTACT

GUIDE = (Path(__file__).parents[2] / "docs" / "plugins-api.md").read_text(encoding="utf-8")
PYTHON = re.findall(r"```python\n(.*?)```", GUIDE, flags=re.DOTALL)
TABLES = {
    name: re.findall(r"^\| `(\w+)` \|", rows, flags=re.MULTILINE)
    for name, rows in re.findall(r"^\| `(\w+)` \| \|\n\|---\|---\|\n((?:\|.*\n)+)", GUIDE, flags=re.MULTILINE)
}


def value_of(name):
    return next(
        getattr(room, name) for room in (api, experiment, fit, report, report_data) if name in dir(room)
    )


@pytest.mark.slow
def test_the_code_runs_from_top_to_bottom():
    namespace: dict[str, object] = {}
    for block in PYTHON:
        exec(compile(block, "docs/plugins-api.md", "exec"), namespace)


@pytest.mark.parametrize("name", [name for name in TABLES if name != "Session"])
def test_the_fields_are_those_of_the_value(name):
    assert TABLES[name] == [field.name for field in dataclasses.fields(value_of(name))]


def test_every_value_that_a_solver_meets_has_its_table():
    assert {"Job", "Limb", "Mesh", "Simulation", "Spot", "Curve", "Response", "Channel"} <= set(TABLES)


def test_every_value_that_a_search_meets_has_its_table():
    assert {"SearchSpace", "Trial", "Evaluation"} <= set(TABLES)


def test_a_session_has_the_methods_of_the_page():
    assert len(TABLES["Session"]) == 8
    assert all(hasattr(Session, name) for name in TABLES["Session"])


def test_the_diagnostics_are_those_of_the_report():
    (paragraph,) = re.findall(r"\*\*Diagnostics\*\*.*?\n\n", GUIDE, flags=re.DOTALL)
    assert set(CONTACT) | {"depth_mm", "rotation_deg"} <= set(re.findall(r"`(\w+)`", paragraph))


def test_the_scenario_is_read():
    (text,) = re.findall(r"```toml\n(.*?)```", GUIDE, flags=re.DOTALL)
    tables = tomllib.loads(text)
    assert [ScenarioTable.model_validate(table).name for table in tables["scenario"]] == [
        *tables["selection"]["scenarios"]
    ]


def test_the_command_is_called_with_plugin_files(tmp_path, capsys):
    (tmp_path / "ranges.py").write_text(PYTHON[-1], encoding="utf-8")
    study = StudyRunner(tmp_path).write()
    files = [f"--plugin={tmp_path / 'ranges.py'}", f"--plugin={bench.__file__}"]
    assert main([*files, "ranges", str(study), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == [{"name": "tissue.e", "lower": 0.1, "upper": 1.0}]
