"""Every output of a run has the same values, intervals, Fopt and R², and all of them are of the same set."""

import csv
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import palpate
from palpate.mechanics.homogeneous import nominal_stress
from palpate_materials.uncoupled import Yeoh

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("one_figure")]

STUDY = Path(palpate.__file__).parents[2] / "plugins/palpate-materials/src/palpate_materials/studies/treloar"
TRUTH = (0.18, -2e-3, 4e-5, 1000.0)
FILES = {"uniaxial": "UT", "equibiaxial": "ET", "pure_shear": "PS"}


def study_of(folder):
    """Three tests of one material whose curves err by some percent, each in its own way."""
    shutil.copytree(STUDY, folder)
    for i, (mode, name) in enumerate(FILES.items()):
        stretch = np.linspace(1.0, 3.0 + i, 25)
        stress = nominal_stress(Yeoh(), np.array(TRUTH), mode, stretch)
        wrong = (1.0 + 0.02 * (i - 1)) * stress + 0.008 * stress.max() * np.sin((3.0 + i) * stretch)
        wrong = np.where(stretch == 1.0, 0.0, wrong)
        rows = "".join(f"{x:.6f},{y:.6f}\n" for x, y in zip(stretch, wrong, strict=True))
        (folder / "measured" / f"{name}.csv").write_text(f"stretch,stress_MPa\n{rows}")
    path = folder / "study.toml"
    path.write_text(path.read_text().replace("n_sets = 250", "n_sets = 0"))
    return folder


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Study, and the folder of its run."""
    folder = tmp_path_factory.mktemp("numbers")
    return study_of(folder / "rubber"), folder / "run"


@pytest.fixture
def run(call, made):
    study, folder = made
    if not folder.exists():
        ran = call("run", study, "--out", folder, "--json", plugin=None)
        assert ran.code == 0, ran.err
        (folder.parent / "ran.json").write_text(ran.out)
    return folder


def numbers(text):
    """Numbers in LaTeX or Markdown, with their minus signs and powers of ten."""
    plain = text.replace("−", "-").replace(r"\times10^{", "e").replace("}$", "")
    return [float(each) for each in re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", plain)]


def is_among(value, found, rel):
    return any(each == pytest.approx(value, rel=rel) for each in found)


def rows_of(path):
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_every_output_has_the_same_numbers_of_the_same_set(call, made, run):
    study = palpate.read_study(made[0])
    saved = palpate.open_run(run)
    intervals = {row["parameter"]: row for row in saved.intervals.filter(scenario="joint").to_dicts()}
    (fit,) = saved.fit.filter(scenario="joint").to_dicts()
    assert fit["fopt"] > 1.01 * fit["fopt_least"]  # else this test could not fail
    values = {name: row["value"] for name, row in intervals.items()}
    assert {name: fit[name] for name in values} == values

    # What is stated of these values is what a simulation of them has.
    with palpate.open_problem(study, folder=run) as problem:
        assert problem.fopt([values[name] for name in problem.names]) == pytest.approx(fit["fopt"], rel=1e-9)
    drawn = saved.curves.filter(source="fitted", scenario="joint")
    measured = saved.curves.filter(source="measured")
    for channel in FILES:
        one, other = (frame.filter(channel=channel)["ordinate"].to_numpy() for frame in (drawn, measured))
        r2 = 1.0 - np.sum((one - other) ** 2) / np.sum((other - other.mean()) ** 2)
        assert fit[f"r2_{channel}"] == pytest.approx(r2, rel=1e-6)
        assert fit[f"nmse_{channel}"] == pytest.approx(np.mean((one - other) ** 2), rel=1e-6)

    # The terminal and JSON, and the page.
    ran, report = json.loads((run.parent / "ran.json").read_text()), run / "report"
    for row, known in zip(ran["intervals"], intervals.values(), strict=True):
        assert [row[key] for key in ("value", "lower", "upper")] == [
            known[key] for key in ("value", "lower", "upper")
        ]
    (of_run,) = (row for row in ran["fit"] if row["scenario"] == "joint")
    assert of_run["fopt"] == fit["fopt"]
    stated = f"Fopt {fit['fopt']:.2g} (the least: {fit['fopt_least']:.2g})"
    page = (report / "index.html").read_text(encoding="utf-8")
    assert stated in page
    assert stated in " ".join(ran["conclusion"])
    r2_least = min(fit[f"r2_{channel}"] for channel in FILES)

    # Tables, LaTeX and the paragraph on methods.
    (of_table,) = (row for row in rows_of(report / "tables/table2_fit.csv") if row["spot"] == "specimen")
    assert float(of_table["joint"]) == pytest.approx(fit["fopt"])
    for row in rows_of(report / "tables/intervals.csv"):
        if row["scenario"] == "joint":
            assert float(row["value"]) == pytest.approx(values[row["parameter"]])
    table1 = numbers((report / "tables/paper_table1.tex").read_text(encoding="utf-8"))
    assert is_among(round(r2_least, 4), table1, 1e-9)
    table2 = numbers((report / "tables/paper_table2.tex").read_text(encoding="utf-8"))
    assert is_among(fit["fopt"], table2, 1e-2)
    assert not is_among(fit["fopt_least"], table2, 1e-3)
    methods = (report / "methods.md").read_text(encoding="utf-8")
    assert (
        f"Fopt is {fit['fopt']:.3g} at the reported values and {fit['fopt_least']:.3g} at its least"
        in methods
    )
    assert "efficient estimator" in methods

    # A comparison, and the card.
    other = run.parent / "copy"
    shutil.copytree(run, other, dirs_exist_ok=True)
    compared = call("compare", run, other, "--into", "both", "--json", plugin=None)
    assert compared.code == 0, compared.err
    tables = compared.json["tables"]
    assert all(row["fopt"] == pytest.approx(fit["fopt"]) for row in tables["errors"])
    of_parameters = [row for row in tables["parameters"] if row["run"] == "run"][: len(values)]
    assert [row["value"] for row in of_parameters] == pytest.approx(list(values.values()))
    card = call("card", run, "--for", "json", plugin=None)
    assert card.code == 0, card.err
    of_card = json.loads(card.out)["specimen"]["parameters"]
    for name, known in intervals.items():
        shown = of_card[name.rpartition(".")[2]]
        assert shown["value"] == pytest.approx(known["value"])
        assert shown["interval_95"] == pytest.approx([known["lower"], known["upper"]])
        for key in ("value", "lower", "upper"):
            assert any(
                is_among(known[key], [size * each for each in table1], 2e-2) for size in (1.0, 1e-3, 1e-6)
            )
