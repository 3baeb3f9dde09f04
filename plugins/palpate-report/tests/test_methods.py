"""The paragraph on methods repeats the run's settings, and what to cite is that of CITATION.cff."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from palpate.api import Indentation
from palpate.api.report import rounded
from palpate.domain.indenter import Sphere
from palpate.fit.least_squares import LeastSquares
from palpate_report.answer.methods import methods, references
from palpate_report.from_run import write_report

from .fits import with_tables

ROOT = Path(__file__).parents[3]


@pytest.fixture
def fitted(content):
    return content(search=LeastSquares())


@pytest.mark.parametrize("friction", [0.3, 0.75])
@pytest.mark.parametrize("depth", [4.0, 9.5])
def test_the_paragraph_has_the_settings_of_the_press(content, friction, depth):
    data = content()
    path = np.array([[0.0, 0.0], [depth, 0.0], [depth, -20.0], [depth, 15.0]])
    protocol = Indentation(indenter=Sphere(radius_mm=6.5), path=path, friction=friction)
    text = methods(replace(data, study=replace(data.study, protocol=protocol)), (), ())
    for part in (
        f"coefficient of the contact was {friction:g}",
        f"{depth:g} mm along",
        "−20° to 15°",
        "radius 6.5 mm",
    ):
        assert part in text
    for parameter in data.searched.values():
        assert f"{parameter.name} {parameter.lower:.4g} to {parameter.upper:.4g}" in text
    assert f"{data.design.n_sets} parameter sets" in text
    assert "No parameters can be read from this run." in text


def test_a_friction_that_is_searched_has_no_number(content):
    data, path = content(), np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 15.0]])
    protocol = Indentation(indenter=Sphere(radius_mm=6.5), path=path, friction=1.0)
    data = replace(data, study=replace(data.study, protocol=protocol))
    data.searched["friction"] = replace(next(iter(data.searched.values())), name="friction")
    assert "friction coefficient of the contact was searched." in methods(data, (), ())


def test_the_intervals_name_their_causes_and_what_they_leave_out(fitted):
    text = methods(fitted, (), ("bone", "position"))
    assert text.count("and not bone, position.") == 1
    assert "first contact" in text or "calibration error" in text


def test_spots_that_differ_have_the_mean_and_its_spread(fitted):
    assert fitted.spots_differ("I")
    text = methods(fitted, fitted.estimates, ())
    assert "means of a random effect between the spots" in text
    assert "efficient estimator" not in text
    (row,) = (
        fitted.leading_rows(fitted.table("between_spots"))
        .filter(pl.col("parameter").str.ends_with("grip"))
        .to_dicts()
    )
    assert f"grip = {rounded(row['sd'], row['lower'], row['upper'])} MPa" in text
    alike = with_tables(fitted, between_spots=pl.DataFrame())
    assert "random effect" not in methods(alike, alike.estimates, ())


def test_the_references_are_those_of_the_citation_file(content):
    data = content()
    data = replace(data, manifest={**data.manifest, "versions": {"palpate": "9.8.7"}})
    text, cff = references(data), (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert "version = {9.8.7}" in text
    titles = re.findall(r'title: "(.+)"', cff)
    names = re.findall(r"given-names: (\S+), family-names: ([\w-]+)", cff)
    assert len(titles) == 2
    assert len(names) == 5
    assert all(f"{{{title}}}" in text for title in titles)
    assert " and ".join(f"{family}, {given}" for given, family in names) in text


def test_the_page_and_the_folder_have_the_text(content, tmp_path, monkeypatch):
    monkeypatch.setattr("palpate_report.from_run.write_figures", lambda *_: ())
    made = write_report(content(), tmp_path)
    assert tmp_path / "methods.md" in made.files
    assert (tmp_path / "methods.md").read_text(encoding="utf-8") == made.conclusion.methods
    assert "Parameters were identified with palpate" in (tmp_path / "index.html").read_text(encoding="utf-8")
