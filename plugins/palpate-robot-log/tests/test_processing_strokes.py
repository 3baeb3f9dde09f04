"""Strokes of synthetic motions: found with their dwells, for any speed profile."""

import numpy as np
import pytest

from palpate_robot_log.processing.change_points import speed_change
from palpate_robot_log.processing.strokes import strokes_of

TIME = np.arange(0.0, 40.0, 0.005)


def cosine(share):
    return (1.0 - np.cos(np.pi * share)) / 2.0


def minimum_jerk(share):
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def trapezoid(share, ramp=0.1):
    """Constant speed between constant accelerations of a tenth of the stroke."""
    fast = (share - ramp / 2.0) / (1.0 - ramp)
    slow, end = share**2, (1.0 - share) ** 2
    scale = 2.0 * ramp * (1.0 - ramp)
    return np.where(share < ramp, slow / scale, np.where(share > 1.0 - ramp, 1.0 - end / scale, fast))


PROFILES = {"line": lambda share: share, "cosine": cosine, "jerk": minimum_jerk, "trapezoid": trapezoid}


def path(marks, values, profile):
    """Values over TIME that go from mark to mark by a profile, and rest where they stay."""
    found = np.full(TIME.shape, float(values[-1]))
    for start, stop, low, high in zip(marks, marks[1:], values, values[1:], strict=False):
        inside = (start <= TIME) & (stop > TIME)
        share = (TIME[inside] - start) / (stop - start) if stop > start else 0.0
        found[inside] = low + (high - low) * profile(share)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("noise_deg", [1e-4, 0.01])
@pytest.mark.parametrize("dwell_s", [0.3, 1.0])
@pytest.mark.parametrize("profile", PROFILES)
def test_starts_and_stops_are_found_within_20_ms(profile, dwell_s, noise_deg):
    marks = np.cumsum([0.0, 2.0, 6.0, dwell_s, 12.0, dwell_s, 6.0, 2.0])
    values = [0.0, 0.0, -22.5, -22.5, 22.5, 22.5, 0.0, 0.0]
    turn = path(marks, values, PROFILES[profile])
    turn += np.random.default_rng(1).normal(0.0, noise_deg, turn.size)
    rows = marks[-1] > TIME
    strokes = strokes_of(TIME[rows], turn[rows], 1.0)
    found = [instant.time_s for stroke in strokes for instant in (stroke.start, stroke.stop)]
    assert found == pytest.approx(marks[1:-1], abs=0.02)


@pytest.mark.parametrize("profile", ["line", "cosine"])
def test_turns_without_a_dwell_end_one_stroke_and_start_the_next(profile):
    marks = [0.0, 2.0, 8.0, 20.0, 26.0, 28.0]
    turn = path(marks, [0.0, 0.0, -22.5, 22.5, 0.0, 0.0], PROFILES[profile])
    turn += np.random.default_rng(2).normal(0.0, 1e-3, turn.size)
    strokes = strokes_of(TIME[:5600], turn[:5600], 1.0)
    assert len(strokes) == 3
    assert strokes[0].stop == strokes[1].start
    assert strokes[1].stop == strokes[2].start
    assert [stroke.stop.time_s for stroke in strokes] == pytest.approx([8.0, 20.0, 26.0], abs=0.02)
    assert [stroke.to_value for stroke in strokes] == pytest.approx([-22.5, 22.5, 0.0], abs=0.05)


def test_ripples_are_no_strokes_and_a_cut_stroke_is_reported():
    ripple = 0.2 * np.sin(7.0 * TIME)
    assert strokes_of(TIME, ripple, 1.0) == ()
    strokes = strokes_of(TIME[:1600], path([0.0, 2.0, 10.0], [0.0, 0.0, 20.0], cosine)[:1600], 1.0)
    assert [stroke.stop.kind for stroke in strokes] == ["cut"]


def test_standard_deviations_of_instants_are_of_the_size_of_their_errors():
    random, errors, reported = np.random.default_rng(3), [], []
    still = path([0.0, 5.0, 10.0], [0.0, 10.0, 10.0], minimum_jerk)[:2000]
    for _ in range(30):
        (stroke,) = strokes_of(TIME[:2000], still + random.normal(0.0, 0.006, 2000), 1.0)
        errors.append(stroke.stop.time_s - 5.0)
        reported.append(stroke.stop.std_s)
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) / np.mean(reported) < 3.0


def test_a_change_of_speed_is_distinguished_from_a_smooth_motion():
    random = np.random.default_rng(4)
    near = slice(0, 300)
    noise = random.normal(0.0, 0.006, 300)
    kinked = np.where(TIME < 0.5, 8.0 * (TIME - 0.5), 10.0 * cosine((TIME - 0.5) / 5.0))[near] + noise
    found = speed_change(TIME[near], kinked, (0.45, 0.7))
    assert found is not None
    assert found.time_s == pytest.approx(0.5, abs=0.002)
    assert speed_change(TIME[near], cosine(TIME[near] / 5.0) + noise, (0.45, 0.7)) is None
