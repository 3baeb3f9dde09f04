"""The guides for authors of plugins are true: their code runs, and every value has its table."""

import json
import re
import tomllib
from pathlib import Path

import pytest

from palpate.cli.app import main
from palpate.cli.session import Session
from palpate.study.model import ScenarioTable
from palpate.testing import bench
from palpate.testing.studies import StudyRunner

ROOT = Path(__file__).parents[2]
GUIDES = [(ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("plugins-api.md", "plugins-fit.md")]
PYTHON = [re.findall(r"```python\n(.*?)```", guide, flags=re.DOTALL) for guide in GUIDES]
TABLES = {
    name: re.findall(r"^\| `(\w+)` \|", rows, flags=re.MULTILINE)
    for name, rows in re.findall(
        r"^\| `(\w+)` \| \|\n\|---\|---\|\n((?:\|.*\n)+)",
        (ROOT / "plugins" / "reference.md").read_text(encoding="utf-8"),
        flags=re.MULTILINE,
    )
}


@pytest.mark.slow
@pytest.mark.parametrize("blocks", PYTHON, ids=["api", "fit"])
def test_the_code_runs_from_top_to_bottom(blocks):
    namespace: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "docs", "exec"), namespace)


def test_every_value_that_a_solver_meets_has_its_table():
    assert {"Job", "Limb", "Mesh", "Simulation", "Spot", "Curve", "Response", "Channel"} <= set(TABLES)


def test_every_value_that_a_search_meets_has_its_table():
    assert {"SearchSpace", "Trial", "Evaluation"} <= set(TABLES)


def test_a_session_has_the_methods_of_the_page():
    assert {"study", "table", "say", "json", "note", "next"} <= set(TABLES["Session"])
    assert all(hasattr(Session, name) for name in TABLES["Session"])


def test_the_scenario_is_read():
    (text,) = re.findall(r"```toml\n(.*?)```", GUIDES[1], flags=re.DOTALL)
    tables = tomllib.loads(text)
    assert [ScenarioTable.model_validate(table).name for table in tables["scenario"]] == [
        *tables["selection"]["scenarios"]
    ]


def test_the_command_is_called_with_plugin_files(tmp_path, capsys):
    (tmp_path / "ranges.py").write_text(PYTHON[1][-1], encoding="utf-8")
    study = StudyRunner(tmp_path).write()
    files = [f"--plugin={tmp_path / 'ranges.py'}", f"--plugin={bench.__file__}"]
    assert main([*files, "ranges", str(study), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == [{"name": "tissue.e", "lower": 0.1, "upper": 1.0}]
