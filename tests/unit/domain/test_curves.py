"""A curve may have standard deviations and times, also on disk."""

import numpy as np
import pytest

from palpate.domain import Curve, Relaxation, Response
from palpate.errors import CurveError
from palpate.run.result_files import frame_of, response_of

X = [0.0, 1.0, 2.0]


def curve(channel="force", std=None, time_s=None):
    return Curve(channel=channel, abscissa=X, ordinate=[0.0, 2.0, 5.0], std=std, time_s=time_s)


def test_a_standard_deviation_is_kept_read_only():
    given = np.array([0.1, 0.0, 0.3])
    made = curve(std=given)
    given[0] = 9.0
    np.testing.assert_array_equal(made.std, [0.1, 0.0, 0.3])
    with pytest.raises(ValueError, match="read-only"):
        made.std[0] = 1.0


@pytest.mark.parametrize(
    ("std", "message"),
    [
        ([0.1, 0.2], r"curve 'force': \(2,\) standard deviations for \(3,\) points; give one for each"),
        ([0.1, -0.2, 0.1], r"curve 'force': std\[1\] is -0.2; a standard deviation is finite and not neg"),
        ([0.1, 0.2, np.nan], r"std\[2\] is nan"),
    ],
)
def test_a_standard_deviation_that_is_none_is_refused(std, message):
    with pytest.raises(CurveError, match=message):
        curve(std=std)


@pytest.mark.parametrize(
    ("time_s", "message"),
    [
        ([0.0, 1.0], r"curve 'force': \(2,\) times for \(3,\) points; give one for each point, or none"),
        ([0.0, 1.0, 0.9], r"curve 'force': time_s\[2\] is 0.9; a time is finite and never before"),
        ([0.0, np.inf, 2.0], r"time_s\[1\] is inf"),
    ],
)
def test_times_that_are_none_are_refused(time_s, message):
    with pytest.raises(CurveError, match=message):
        curve(time_s=time_s)


def test_a_table_holds_the_times_of_the_curves_that_have_them():
    response = Response(curves={"force": curve(time_s=[3.0, 3.0, 4.5]), "torque": curve("torque")})
    frame = frame_of(response)
    assert frame.columns == ["channel", "point", "abscissa", "ordinate", "time_s"]
    found = response_of(frame)
    assert found["force"].time_s.tolist() == [3.0, 3.0, 4.5]
    assert found["torque"].time_s is None
    with pytest.raises(ValueError, match="read-only"):
        found["force"].time_s[0] = 1.0


def test_a_part_of_a_curve_keeps_what_belongs_to_its_points():
    part = curve(std=[0.1, 0.2, 0.3], time_s=[0.0, 1.0, 3.0]).cut(slice(1, 3))
    assert part.time_s.tolist() == [1.0, 3.0]
    assert (part.channel, part.abscissa.tolist(), part.ordinate.tolist(), part.std.tolist()) == (
        "force", [1.0, 2.0], [2.0, 5.0], [0.2, 0.3],
    )  # fmt: skip
    assert curve().cut(slice(0, 2)).std is None


@pytest.mark.parametrize("torque_std", [None, [0.0, 0.5, 1.0]])
def test_a_table_holds_each_curves_standard_deviation_or_that_there_is_none(torque_std):
    response = Response(curves={"force": curve(std=[0.1, 0.2, 0.3]), "torque": curve("torque", torque_std)})
    found = response_of(frame_of(response))
    assert found["force"].std.tolist() == [0.1, 0.2, 0.3]
    assert (found["torque"].std is None) if torque_std is None else found["torque"].std.tolist() == torque_std


def rest(**changes):
    given = {
        "channel": "force",
        "phase": "dwell",
        "duration_s": 1.0,
        "start_value": -8.0,
        "fall": 0.4,
        "fall_std": 0.1,
    }
    return Relaxation(**(given | changes))


def test_a_relaxation_is_a_share_of_what_was_there_and_significant_beyond_three_deviations():
    assert rest().share == 0.05
    assert type(rest(fall=np.float64(0.4)).fall) is float
    assert rest(start_value=0.0).share == 0.0
    assert [rest(fall=fall).is_significant for fall in (0.29, 0.31, -0.31)] == [False, True, True]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fall": np.nan}, r"relaxation of 'force' in 'dwell': fall is nan; give a finite number"),
        ({"fall_std": -0.1}, r"fall_std is -0.1; a standard deviation is not negative"),
        ({"duration_s": 0.0}, r"duration_s is 0.0; a rest lasts longer than 0 s"),
    ],
)
def test_a_relaxation_that_is_none_is_refused(changes, message):
    with pytest.raises(CurveError, match=message):
        rest(**changes)


def test_a_table_of_curves_without_one_has_no_column_for_it():
    frame = frame_of(Response(curves={"force": curve()}))
    assert frame.columns == ["channel", "point", "abscissa", "ordinate"]
    assert response_of(frame)["force"].std is None
