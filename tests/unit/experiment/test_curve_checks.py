"""Mistakes in measured curves are found by what their channels declare, whichever loader has read them."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from palpate.domain import Channel, Curve
from palpate.domain.channels import LATERAL_FORCE
from palpate.domain.indenter import Sphere
from palpate.errors import CurveError
from palpate.experiment.curve_checks import check_curve, young_range
from palpate.experiment.measured import load_measured, measured_warnings
from palpate.plugins.catalogue import Plugins
from palpate.study.checks import setting_warnings
from palpate.study.reading import Study, read_study

LINES = {"abscissa": "x_mm", "ordinate": "y_mm", "abscissa_label": "x", "ordinate_label": "y"}
DEPTH, ANGLE, FORCE, TORQUE = range(4)


@cache
def plugins() -> Plugins:
    return Plugins.load()


@cache
def study() -> Study:
    return read_study(Path(plugins().studies["forearm-demo"].directory), plugins())


@pytest.fixture
def read(tmp_path):
    """Read the demo's curves of p1 after a change of the table; returns the warnings."""
    spot = study().spots[0]
    (file,) = spot.measured[None]
    header, *rows = file.read_text().splitlines()
    clean = np.array([row.split(",") for row in rows], dtype=float)

    def call(change=lambda table: table, protocol=None):
        path = tmp_path / "p1.csv"
        lines = [",".join(map(repr, row)) for row in change(clean.copy()).tolist()]
        path.write_text("\n".join([header, *lines]) + "\n")
        one = replace(study(), spots=(replace(spot, measured={None: (path,)}, protocol=protocol),))
        return measured_warnings(load_measured(one, plugins().channels))

    return call


def test_a_force_of_zero_is_left_to_scoring(read, monkeypatch):
    monkeypatch.setattr("palpate.experiment.curve_checks.young_range", lambda space: None)
    read(times(FORCE, 0.0))


def times(column, factor):
    def change(table):
        table[:, column] *= factor
        return table

    return change


def plus(column, value, rows=slice(None)):
    def change(table):
        table[rows, column] += value
        return table

    return change


def times_at(column, row, factor):
    def change(table):
        table[row, column] *= factor
        return table

    return change


def swapped(table):
    return table[:, [DEPTH, ANGLE, TORQUE, FORCE]]


def mirrored(table):
    table[:, [ANGLE, TORQUE]] *= -1.0
    return table


def shifted(depth_mm):
    """Force of a contact that begins deeper, on the same depths."""

    def change(table):
        press = table[:, ANGLE] == 0.0
        press[int(np.argmax(table[:, DEPTH])) :] = False
        x, y = table[press, DEPTH].copy(), table[press, FORCE].copy()
        table[press, FORCE] = np.interp(x - depth_mm, x, y)
        return table

    return change


def two_points(table):
    pressed = int(np.argmax(table[:, DEPTH]))
    return np.delete(table, slice(1, pressed), axis=0)


def hole(table):
    """Without the rows between 5 and 10 mm."""
    inside = (table[:, DEPTH] > 4.7) & (table[:, DEPTH] < 9.9)
    return table[~inside]


def test_clean_curves_give_no_warning(read):
    assert read() == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (times(TORQUE, 1e-3), r"p1\.csv: spot 'p1': 'torque' over 'force' is a lever|torque_Nmm reaches"),
        (times(TORQUE, -1.0), "'torque': up to row .* returns more work than was put in .* turn the sign"),
        (
            times(FORCE, -1.0),
            "'force': force_N is -13.01 at depth_mm 10, and it cannot be negative; turn its",
        ),
        (
            times(FORCE, 1e-3),
            r"'force': force_N reaches 0\.01301, and the ranges of the study .* check the unit",
        ),
        (times(FORCE, 101.97), "'force': force_N reaches 1327, and the ranges"),
        (times(FORCE, 1e3), "'force': force_N reaches 1.301"),
        (swapped, "channel"),
        (
            plus(FORCE, 3.0),
            "'force' is 3 force_N at depth_mm 0, 19% of its peak, where it must be 0; subtract",
        ),
        (plus(FORCE, -1.0), "'force': force_N is -1 at depth_mm 0.* subtract the bias"),
        (mirrored, "'torque' goes to 22.5 degrees first where the protocol goes to -22.5 degrees; give"),
        (two_points, "'force' has no point between 0 and 10, more than half"),
        (hole, "'force' has no point between .* more than half"),
    ],
)
def test_what_cannot_be_is_refused(read, change, message):
    with pytest.raises(CurveError, match=message):
        read(change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (times(TORQUE, 0.1), "'torque' over 'force' is a lever of 0.19 mm, where a sphere .* about 2.9 mm"),
        (times(FORCE, 1 / 9.80665), "'torque' over 'force' is a lever of 18.6 mm"),
        (plus(FORCE, 1.0), r"'force' is 1 force_N at depth_mm 0, 7% of its peak, .*: the sensor has a bias"),
        (shifted(-1.0), r"'force' is 0\.4044 force_N at depth_mm 0, .* \(as if contact began at -0\.9"),
        (shifted(1.0), "'force' rises as if first contact were at depth_mm 1.* and not at 0; shift"),
        (shifted(0.5), "'force' rises as if first contact were at depth_mm 0.5"),
    ],
)
def test_suspicious_curves_give_a_warning(read, change, message):
    (warning,) = read(change)
    assert warning.startswith("p1.csv: spot 'p1': ")
    assert re.search(message, warning), warning


