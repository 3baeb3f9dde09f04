"""Moves: the rows that they make, and what is refused."""

import numpy as np
import pytest
from pydantic import ValidationError

from palpate.api import StudyError
from palpate.testing import MotionContract
from palpate_indentation import Moves, MovesSettings

SOAK = [{"twist": "-5 deg"}, {"twist": "5 deg"}]


def moves(*given, **settings):
    return Moves(MovesSettings(moves=given, **settings))


class TestMoves(MotionContract):
    @pytest.fixture
    def motion(self):
        return moves(
            {"force": "10 N"},
            {"twist": "45 deg", "force": "10 N"},
            {"repeat": 2, "moves": SOAK},
            {"depth": "-1 mm"},
            depth_limit="12 mm",
        )


def test_what_a_move_does_not_name_stays():
    made = moves({"depth": "4 mm"}, {"slide": ["2 mm", "-1 mm"]}, {"tilt": ["3 deg", "0 deg"]}).waypoints()
    assert made.pose.tolist() == [
        [0, 0, 0, 0, 0, 0],
        [4, 0, 0, 0, 0, 0],
        [4, 2, -1, 0, 0, 0],
        [4, 2, -1, 3, 0, 0],
    ]
    assert np.isnan(made.loads).all()
    assert made.time_s is None


def test_a_motion_has_times_where_each_move_has_a_duration():
    press, rest = {"depth": "4 mm", "duration": "500 ms"}, {"repeat": 2, "moves": [{"duration": "3 s"}]}
    assert moves(press, rest).waypoints().time_s.tolist() == [0, 0.5, 3.5, 6.5]
    assert moves({"depth": "4 mm"}).waypoints().time_s is None
    with pytest.raises(StudyError, match="move 4 of 4 has no duration, and others have one"):
        moves(press, rest, {"depth": "0 mm"})


def test_a_force_is_reached_then_held_or_left():
    made = moves(
        {"force": "10 N"}, {"twist": "9 deg", "force": "10 N"}, {"twist": "0 deg"}, {"depth": "0 mm"},
        depth_limit="12 mm",
    ).waypoints()  # fmt: skip
    assert made.pose[:, 0].tolist() == [0, 12, 12, 12, 0]
    assert made.loads[1:, 0].tolist()[:3] == [10, 10, np.inf]
    assert np.isnan(made.loads[4, 0])


def test_pairs_of_forces_move_both_directions():
    made = moves(
        {"depth": "3 mm"}, {"slide_force": ["1 N", "0 N"]}, {"torque": "-5 N*mm"},
        slide_limit="4 mm", twist_limit="90 deg",
    ).waypoints()  # fmt: skip
    assert made.loads[2, 1:3].tolist() == [1, 0]
    assert made.pose[2, 1:3].tolist() == [4, 4]
    assert np.isinf(made.loads[3, 1:3]).all()
    assert made.loads[3, 5] == -5


def test_repeated_moves_are_made_again_and_again():
    made = moves({"depth": "3 mm"}, {"repeat": 2, "moves": [{"repeat": 2, "moves": SOAK}]}).waypoints()
    assert made.pose[2:, 5].tolist() == [-5, 5] * 4


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"depth": "3 mm", "force": "1 N"}, "both depth and force"),
        ({"repeat": 2}, "nothing to repeat"),
        ({"twist": "1 deg", "moves": SOAK}, "'twist' next to moves"),
        ({"force": "1 mm"}, "not of the kind of N"),
        ({"slide": ["1 mm"]}, "Field required"),
        ({"depht": "3 mm"}, "Extra inputs"),
    ],
)
def test_a_move_that_cannot_be_is_refused(given, reason):
    with pytest.raises(ValidationError, match=reason):
        moves(given)


@pytest.mark.parametrize("load", ["force", "torque"])
def test_a_load_needs_a_limit(load):
    unit = "N" if load == "force" else "N*mm"
    with pytest.raises(StudyError, match=f"'{load}' may move the indenter any far; add .*_limit"):
        moves({load: f"1 {unit}"})


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ([{"tilt": ["25 deg", "20 deg"]}], "'tilt' tilts by 25° about x and 20° about y, 32° in all"),
        ([{"tilt_moment": ["1 N*mm", "0 N*mm"]}], "'tilt_limit' tilts by 25° about x and 25° about y, 35.4°"),
    ],
)
def test_a_tilt_that_is_too_large_is_named_by_its_key(given, reason):
    with pytest.raises(StudyError, match=reason):
        moves({"depth": "2 mm"}, *given, tilt_limit="25 deg")


def test_too_many_moves_are_refused():
    with pytest.raises(StudyError, match="more than 1000 moves"):
        moves({"repeat": 1000, "moves": SOAK})
