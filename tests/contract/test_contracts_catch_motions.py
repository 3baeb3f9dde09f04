"""Each law of motions fails on what breaks it, with the reason; press and twist keeps them all."""

import itertools

import numpy as np
import pytest

from palpate.domain import Waypoints
from palpate.plugins.motion import PressAndTwist, PressAndTwistSettings
from palpate.testing import MotionContract

SETTINGS = PressAndTwistSettings(depth="5 mm", twist=["-20 deg", "20 deg", "0 deg"])


class TestPressAndTwist(MotionContract):
    @pytest.fixture
    def motion(self):
        return PressAndTwist(SETTINGS)


class Bare(PressAndTwist):
    def waypoints(self):
        return super().waypoints().pose


class Lifted(PressAndTwist):
    def waypoints(self):
        return Waypoints(pose=-super().waypoints().pose)


class InMetres(PressAndTwist):
    def waypoints(self):
        return Waypoints(pose=1e3 * super().waypoints().pose)


class Counting(PressAndTwist):
    numbers = itertools.count(1)

    def waypoints(self):
        return Waypoints(pose=next(self.numbers) * super().waypoints().pose)


class Stuck(PressAndTwist):
    def waypoints(self):
        return Waypoints(pose=np.repeat(super().waypoints().pose, 2, axis=0))


@pytest.mark.parametrize(
    ("law", "faulty", "reason"),
    [
        ("test_it_gives_waypoints", Bare, "gives a ndarray"),
        ("test_it_presses", Lifted, "never goes into the limb"),
        ("test_it_presses", InMetres, "depths are in mm"),
        ("test_equal_settings_are_one_motion", Counting, "differ from call to call"),
        ("test_no_row_is_there_twice", Stuck, "row 1 repeats"),
    ],
)
def test_a_law_catches_what_breaks_it(law, faulty, reason):
    with pytest.raises(AssertionError, match=reason):
        getattr(MotionContract(), law)(faulty(SETTINGS))
