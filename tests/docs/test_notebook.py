"""The notebook runs, cell by cell, and every cell has something to show."""

import ast
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest

import palpate

FILE = Path(__file__).parents[2] / "examples" / "notebook.ipynb"


def cells() -> list[str]:
    """Code of each cell; a notebook in the repository has no outputs."""
    notebook = json.loads(FILE.read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] for cell in code)
    return ["".join(cell["source"]) for cell in code]


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], list[Any]]:
    """Names after the last cell, and what each cell showed."""
    out = tmp_path_factory.mktemp("notebook")
    values: dict[str, Any] = {}
    found = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PALPATE_SETS", "24")
        patch.setenv("PALPATE_OUT", str(out))
        for code in cells():
            *body, last = ast.parse(code).body
            if isinstance(last, ast.Expr):
                exec(compile(ast.Module(body, []), str(FILE), "exec"), values)
                found.append(eval(compile(ast.Expression(last.value), str(FILE), "eval"), values))
            else:
                exec(compile(ast.Module([*body, last], []), str(FILE), "exec"), values)
    assert (out / "chosen.csv").is_file()
    return values, found


@pytest.mark.slow
def test_every_cell_shows_itself(shown: tuple[dict[str, Any], list[Any]]) -> None:
    _, found = shown
    assert len(found) == 12
    for value in found:
        assert "object at 0x" not in repr(value)


@pytest.mark.slow
def test_the_fit_has_intervals_and_a_picture_of_its_curves(shown: tuple[dict[str, Any], list[Any]]) -> None:
    values, found = shown
    intervals, _, picture, stress, _ = found[-5:]
    assert intervals["parameter"].to_list() == ["specimen.c1", "specimen.c2", "specimen.c3"]
    assert intervals["identifiability"].to_list() == ["poorly", "not identified", "not identified"]
    assert (intervals["lower"] < intervals["value"]).all()
    assert len(picture.axes) >= 3
    assert stress.shape == (3,)
    assert (values["folder"] / "report" / "index.html").is_file()


@pytest.mark.slow
def test_a_fit_to_one_test_misses_the_others_by_the_factors_of_the_text(
    shown: tuple[dict[str, Any], list[Any]],
) -> None:
    _, found = shown
    tensile = found[-4].row(by_predicate=pl.col("scenario") == "uniaxial only", named=True)
    assert tensile["nmse_uniaxial"] == pytest.approx(0.6, abs=0.05)
    assert tensile["nmse_equibiaxial"] == pytest.approx(2.0, abs=0.2)
    assert tensile["nmse_pure_shear"] == pytest.approx(9.0, abs=0.5)


@pytest.mark.slow
def test_three_scenarios_choose_one_of_the_250_sets(tmp_path: Path) -> None:
    plugins = palpate.Plugins.load()
    study = palpate.read_study(plugins.studies["treloar"].directory, plugins)
    study = replace(study, n_total=250, search=plugins.searches["sweep"]())
    chosen = palpate.run_study(study, tmp_path / "run", plugins).selected.selection
    of = dict(chosen.select("scenario", "set_id").iter_rows())
    assert of["joint"] == of["uniaxial only"] == of["pure shear only"] != of["equibiaxial only"]


@pytest.mark.slow
def test_values_of_ones_own_have_a_larger_fopt_than_the_fit(shown: tuple[dict[str, Any], list[Any]]) -> None:
    values, _ = shown
    least = values["run"].fit.filter(scenario="joint")["fopt"].max()
    assert all(fopt > least for fopt in values["fopts"].values())
