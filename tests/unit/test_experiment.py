"""Measured curves must be there and follow the protocol."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import Curve, Indentation, Scenario, Sphere
from palpate.errors import CurveError, PluginError
from palpate.experiment import check_covers, load_measured

PROTOCOL = Indentation(
    indenter=Sphere(radius_mm=7.5),
    path=[(0, 0), (10, 0), (10, -22.5), (10, 22.5), (10, 0)],
    friction=1.0,
)
TWIST = [0.0, -22.5, 0.0, 22.5, 0.0]


def force(x):
    return Curve(channel="force", abscissa=x, ordinate=np.zeros(len(x)))


def torque(x):
    return Curve(channel="torque", abscissa=x, ordinate=np.zeros(len(x)))


def test_both_channels_of_both_spots_are_read(make_study, plugins):
    measured = load_measured(make_study(), plugins.channels)
    assert list(measured) == ["p1", "p2"]
    assert list(measured["p1"]) == ["force", "torque"]
    assert len(measured["p1"]["torque"].branches) == 3


def test_a_weighted_channel_that_is_missing_is_named(make_study, plugins):
    study = make_study(scenarios=(Scenario(name="V", weights={"lateral": 1.0}),))
    with pytest.raises(CurveError, match=r"p1\.csv: spot 'p1' has no channel 'lateral'.*scenario 'V'"):
        load_measured(study, plugins.channels)


def test_a_channel_without_weight_may_be_missing(make_study, plugins):
    study = make_study(scenarios=(Scenario(name="III", weights={"force": 1.0, "lateral": 0.0}),))
    assert set(load_measured(study, plugins.channels)) == {"p1", "p2"}


def test_a_channel_that_nobody_declares_is_refused(make_study, plugins):
    with pytest.raises(CurveError, match=r"p1\.csv: spot 'p1': channel 'force' is declared by no plugin"):
        load_measured(make_study(), {})


def test_one_channel_in_two_files_is_refused(make_study, plugins):
    study = make_study()
    spot = study.spots[0]
    twice = replace(spot, measured={None: spot.measured[None], "force": spot.measured[None]})
    with pytest.raises(CurveError, match="channel 'force' of spot 'p1' is already read"):
        load_measured(replace(study, spots=(twice,)), plugins.channels)


def test_a_file_that_does_not_cover_the_protocol_is_named(make_study, plugins):
    deeper = replace(PROTOCOL, path=[(0, 0), (12, 0), (12, -22.5), (12, 22.5), (12, 0)])
    with pytest.raises(CurveError, match=r"p1\.csv: spot 'p1': channel 'force' covers 0 to 10 mm"):
        load_measured(make_study(protocol=deeper), plugins.channels)


def test_the_whole_path_is_covered(plugins):
    check_covers(force([0.05, 5.0, 9.95]), plugins.channels["force"], PROTOCOL, 0.95)
    check_covers(torque(TWIST), plugins.channels["torque"], PROTOCOL, 0.95)


@pytest.mark.parametrize(
    ("curve", "says"),
    [
        (force([0.0, 9.0]), r"covers 0 to 9 mm where the protocol runs from 0 to 10 mm; measure"),
        (force([1.0, 10.0]), r"covers 1 to 10 mm"),
        (torque([0.0, -22.5, 0.0]), r"covers -22.5 to 0 degrees where the protocol runs from -22.5 to 22.5"),
        (force([0.0, 5.0, 10.0, 20.0]), r"covers 0 to 20 mm .*; cut the curve or extend"),
        (
            torque([0.0, -10.0, -9.0, -22.5, 22.5, 0.0]),
            r"turns 4 times where the protocol turns 2 times \(first at row 3, -22.5 degrees\); smooth",
        ),
    ],
)
def test_a_departure_from_the_protocol_says_what_is_covered(plugins, curve, says):
    with pytest.raises(CurveError, match=says):
        check_covers(curve, plugins.channels[curve.channel], PROTOCOL, 0.95)


def test_a_twist_that_the_protocol_never_makes_is_refused(plugins):
    press = replace(PROTOCOL, path=[(0, 0), (10, 0)])
    with pytest.raises(CurveError, match="over rotation_deg, which the protocol never moves"):
        check_covers(torque(TWIST), plugins.channels["torque"], press)


def test_other_abscissae_are_not_the_protocols_business(plugins):
    strain = replace(plugins.channels["force"], abscissa="strain")
    check_covers(force([0.0, 0.1]), strain, PROTOCOL, 0.95)


def test_a_loader_that_returns_no_curves_is_named(make_study, plugins, tissue):
    class Empty(tissue.Table):
        def load(self, path, channel=None):
            return None

    with pytest.raises(
        PluginError, match=r"reading .*p1\.csv: 'table' .* returned a NoneType and not a Response"
    ):
        load_measured(make_study(loader=Empty()), plugins.channels)
