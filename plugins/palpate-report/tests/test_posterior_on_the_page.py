"""What a posterior adds to the page: profiles, and shares of the parameters along the path."""

import numpy as np
import polars as pl
import pytest

from palpate.fit.least_squares import LeastSquares
from palpate_report.answer.warnings import report_warnings
from palpate_report.data.tables import make_tables
from palpate_report.figures.panels import profiles, sobol_indices

from .fits import with_tables

NAMES = ("soft_tissue.stiffness", "soft_tissue.grip")
TRUTH = dict(zip(NAMES, (0.45, 22.0), strict=True))
POINTS = np.arange(4)


@pytest.fixture
def fitted(content):
    return content(search=LeastSquares(), truth=TRUTH)


def test_profiles_and_shares_along_the_path_come_with_a_posterior(fitted):
    rises = pl.concat(
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
    shares = pl.concat(
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
    more = with_tables(fitted, profiles=rises, sobol_indices=shares)
    axes = sobol_indices(more).axes
    assert [axis.get_ylabel() for axis in axes] == [f"share at {spot} (%)" for spot in fitted.spots]
    tops = [area.get_paths()[0].vertices[:, 1].max() for area in axes[0].collections]
    assert tops == pytest.approx([70.0, 70.0])
    drawn = profiles(more).axes
    assert [axis.get_xlabel() for axis in drawn] == ["stiffness (MPa)", "grip (MPa)"]
    assert drawn[0].lines[0].get_ydata().tolist() == [0.0, 1.0, 4.0, 9.0]


def test_a_posterior_that_has_not_converged_is_warned_of(fitted):
    rows = pl.DataFrame(
        {
            "scenario": ["I", "I", "III"],
            "split_r": [1.003, 1.234, 1.002],
            "autocorrelation": [91.0, 20.0, 10.0],
            "converged": [False, False, True],
        }
    )

    tables = make_tables(fitted)

    def warned(table):
        made = with_tables(fitted, posterior=table)
        found = report_warnings(made, tables)
        return [str(each) for each in found if "posterior" in each.what]

    (said,) = warned(rows)
    assert said.startswith("A posterior has not converged. scenario I: split-R̂ up to 1.234, auto")
    assert "time up to 91 steps. Its means" in said
    assert warned(rows.filter(scenario="III")) == warned(pl.DataFrame()) == []
