"""Where load stepping balances: steps are no longer than the settings allow, also after and under loads."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.api import MeshError
from palpate.domain import Indentation
from palpate.domain.indenter import Sphere
from palpate.mesh.specimens import block
from palpate_indentation import Moves, MovesSettings
from palpate_jax.footprint import check_footprint
from palpate_jax.schedule import schedule

LIMITS = {"depth_limit": "4 mm", "slide_limit": "3 mm", "tilt_limit": "20 deg", "twist_limit": "60 deg"}
HALVES = st.integers(-6, 6).map(lambda number: 0.5 * number)


def along(*moves, **limits):
    made = Moves(MovesSettings(moves=moves, **LIMITS | limits)).waypoints()
    return Indentation.along(made, indenter=Sphere(radius_mm=7.5), friction=0.4)


def targets(*moves):
    """Four steps to a depth of 4 mm."""
    return schedule(along({"depth": "4 mm"}, *moves), depth_steps=4, rotation_step_deg=6.0).targets[4:]


@given(HALVES, st.floats(-1.0, 1.0))
def test_steps_after_a_load_are_short_from_wherever_it_left_the_indenter(end, share):
    pushed = {"slide_force": ["0.03 N", "0 N"]}
    at, lengths = np.array([4.0, 3.0 * share, -3.0 * share, 0.0, 0.0, 0.0]), []
    for target in targets(pushed, {"slide": [f"{end} mm", "1 mm"]})[4:]:
        before, at = at, target.position(at)
        lengths.append(np.abs(at - before).max())
    assert at[1] == end
    assert max(lengths) <= 1.0 + 1e-12


def test_a_depth_after_a_force_takes_no_more_steps_than_its_limit_is_deep():
    assert len(targets({"force": "1 N"}, {"depth": "0 mm"})[4:]) == 4
    assert len(targets({"force": "1 N"}, {"depth": "2 mm"})[4:]) == 2


@pytest.mark.parametrize(
    ("moves", "n"),
    [
        ([{"twist": "6 deg"}, {"torque": "0 N*mm"}], [1, 4]),
        ([{"force": "1 N"}, {"torque": "2 N*mm"}, {"force": "0.5 N"}], [4, 4, 4]),
        ([{"force": "1 N"}, {"force": "0.5 N"}, {"force": "0.5 N", "twist": "6 deg"}], [4, 2, 1]),
    ],
)
def test_a_load_that_was_not_prescribed_before_takes_all_steps(moves, n):
    assert len(targets(*moves)) == sum(n)


@given(st.floats(0.0, 12.0))
def test_a_limit_of_a_slide_reaches_as_far_as_it_says(limit):
    """As a slide to that place does, about: neither less nor twice as far."""
    limb = block("hex8", n_across=8, n_down=3, width_mm=30.0, height_mm=10.0, grading=1.4)

    def is_refused(*moves, **limits):
        try:
            check_footprint(limb, along({"depth": "2 mm"}, *moves, **limits))
        except MeshError:
            return True
        return False

    most = max(limit, 0.1)
    found = is_refused({"slide_force": ["0.01 N", "0 N"]}, slide_limit=f"{most} mm")
    assert found or not is_refused({"slide": [f"{most} mm", f"{most} mm"]})
    assert not found or is_refused({"slide": [f"{1.5 * most} mm", "0 mm"]})