def test_what_a_channel_does_not_declare_is_not_checked():
    curve = Curve(channel="profile", abscissa=np.arange(9.0), ordinate=-2.0 - np.arange(9.0))
    assert check_curve(curve, Channel(name="profile", **LINES)) == []
    for declared in ({"non_negative": True}, {"dissipative": True}, {"zero_at_start": True}):
        with pytest.raises(CurveError, match="channel 'profile'"):
            check_curve(curve, Channel(name="profile", **LINES, **declared))


def test_the_lateral_force_before_a_slide_is_that_of_the_press_before_it():
    """Of a limb that is not the same on both sides: 5 % of the peak on the forearm phantom."""
    way = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0, 0.0])
    for start, loss in ((0.1, 0.3), (-0.1, 0.3), (0.4, 0.5)):
        falls = np.where(np.arange(9) > 4, loss, 0.0)
        curve = Curve(channel="lateral_force", abscissa=way, ordinate=start + 0.5 * way - falls)
        assert check_curve(curve, LATERAL_FORCE) == []


def test_few_points_are_a_warning_in_any_channel():
    curve = Curve(channel="profile", abscissa=[0.0, 1.0, 2.0, 3.0], ordinate=[0.0, 1.0, 2.0, 3.0])
    assert check_curve(curve, Channel(name="profile", **LINES)) == [
        "channel 'profile' has 4 points from 0 to 3 and none between 0 and 1; "
        "give more rows, their shape decides the parameters"
    ]


@pytest.mark.parametrize("factor", [1e4, -1e4, 1e30])
def test_a_number_that_stands_for_no_value_is_refused(read, factor):
    with pytest.raises(CurveError, match=r"in row 8 and .* as of a missing value; remove this row"):
        read(times_at(FORCE, 8, factor))


def test_a_row_far_off_its_neighbours_is_a_warning(read):
    warning = read(times_at(FORCE, 8, 20.0))[0]
    assert re.search(r"'force' is \d+\.?\d* in row 8 and .* next to it; check this row", warning)


def test_the_moduli_are_those_of_the_ranges():
    low, high = young_range(study().space)
    # E = 6 c1 of 9 to 21 kPa, give or take what c2 adds at a strain of 5 % and c2, c3 at 30 %.
    assert low == pytest.approx(0.054, rel=0.02)
    assert 0.126 < high < 0.15


def test_only_a_study_with_slips_gets_warnings():
    assert list(setting_warnings(study())) == []
    (region,) = study().space.regions
    c1, c2, c3 = region.searched
    kappa = next(p for p in region.material.parameters if p.name == "kappa")
    flipped = replace(c2, lower=-c2.upper, upper=-c2.lower)
    wide = replace(region, searched=(replace(c1, lower=0.005, upper=25.0), flipped, c3, kappa), fixed={})
    slips = replace(
        study(),
        protocol=replace(study().protocol, indenter=Sphere(radius_mm=0.75)),
        space=replace(study().space, regions=(wide,)),
        spots=study().spots[:1],
    )
    assert [text.split(",")[0] for text in setting_warnings(slips)] == [
        "spot 'p1': a sphere of radius 0.75 mm is pressed 10 mm deep",
        "soft_tissue: Poisson's ratio is -0.79 in the middle of the ranges",
        "soft_tissue.c1: the range spans a factor of 5000",
        "soft_tissue.c2: the range has the other sign than the material's own",
        "soft_tissue.kappa: is searched and resists change of volume only",
    ]
    soft = replace(region, fixed=dict(region.fixed) | {"kappa": 8e-4})
    (found,) = setting_warnings(replace(study(), space=replace(study().space, regions=(soft,))))
    # Yeoh: μ = 2 c1 = 30 kPa and κ = 0.8 kPa, so ν = (3κ - 2μ) / (6κ + 2μ).
    assert found.startswith("soft_tissue: Poisson's ratio is -0.89 in the middle of the ranges")
    log = replace(
        wide, searched=(replace(c1, lower=0.005, upper=25.0, scale="log"), c2, c3), fixed=region.fixed
    )
    assert list(setting_warnings(replace(study(), space=replace(study().space, regions=(log,))))) == []
