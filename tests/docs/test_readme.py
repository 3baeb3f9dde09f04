"""The README is true."""

import re
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.core import TyperGroup

from palpate.cli.app import COMMANDS, STAGES, build_app
from palpate.cli.listing import name_of
from palpate.plugins.catalogue import Plugins
from palpate.plugins.registry import HOOKS, add_commands

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
CORE_COMMANDS = {name_of(command) for command in (*COMMANDS, *STAGES)}


def all_commands() -> set[str]:
    """Names of the commands that core and installed plugins bring."""
    app = build_app()
    assert add_commands(app, []) == ()
    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    return set(group.commands)


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\(([^)]+)\)", README))))
def test_a_file_that_the_readme_links_exists(target: str) -> None:
    assert (ROOT / target).is_file()


def test_every_command_of_the_readme_exists_and_the_other_way_round() -> None:
    named = set(re.findall(r"(?:`| {4}|bin/)palpate ([a-z][a-z-]*)", README))
    assert named <= all_commands()
    assert named >= CORE_COMMANDS


def test_the_readme_lists_the_hooks() -> None:
    assert set(re.findall(r"^\| `(palpate_\w+)`", README, flags=re.MULTILINE)) == HOOKS


def test_the_plugin_of_the_readme_works(tmp_path: Path) -> None:
    from palpate import mechanics

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


def test_the_toml_of_the_readme_is_read() -> None:
    import tomllib

    from palpate.study.model import FitTable, RegionTable, SamplingTable, SelectionTable

    regions, sampling, fit, selection = map(
        tomllib.loads, re.findall(r"```toml\n(.*?)```", README, flags=re.DOTALL)
    )
    for region in regions["region"].values():
        assert set(RegionTable.model_validate(region).parameters) == {"c1", "kappa"}
    table = SamplingTable.model_validate(sampling["sampling"])
    plugins = Plugins.load(entry_points=False)
    sampler = plugins.samplers[table.sampler]
    assert sampler.Settings.model_validate(table.settings).criterion == "maximin"
    assert plugins.parametrisations["standard"].Settings.model_validate(fit["fit"]["searched"]).friction
    fitted = FitTable.model_validate(fit["fit"])
    assert plugins.searches[fitted.search].Settings.model_validate(fitted.settings).max_steps == 20
    assert SelectionTable.model_validate(selection["selection"]).stiffness_scaling


@pytest.mark.parametrize(
    ("kind", "columns"), [("samplers", "sampler | draws"), ("searches", "search | finds")]
)
def test_the_readme_lists_components_of_the_core(kind: str, columns: str) -> None:
    listed = re.findall(rf"\| {re.escape(columns)} \|\n\|---\|---\|\n((?:\| `.*\n)+)", README)[0]
    assert re.findall(r"^\| `([\w-]+)`", listed, re.MULTILINE) == list(
        Plugins.load(entry_points=False).catalogue(kind)
    )
