"""Measured curves must be there and follow the protocol."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import Curve, Indentation, Response, Scenario
from palpate.domain.indenter import Sphere
from palpate.errors import CurveError, PluginError
from palpate.experiment.measured import check_covers, load_measured, measured_warnings

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
    with pytest.raises(CurveError, match=r"study.toml: .*no spot has a channel 'lateral'.*scenario 'V'"):
        load_measured(study, plugins.channels)


def test_a_spot_may_lack_a_channel_that_another_has(make_study, plugins):
    study = make_study()
    (file,) = study.spots[1].files
    file.write_text("".join(row for row in file.read_text().splitlines(True) if "torque" not in row))
    measured = load_measured(study, plugins.channels)
    assert (list(measured["p1"]), list(measured["p2"])) == (["force", "torque"], ["force"])
    assert measured_warnings(measured) == (
        "spot 'p2' has no channel 'torque': 'I' weighs force there",
        "spot 'p2' has no channel 'torque': 'II' weighs nothing there",
    )


def test_a_channel_without_weight_may_be_missing(make_study, plugins):
    study = make_study(scenarios=(Scenario(name="III", weights={"force": 1.0, "lateral": 0.0}),))
    assert set(load_measured(study, plugins.channels)) == {"p1", "p2"}


def test_an_undeclared_channel_is_refused(make_study, plugins):
    with pytest.raises(
        CurveError, match=r"p1\.csv: spot 'p1': channel 'force' is not declared by any plugin"
    ):
        load_measured(make_study(), {})


def test_one_channel_in_two_files_is_refused(make_study, plugins):
    study = make_study()
    spot = study.spots[0]
    twice = replace(spot, measured={None: spot.measured[None], "force": spot.measured[None]})
    with pytest.raises(CurveError, match="channel 'force' of spot 'p1' is already read"):
        load_measured(replace(study, spots=(twice,)), plugins.channels)


def test_one_file_may_be_named_for_each_of_three_channels(make_study, plugins, tissue):
    class OfChannel(tissue.Table):
        def load(self, path, channel=None):
            curves = dict(super().load(path).curves)
            curves["lateral"] = replace(curves["force"], channel="lateral")
            return Response(curves={channel: curves[channel]})

    study, names = make_study(loader=OfChannel()), ("force", "torque", "lateral")
    spot = study.spots[0]
    thrice = replace(spot, measured=dict.fromkeys(names, spot.measured[None]))
    channels = {**plugins.channels, "lateral": replace(plugins.channels["force"], name="lateral")}
    assert tuple(load_measured(replace(study, spots=(thrice,)), channels)["p1"]) == names


def scaled(path, factor, drop=""):
    """Copy of a file of curves with its ordinates times a factor, without one channel."""
    rows = [row.split(",") for row in path.read_text().splitlines()]
    copy = path.with_stem(f"{path.stem}_{factor:g}{drop}")
    copy.write_text("".join(f"{c},{x},{float(y) * factor!r}\n" for c, x, y in rows if c != drop))
    return copy


def pressed_again(study, *files):
    spot = study.spots[0]
    return replace(study, spots=(replace(spot, measured={None: (*spot.measured[None], *files)}),))


def test_repeated_presses_become_their_mean_with_a_band(make_study, plugins):
    study = make_study()
    (path,) = study.spots[0].measured[None]
    once = load_measured(study, plugins.channels)["p1"]
    again = pressed_again(study, scaled(path, 1.1), scaled(path, 1.2))
    found = load_measured(again, plugins.channels)["p1"]
    for channel in ("force", "torque"):
        np.testing.assert_array_equal(found[channel].abscissa, once[channel].abscissa)
        np.testing.assert_allclose(found[channel].ordinate, 1.1 * once[channel].ordinate, rtol=1e-12)
        assert found[channel].std is not None
    assert once["force"].std is None
    stated = found.record["averages"]["force"]
    assert stated["n_presses"] == 3
    # 0.1/1.1 of the curve, whose mean square over its squared mean is what is left.
    y = once["force"].ordinate
    expected = (0.1 / 1.1) ** 2 * np.mean(y**2) / np.mean(np.abs(y)) ** 2
    np.testing.assert_allclose(list(stated["nmse_from_mean"].values()), [expected, 0.0, expected], atol=1e-15)
    assert list(stated["nmse_from_mean"]) == ["p1.csv", "p1_1.1.csv", "p1_1.2.csv"]


def test_a_repeat_that_lacks_a_channel_is_named(make_study, plugins):
    study = make_study()
    (path,) = study.spots[0].measured[None]
    with pytest.raises(
        CurveError, match=r"p1_1torque\.csv: .*has channels force, .* measure 'torque' in each"
    ):
        load_measured(pressed_again(study, scaled(path, 1.0, drop="torque")), plugins.channels)


def test_a_press_that_is_listed_twice_is_named(make_study, plugins):
    study = make_study()
    (path,) = study.spots[0].measured[None]
    for again in (path, scaled(path, 1.0)):  # the same file, and a copy
        with pytest.raises(CurveError, match=r"it has the numbers of p1\.csv and would count twice"):
            load_measured(pressed_again(study, again), plugins.channels)


def test_each_spot_may_have_another_protocol_and_loader(make_study, plugins, tissue):
    class Doubling(tissue.Table):
        def load(self, path, channel=None):
            curves = super().load(path, channel).curves
            return Response(
                curves={n: replace(c, ordinate=2.0 * c.ordinate) for n, c in curves.items()},
                record={"factor": 2.0},
            )

    study = make_study()
    one, two = study.spots
    usual = load_measured(study, plugins.channels)
    found = load_measured(replace(study, spots=(one, replace(two, loader=Doubling()))), plugins.channels)
    np.testing.assert_array_equal(found["p1"]["force"].ordinate, usual["p1"]["force"].ordinate)
    np.testing.assert_array_equal(found["p2"]["force"].ordinate, 2.0 * usual["p2"]["force"].ordinate)
    assert found["p2"].record == {"files": {"p2.csv": {"factor": 2.0}}}
    assert not found["p1"].record
    deeper = replace(PROTOCOL, path=[(0, 0), (12, 0), (12, -22.5), (12, 22.5), (12, 0)])
    with pytest.raises(CurveError, match=r"p2\.csv: spot 'p2': channel 'force' covers 0 to 10 mm"):
        load_measured(replace(study, spots=(one, replace(two, protocol=deeper))), plugins.channels)


def test_a_file_that_does_not_cover_the_protocol_is_named(make_study, plugins):
    deeper = replace(PROTOCOL, path=[(0, 0), (12, 0), (12, -22.5), (12, 22.5), (12, 0)])
    with pytest.raises(CurveError, match=r"p1\.csv: spot 'p1': channel 'force' covers 0 to 10 mm"):
        load_measured(make_study(protocol=deeper), plugins.channels)


@pytest.mark.parametrize(("depth_mm", "is_named"), [(10.0, False), (9.85, False), (9.6, True)])
def test_a_twisted_press_that_goes_deeper_than_the_protocol_is_named(make_study, plugins, depth_mm, is_named):
    path = [(0, 0), *((depth_mm, turn) for turn in (0, -22.5, 22.5, 0))]
    measured = load_measured(make_study(protocol=replace(PROTOCOL, path=path)), plugins.channels)
    text = (
        f"the curve goes 10 mm deep and [protocol] says {depth_mm:g} mm: "
        'write depth = "10 mm" there, since the twist is simulated at that depth'
    )
    assert any(text in warning for warning in measured_warnings(measured)) == is_named


def test_the_whole_path_is_covered(plugins):
    check_covers(force([0.05, 5.0, 9.95]), plugins.channels["force"], PROTOCOL, 0.95)
    check_covers(torque(TWIST), plugins.channels["torque"], PROTOCOL, 0.95)


@pytest.mark.parametrize(
    ("curve", "message"),
    [
        (force([0.0, 9.0]), r"covers 0 to 9 mm where .*; the curve .*: write depth = \"9 mm\" there"),
        (force([1.0, 10.0]), r"covers 1 to 10 mm"),
        (torque([0.0, -22.5, 0.0]), r"covers -22.5 to 0 degrees where the protocol runs from -22.5 to 22.5"),
        (force([0.0, 5.0, 10.0, 20.0]), r"covers 0 to 20 mm .*; the curve .*: write depth = \"20 mm\" there"),
        (force([0.0, 7.0, 10.0, 12.0, 15.47]), r"15\.5 mm deep and \[protocol\] says 10 mm: .* \"15\.5 mm\""),
        (force([0.0, 0.2, 0.33]), r"write depth = \"0\.33 mm\" there"),
        (torque([0.0, -45.0, -40.0, 45.0, 0.0]), r"cut the curve or extend"),
        (
            torque([0.0, -10.0, -9.0, -22.5, 22.5, 0.0]),
            r"turns 4 times where the protocol turns 2 times \(first at row 3, -22.5 degrees\); put its rows",
        ),
        (
            force([0.0, 5.0, 10.0, 5.0, 0.0]),
            r'goes to 10 mm and has a way back.*rows = "loading" in channels',
        ),
        (force([0.0, 5.0, 10.0, 10.0, 10.0, 0.0]), r"goes to 10 mm and has a way back"),
        (force([0.0, 5.0, 0.0, 8.0, 0.0, 10.0]), r"goes to 10 mm and has a way back"),
        (force([0.0, 5.0, 4.0, 10.0]), r"turns 2 times .*, or smooth its abscissa"),
        (force([0.0, 0.5, 0.25, 0.75, 10.0]), r"turns 2 times .*; put its rows in order, or smooth"),
        (force([0.0, -5.0, -10.0]), r"the other sign: .*set scale = -1 in channels\.force\.abscissa of"),
        (
            force([50.0, 45.0, 40.0]),
            r"begins at 50 and falls: .*set scale = -1, offset = 50 in channels\.force",
        ),
        (
            force([40.0, 45.0, 50.0]),
            r"begins at 40 and rises: .*set offset = -40 in channels\.force\.abscissa",
        ),
        (
            Curve(channel="force", abscissa=[-0.0, -5.0, -10.0], ordinate=[-0.0, -1.0, -4.0]),
            r"abscissa of \[experiment\.settings\] and scale = -1 in its ordinate",
        ),
        (
            Curve(channel="force", abscissa=[3.0, 8.0, 13.0], ordinate=[3.0, 4.0, 8.0]),
            r"covers 3 to 13 mm .*; measure the whole path",
        ),
    ],
)
def test_a_departure_from_the_protocol_reports_what_is_covered(plugins, curve, message):
    with pytest.raises(CurveError, match=message):
        check_covers(curve, plugins.channels[curve.channel], PROTOCOL, 0.95)


def test_a_twist_that_the_protocol_never_makes_is_refused(plugins):
    press = replace(PROTOCOL, path=[(0, 0), (10, 0)])
    with pytest.raises(CurveError, match="over rotation_deg, which the protocol does not move"):
        check_covers(torque(TWIST), plugins.channels["torque"], press)


HELD = replace(PROTOCOL, path=[(0, 0), (10, 0), (10, 0), (10, 20)], time_s=np.array([0.0, 1.0, 31.0, 33.0]))


def check_over_time(times, plugins):
    curve = Curve(channel="force_over_time", abscissa=np.array(times), ordinate=np.ones(len(times)))
    channel = replace(plugins.channels["force"], abscissa="time_s", abscissa_label="time (s)")
    check_covers(curve, channel, HELD, 0.95)


@pytest.mark.parametrize("end_s", [0.99, 31.2, 32.9])
def test_a_curve_over_time_may_end_with_any_move(plugins, end_s):
    check_over_time([0.0, 0.5, end_s], plugins)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.0, 20.0], "covers 0 to 20 s where the protocol runs from 0 to 31 s; measure"),
        ([2.0, 31.0], "covers 2 to 31 s where the protocol runs from 0 to 31 s; measure"),
        ([0.0, 33.0, 60.0], "covers 0 to 60 s where the protocol runs from 0 to 33 s; cut"),
        ([0.0, 33000.0], "covers 0 to 33000 s where the protocol runs from 0 to 33 s, .* were in ms"),
    ],
)
def test_a_curve_over_time_ends_nowhere_else(plugins, times, message):
    with pytest.raises(CurveError, match=message):
        check_over_time(times, plugins)


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
