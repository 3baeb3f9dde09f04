"""A fall of a channel while the indenter rests is compared with what the budget allows."""

import pytest

from palpate.domain import Curve, Relaxation, Response
from palpate.experiment.relaxation import relaxation_of
from palpate.study.model import BudgetTable


def rest(fall, *, std=0.01, channel="force", start=10.0, duration_s=1.0):
    return Relaxation(
        channel=channel, phase="dwell_1", duration_s=duration_s, start_value=start, fall=fall, fall_std=std
    )


def measured(*rests, spot="p1", peak=10.0):
    curves = {
        name: Curve(channel=name, abscissa=[0.0, 1.0], ordinate=[0.0, peak]) for name in ("force", "torque")
    }
    return {spot: Response(curves=curves, relaxations=rests)}


@pytest.mark.parametrize(
    ("gain", "fall", "std", "is_beyond"),
    [
        (0.01, 0.21, 0.01, True),
        (0.01, 0.19, 0.01, False),
        (0.01, -0.5, 0.01, False),  # a rise is no relaxation
        (0.01, 0.5, 0.2, False),  # noise makes it
        (0.02, 0.39, 0.01, False),
        (0.02, 0.41, 0.01, True),
        (0.0, 0.02, 0.01, False),
        (0.0, 0.04, 0.01, True),
        (0.0, 0.0, 0.0, False),
    ],
)
def test_a_fall_beyond_twice_the_gain_and_beyond_noise_is_too_much(gain, fall, std, is_beyond):
    assert relaxation_of(measured(rest(fall, std=std)), gain).is_beyond is is_beyond


def test_five_percent_are_too_much_by_the_default_budget():
    assert relaxation_of(measured(rest(0.5)), BudgetTable().gain).is_beyond


def test_the_sentence_has_the_largest_fall_its_time_and_of_several_spots_the_place():
    one = measured(rest(0.5), rest(1.2), rest(0.9))
    words = "relaxed by 12 % in 1 s; these are apparent moduli of this rate"
    assert relaxation_of(one, 0.01).sentence == f"the tissue {words}"
    two = measured(rest(0.5, duration_s=30.0), spot="p0") | one
    assert relaxation_of(two, 0.01).sentence == f"the tissue at p1 {words}"


def test_a_large_fall_within_noise_hides_no_smaller_one_beyond_it():
    assert relaxation_of(measured(rest(2.0, std=1.0), rest(0.5)), 0.01).share == pytest.approx(0.05)


def test_a_fall_of_the_little_that_is_left_after_a_twist_is_a_share_of_the_peak():
    found = relaxation_of(measured(rest(0.1, channel="torque", start=0.2)), 0.01)
    assert found.share == pytest.approx(0.01)
    assert not found.is_beyond


def test_without_a_rest_nothing_is_known():
    assert relaxation_of(measured(), 0.01) is None


def test_noise_makes_a_fall_as_often_as_its_probability():
    assert relaxation_of(measured(rest(0.0)), 0.01).probability == pytest.approx(0.5)
    assert relaxation_of(measured(rest(0.02)), 0.01).probability == pytest.approx(0.0228, abs=1e-4)
    assert relaxation_of(measured(rest(0.5, std=0.0)), 0.01).probability == 0.0
