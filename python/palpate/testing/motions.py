"""Laws of motions."""

import numpy as np
import pytest

from palpate.domain.component import Component
from palpate.domain.waypoints import DEPTH, MOST_WAYPOINTS, Waypoints
from palpate.plugins.motion import Motion
from palpate.testing.components import ComponentContract, missing


class MotionContract(ComponentContract):
    """Laws of a motion; override ``motion``."""

    @pytest.fixture
    def motion(self) -> Motion:
        """Provide the motion under test."""
        missing("motion", type(self).__name__)

    @pytest.fixture
    def component(self, motion: Motion) -> Component:
        """Provide the motion."""
        return motion

    def test_it_gives_waypoints(self, motion: Motion) -> None:
        made = motion.waypoints()
        assert isinstance(made, Waypoints), f"waypoints() gives a {type(made).__name__}, not Waypoints"
        assert len(made.pose) <= MOST_WAYPOINTS + 1, f"more than {MOST_WAYPOINTS} waypoints"

    def test_it_presses(self, motion: Motion) -> None:
        depths = motion.waypoints().pose[:, DEPTH]
        assert depths.max() > 0.0, "it never goes into the limb: depths are positive there, in mm"
        assert depths.max() < 1000.0, f"a depth of {depths.max():g} mm: depths are in mm"

    def test_equal_settings_are_one_motion(self, motion: Motion) -> None:
        once, again = motion.waypoints(), type(motion)(motion.settings.model_copy()).waypoints()
        assert once.is_same(motion.waypoints()), "waypoints() differ from call to call"
        assert once.is_same(again), "equal settings give another motion"

    def test_no_row_is_there_twice(self, motion: Motion) -> None:
        made = motion.waypoints()
        if made.time_s is not None or made.loads is not None:
            return
        still = np.flatnonzero(~np.diff(made.pose, axis=0).any(axis=1))
        assert not still.size, f"row {still[0] + 1} repeats the one before it; a hold needs times"
