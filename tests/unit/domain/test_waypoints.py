"""Waypoints of a motion, and the indentation along them."""

import numpy as np
import pytest

from palpate.domain import Indentation, Waypoints
from palpate.domain.indenter import Sphere
from palpate.errors import StudyError

POSE = np.array([[0.0] * 6, [3.0, 0, 0, 0, 0, 0], [3.0, 1.0, 0, 0, 2.0, 10.0]])
NO_LOADS = np.full((3, 6), np.nan)
PRESS = {"indenter": Sphere(radius_mm=5.0), "friction": 0.5}


def loads(*rows):
    found = NO_LOADS.copy()
    for row, column, value in rows:
        found[row, column] = value
    return found


def test_an_indentation_moves_along_its_waypoints():
    times = np.array([0.0, 1.0, 5.0])
    given = Waypoints(pose=POSE, loads=loads((1, 0, 4.0), (2, 0, np.inf)), time_s=times)
    press = Indentation.along(given, **PRESS)
    assert press.path.tolist() == [[0, 0], [3, 0], [3, 10]]
    assert press.waypoints.is_same(given)
    assert press.moves == ("depth", "rotation", "shift", "tilt", "load")


def test_a_press_and_twist_has_no_more_than_its_path():
    pose = np.array([[0.0] * 6, [3.0, 0, 0, 0, 0, 0], [3.0, 0, 0, 0, 0, -9.0]])
    press = Indentation.along(Waypoints(pose=pose, loads=NO_LOADS), **PRESS)
    assert (press.lateral, press.loads, press.time_s) == (None, None, None)
    assert press.moves == ("depth", "rotation")


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"pose": POSE[:, :2]}, "six components"),
        ({"pose": POSE[:1]}, "at least two"),
        ({"pose": POSE + 1.0}, "starts at"),
        ({"pose": 20.0 * POSE}, "tilts by 30"),
        ({"pose": POSE, "loads": NO_LOADS[:2]}, "shape of its poses"),
        ({"pose": POSE, "loads": loads((0, 0, 1.0))}, "none at rest"),
        ({"pose": POSE, "loads": loads((1, 0, np.inf))}, "stays only where a load"),
        ({"pose": POSE, "loads": loads((1, 5, 1.0))}, "farthest place"),
        ({"pose": POSE, "time_s": [0.0, 1.0, 1.0]}, "grow from row to row"),
        ({"pose": POSE, "time_s": [1.0, 2.0, 3.0]}, "start at 0"),
    ],
)
def test_a_motion_that_cannot_be_is_refused(given, reason):
    with pytest.raises(StudyError, match=reason):
        Waypoints(**given)


def test_shifts_need_a_row_for_each_waypoint():
    with pytest.raises(StudyError, match="give four a row"):
        Indentation(path=[(0, 0), (1, 0)], lateral=np.zeros((3, 4)), **PRESS)
    with pytest.raises(StudyError, match="outside the limb"):
        Indentation(path=[(0, 0), (-1, 0)], **PRESS)
