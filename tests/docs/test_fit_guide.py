"""The guide of the fit is true: its programs run as they are there, and find the same parameters."""

import re
import tomllib
from pathlib import Path

import pytest

from palpate.certainty.causes import ONSET_MM
from palpate.cli.app import main
from palpate.run.ledger import Ledger
from palpate.study.model import BudgetTable, FitTable

GUIDE = (Path(__file__).parents[2] / "docs" / "fit.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", GUIDE, flags=re.MULTILINE | re.DOTALL)


def test_the_table_has_the_keys_of_a_study_and_their_defaults() -> None:
    (text,) = blocks("toml")
    table = FitTable.model_validate(tomllib.loads(text)["fit"])
    assert table == FitTable()
    left_out = set(FitTable.model_fields) - table.model_fields_set
    assert left_out == {"parametrisation", "searched"}


@pytest.mark.slow
def test_two_optimisers_find_the_same_parameters(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cma", reason="in the dependency group dev")
    monkeypatch.chdir(tmp_path)
    assert main(["init", "--study", "treloar", "rubber"]) == 0
    path = tmp_path / "rubber" / "study.toml"
    path.write_text(path.read_text() + '\n[executor]\nname = "in_process"\n')
    names: dict[str, object] = {}
    for code in blocks("python"):
        exec(code, names)
    values, by_cma = names["values"], names["values_by_cma"]
    assert isinstance(values, dict)
    assert by_cma == {name: pytest.approx(value, rel=0.05) for name, value in values.items()}
    with Ledger(tmp_path / "runs" / "notebook") as ledger:
        assert len(ledger.entries()) > 20


def test_the_budget_has_the_keys_of_a_study() -> None:
    guide = (Path(__file__).parents[2] / "docs" / "identifiability.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"^```toml\n(.*?)^```", guide, flags=re.MULTILINE | re.DOTALL)
    copied = BudgetTable.model_validate(tomllib.loads(text)["budget"])
    # What a loader finds stays as it is where the block is copied.
    assert set(BudgetTable.model_fields) - copied.model_fields_set == {"onset", "zero", "mesh"}
    given = BudgetTable.model_validate(tomllib.loads(re.sub("^# ", "", text, flags=re.MULTILINE))["budget"])
    assert given.model_fields_set == set(BudgetTable.model_fields)
    assert (given.onset, given.zero) == (ONSET_MM, 0.0)
    shown = copied.model_copy(update={"friction": None, "parameters": {}})
    assert shown == BudgetTable()
