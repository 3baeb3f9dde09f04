"""Contour lines of Fopt on the page and in the figures."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from hypothesis import given, strategies as st

from palpate.api.report import Paragraph
from palpate.fit.least_squares import LeastSquares
from palpate_report.data.display_units import in_display_units
from palpate_report.figures.contours import FIRST, MOST_LEVELS, along, contours, levels_from, planes_of
from palpate_report.figures.space import parameter_space
from palpate_report.page.page_data import page_data
from palpate_report.sections.sweep import Space

from .fits import with_tables

NAMES = ("soft_tissue.stiffness", "soft_tissue.grip")


@given(st.floats(1e-12, 1e3))
def test_levels_begin_next_to_the_least_and_are_round(least):
    levels = list(levels_from(least))
    assert len(levels) == MOST_LEVELS
    assert levels == sorted(levels)
    assert FIRST * least <= levels[0] <= 4.0 * FIRST * least
    assert {f"{level:e}"[0] for level in levels} == {"1", "3"}


@pytest.fixture
def fitted(content):
    return content(search=LeastSquares(), truth=dict(zip(NAMES, (0.45, 22.0), strict=True)))


def known(data, fopt):
    """The same run with an Fopt of the joint fit that is known: a posterior's emulator replaces the fit's."""
    x, y = np.meshgrid(np.linspace(0.1, 0.9, 41), np.linspace(5.0, 50.0, 41), indexing="ij")
    plane = {"other": NAMES[1], "value": x.ravel(), "other_value": y.ravel(), "fopt": fopt(x, y).ravel()}
    lines = {"other": None, "value": x[:, 0], "other_value": None, "fopt": fopt(x, y).min(axis=1)}
    about = {"fit": data.together, "scenario": "I", "parameter": NAMES[0]}
    planes = pl.concat([pl.DataFrame(about | rows) for rows in (plane, lines)], how="vertical_relaxed")
    planes = planes.with_columns(pl.col("fopt").fill_nan(None))
    return with_tables(data, posterior_planes=planes)


def test_contours_are_where_fopt_is_their_level(fitted):
    def fopt(x, y):
        return 0.01 * np.exp(40.0 * (x - 0.5) ** 2 + 0.002 * (y - 20.0) ** 2)

    found = contours(known(fitted, fopt), "I", *NAMES)
    assert len(found) > 3
    for each in found:
        on = np.isfinite(each.x)
        np.testing.assert_allclose(fopt(each.x[on], each.y[on]), each.level, rtol=0.02)
        assert on[each.label]


def test_there_is_no_line_where_fopt_is_not_known(fitted):
    def fopt(x, y):
        return np.where(x < 0.7, 0.01 + x + 0.0 * y, np.nan)

    found = known(fitted, fopt)
    assert max(np.nanmax(each.x) for each in contours(found, "I", *NAMES)) <= 0.7
    x, y = along(found, "I", NAMES[0])
    np.testing.assert_array_equal(np.isnan(y), x >= 0.7)
    nowhere = known(fitted, lambda x, y: np.nan * x)
    assert contours(nowhere, "I", *NAMES) == []
    assert along(nowhere, "I", NAMES[0]) is None


def test_a_fit_has_contours_in_the_units_of_the_study_on_page_and_figure(fitted):
    least = planes_of(fitted, "I")["fopt"].min()
    ends = fitted.fit.ends.filter(fit=fitted.together, scenario="I")
    assert least == pytest.approx(ends["fopt_least"][0], rel=0.05, abs=1e-6)
    units = replace(fitted, study=replace(fitted.study, units={NAMES[0]: "kPa"}))
    factor = in_display_units(units).factors[NAMES[0]]
    written = planes_of(in_display_units(units), "I")["value"].to_numpy()
    is_first = (planes_of(fitted, "I")["parameter"] == NAMES[0]).to_numpy()
    expected = planes_of(fitted, "I")["value"].to_numpy() * np.where(is_first, factor, 1.0)
    np.testing.assert_allclose(written, expected)
    shown = page_data(fitted)
    assert shown["contours"][0]["0 1"]
    assert all(line is not None for line in shown["along"][0])
    labels = [text.get_text() for axis in parameter_space(fitted, "p1").axes for text in axis.texts]
    assert labels == [f"{line['level']:g}" for line in shown["contours"][0]["0 1"]]


def test_without_a_fit_there_are_none(content):
    shown = page_data(content())
    assert shown["contours"][0] == {"0 1": []}
    assert shown["along"][0] == [None, None]


@pytest.mark.parametrize(("unknown", "is_drawn"), [(0.4, True), (0.6, False)])
def test_ends_of_contours_in_an_unknown_plane_are_not_drawn_but_said(fitted, unknown, is_drawn):
    planes = fitted.table("profile_planes")
    share = pl.int_range(pl.len()) / pl.len()
    partly = planes.with_columns(
        fopt=pl.when(pl.col("other").is_not_null() & (share.over("scenario", "other") < unknown))
        .then(None)
        .otherwise(pl.col("fopt"))
    )
    data = with_tables(fitted, profile_planes=partly)
    names = [p.name for p in data.design.parameters]
    assert bool(contours(data, "I", *names)) == is_drawn
    said = " ".join(block.text for block in Space().blocks(data, None) if isinstance(block, Paragraph))
    assert ("Contour lines:" in said) == is_drawn
    assert ("no contour lines" in said) != is_drawn


def test_one_parameter_has_no_planes_to_speak_of(fitted, monkeypatch):
    monkeypatch.setattr(type(fitted), "brief", {"c1": next(iter(fitted.brief.values()))})
    texts = [block.text for block in Space().blocks(fitted, None) if isinstance(block, Paragraph)]
    assert not any("plane" in text for text in texts)
