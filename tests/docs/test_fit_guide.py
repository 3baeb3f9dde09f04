"""The guide of the fit is true: its programs run as they are there, and find the same parameters."""

import re
import tomllib
from pathlib import Path

import pytest

from palpate.cli.app import main
from palpate.plugins.catalogue import Plugins
from palpate.run.ledger import Ledger
from palpate.study.model import BudgetTable, FitTable, RegionTable, SamplingTable, SpotTable
from palpate_certainty.assumptions import ASSUMED

GUIDE = (Path(__file__).parents[2] / "docs" / "fit.md").read_text(encoding="utf-8")
PLUGINS = Plugins.load(entry_points=False)


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", GUIDE, flags=re.MULTILINE | re.DOTALL)


def test_the_table_has_the_keys_of_a_study_and_their_defaults() -> None:
    text = blocks("toml")[2]
    table = FitTable.model_validate(tomllib.loads(text)["fit"])
    assert table == FitTable()
    (example,) = re.findall(r"such as (\{.*\}):", text)
    settings = tomllib.loads(f"settings = {example}")["settings"]
    assert PLUGINS.searches[table.search].Settings.model_validate(settings).max_steps == 20
    left_out = set(FitTable.model_fields) - table.model_fields_set
    assert left_out == {"parametrisation", "searched"}


def test_the_tables_of_parameters_sampling_and_searched_are_read() -> None:
    regions, sampling, _, fit, states = map(tomllib.loads, blocks("toml"))
    for region in regions["region"].values():
        assert set(RegionTable.model_validate(region).parameters) == {"c1", "kappa"}
    table = SamplingTable.model_validate(sampling["sampling"])
    sampler = PLUGINS.samplers[table.sampler]
    assert sampler.Settings.model_validate(table.settings).criterion == "maximin"
    searched = PLUGINS.parametrisations["standard"].Settings
    assert searched.model_validate(fit["fit"]["searched"]).friction
    assert searched.model_validate(states["fit"]["searched"]).stiffness.keys() == {"muscle"}
    assert [SpotTable.model_validate(spot).state for spot in states["spot"]] == ["rest", "contracted"]


@pytest.mark.parametrize(
    ("kind", "columns"), [("samplers", "sampler | draws"), ("searches", "search | finds")]
)
def test_components_of_the_core_are_listed(kind: str, columns: str) -> None:
    listed = re.findall(rf"\| {re.escape(columns)} \|\n\|---\|---\|\n((?:\| `.*\n)+)", GUIDE)[0]
    assert re.findall(r"^\| `([\w-]+)`", listed, re.MULTILINE) == list(PLUGINS.catalogue(kind))


@pytest.mark.slow
def test_two_optimisers_find_the_same_parameters(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cma", reason="in the dependency group dev")
    monkeypatch.chdir(tmp_path)
    assert main(["init", "--study", "treloar", "rubber"]) == 0
    names: dict[str, object] = {}
    for code in blocks("python"):
        exec(code, names)
    values, by_cma = names["values"], names["values_by_cma"]
    assert isinstance(values, dict)
    assert by_cma == {name: pytest.approx(value, rel=0.05) for name, value in values.items()}
    with Ledger(tmp_path / "runs" / "notebook") as ledger:
        assert len(ledger.seconds()) > 20


def test_the_budget_has_the_keys_of_a_study() -> None:
    guide = (Path(__file__).parents[2] / "docs" / "budget.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"^```toml\n(.*?)^```", guide, flags=re.MULTILINE | re.DOTALL)
    copied = BudgetTable.model_validate(tomllib.loads(text)["budget"])
    # What a loader finds stays as it is where the block is copied.
    assert set(BudgetTable.model_fields) - copied.model_fields_set == {
        "onset",
        "zero",
        "mesh",
        "position",
        "bone",
        "layers",
    }
    given = BudgetTable.model_validate(tomllib.loads(re.sub("^# ", "", text, flags=re.MULTILINE))["budget"])
    assert given.model_fields_set == set(BudgetTable.model_fields)
    assert (given.onset, given.zero) == (ASSUMED.onset_mm, 0.0)
    shown = copied.model_copy(update={"friction": None, "parameters": {}})
    assert shown == BudgetTable()
