"""Pairs of parameters on the page: draws, the fit, the known answer; and what a posterior adds."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from palpate.fit.least_squares import LeastSquares
from palpate.plugins.sections import Figure, Fold
from palpate.report import make_tables
from palpate.report.layout import checked
from palpate.report.result import Report
from palpate.report.sections.density import WhatCurvesAllow
from palpate.report.verdict import make_verdict
from palpate.run.result import PosteriorResult

NAMES = ("soft_tissue.stiffness", "soft_tissue.grip")
TRUTH = dict(zip(NAMES, (0.45, 22.0), strict=True))
POINTS = np.arange(4)


@pytest.fixture
def fitted(content):
    found = content(search=LeastSquares(), truth=TRUTH)
    certainty = replace(found.fit.certainty, adequacy=pl.DataFrame())
    return replace(found, fit=replace(found.fit, certainty=certainty))


def blocks_of(data):
    tables = make_tables(data)
    report = Report(tables=tables, files=(), verdict=make_verdict(data, tables))
    section = WhatCurvesAllow()
    return checked(section, section.blocks(data, report))


def test_a_pair_has_the_draws_the_sweep_the_fit_and_the_known_answer(fitted):
    figures = [block for block in blocks_of(fitted) if isinstance(block, Figure)]
    assert [figure.scenario for figure in figures] == [s.name for s in fitted.study.scenarios]
    traces = {trace["name"]: trace for trace in figures[0].traces}
    assert list(traces) == ["sweep", "allowed", "fit", "known answer"]
    draws = fitted.fit.certainty.draws.filter(scenario="I", fit=fitted.together)
    assert traces["allowed"]["x"] == draws[NAMES[0]].to_list()
    assert traces["known answer"]["y"] == [22.0]
    assert len(traces["sweep"]["x"]) == 40
    assert figures[0].layout["yaxis"]["title"].startswith("grip")


def test_profiles_and_shares_along_the_path_come_with_a_posterior(fitted):
    profiles = pl.concat(
        pl.DataFrame(
            {
                "fit": "all spots",
                "scenario": "I",
                "parameter": name,
                "value": POINTS + 1.0,
                "rise": POINTS**2.0,
            }
        )
        for name in NAMES
    )
    ribbons = pl.concat(
        pl.DataFrame(
            {
                "spot": spot,
                "channel": "force",
                "point": POINTS,
                "abscissa": 2.0 * POINTS,
                "parameter": name,
                "first": share + 0.0 * POINTS,
                "total": 1.0 + 0.0 * POINTS,
            }
        )
        for spot in fitted.spots
        for name, share in zip(NAMES, (0.7, -0.01), strict=True)
    )
    more = replace(fitted, posterior=PosteriorResult(profiles=profiles, ribbons=ribbons))
    blocks = blocks_of(more)
    by_spot = {block.spot: block for block in blocks if isinstance(block, Figure) and block.spot}
    assert list(by_spot) == list(fitted.spots)
    shares = {trace["name"]: trace["y"] for trace in by_spot["p1"].traces}
    assert shares == {"stiffness": pytest.approx([70.0] * 4), "grip": [0.0] * 4}
    (fold,) = (block for block in blocks if isinstance(block, Fold))
    (figure,) = fold.blocks
    assert {trace["xaxis"] for trace in figure.traces} == {"x", "x2"}
    assert figure.traces[0]["y"] == [0.0, 1.0, 4.0, 9.0]


def test_without_draws_nothing_is_shown(fitted):
    certainty = replace(fitted.fit.certainty, draws=pl.DataFrame())
    assert not blocks_of(replace(fitted, fit=replace(fitted.fit, certainty=certainty)))
