"""plugins/README.md and plugins/reference.md are true of hooks, contracts and plugins."""

import re
from pathlib import Path

import numpy as np
import pytest
from hook_reference import BEGIN, END, main, reference, written

from palpate import mechanics, testing
from palpate.errors import PluginError
from palpate.plugins.catalogue import Plugins
from palpate.plugins.registry import HOOKS, KINDS
from palpate.plugins.scaffold import KITS

FOLDER = Path(__file__).parents[2] / "plugins"
README = (FOLDER / "README.md").read_text(encoding="utf-8")
REFERENCE = (FOLDER / "reference.md").read_text(encoding="utf-8")


def test_the_reference_is_current(tmp_path: Path) -> None:
    assert written(REFERENCE, "reference.md") == REFERENCE, "run `make hooks`"
    stale = tmp_path / "reference.md"
    stale.write_text(REFERENCE.replace("### `palpate_materials`", "### `palpate_stuff`"))
    main([str(stale)])
    assert stale.read_text() == REFERENCE


def test_it_lists_every_hook_in_pipeline_order_with_what_to_define() -> None:
    text = reference()
    hooks = re.findall(r"^### `(palpate_\w+)`$", text, flags=re.MULTILINE)
    assert set(hooks) == HOOKS
    assert hooks.index("palpate_experiment_loaders") < hooks.index("palpate_solvers")
    assert "| define | `simulate(job, limb)` | Simulate one job." in text
    assert "| set | `parameters` | `tuple[Parameter, ...]` |" in text
    assert "| `weights` | `Mapping[str, float]` |" in text
    assert not re.search(r":\w+:`|``", text)


@pytest.mark.parametrize("text", ["", BEGIN, f"{END}\n{BEGIN}"])
def test_a_text_without_marks_is_refused(text: str) -> None:
    with pytest.raises(PluginError, match=r"x\.md: has no lines"):
        written(text, "x.md")


def test_the_table_lists_the_hooks() -> None:
    assert set(re.findall(r"^\| `(palpate_\w+)` \|", README, flags=re.MULTILINE)) == HOOKS


def test_the_plugin_in_thirty_lines_works(tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    assert len(code.splitlines()) <= 30
    path = tmp_path / "gent.py"
    path.write_text(code, encoding="utf-8")
    plugins = Plugins.load([path], entry_points=False)
    assert plugins.broken == ()
    gent = plugins.materials["gent"]()
    mu, kappa = mechanics.initial_moduli(gent, np.array([0.05, 30.0, 1.0]))
    assert mu == pytest.approx(0.05, rel=1e-9)
    assert kappa == pytest.approx(1.0, rel=1e-9)


def test_every_contract_is_listed_with_its_laws() -> None:
    contracts = {name for name in testing.__all__ if name.endswith("Contract")} - {"ComponentContract"}
    table = README.split("| contract | detects |")[1].split("## Hooks")[0]
    assert set(re.findall(r"`(\w+Contract)`", table)) == contracts
    assert {kind.contract for kind in KINDS.values() if kind.contract} == contracts
    assert contracts == set(re.findall(r"palpate\.testing\.(\w+)", reference()))


def test_every_plugin_of_the_folder_is_listed() -> None:
    listed = set(re.findall(r"^\| \[([\w-]+)\]", README, flags=re.MULTILINE))
    assert listed == {path.parent.name for path in FOLDER.glob("*/pyproject.toml")}


def test_every_kind_of_new_plugin_is_listed() -> None:
    listed = README[README.index("palpate new-plugin") :].split("\n    cd ")[0]
    assert set(KITS) <= set(re.findall(r"\w+", listed))


def test_what_is_linked_exists() -> None:
    for target in re.findall(r"\]\(([^)#]+)", README):
        assert (FOLDER / target).exists(), target


def test_every_listed_catalogue_exists() -> None:
    plugins = Plugins.load(entry_points=False)
    for kind in re.findall(r"`palpate plugins ([\w-]+)`", reference()):
        assert plugins.catalogue(kind.replace("-", "_")) is not None
