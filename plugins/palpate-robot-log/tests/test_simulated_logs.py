"""Logs simulated by another solver, with a model of robot and sensor: processing finds what made them."""

import json

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from palpate.domain import Curve
from palpate_robot_log.processing.contact import find_onset

from . import simulated_logs as logs

pytestmark = pytest.mark.parametrize("spot", logs.SPOTS)


def nmse(found, true):
    """Mean squared error over the square of the mean magnitude."""
    return np.mean((found - true) ** 2) / np.mean(np.abs(true)) ** 2


def along_branches(curve: Curve, abscissa):
    """Ordinates of a curve at the abscissae of a path with the same turns."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(abscissa)))) + 1
    parts = []
    for rows, (start, stop) in zip(np.split(np.arange(abscissa.size), turns), curve.branches, strict=True):
        x, y = curve.abscissa[start:stop], curve.ordinate[start:stop]
        sense = np.sign(x[-1] - x[0])
        parts.append(np.interp(sense * abscissa[rows], sense * x, y))
    return np.concatenate(parts)


@pytest.mark.slow
def test_force_agrees_with_the_simulated_one(spot):
    clean, curve = logs.truth(spot).clean, logs.processed(spot).curves["force"]
    press = slice(0, int(np.argmax(clean["depth_mm"])) + 1)
    found = np.interp(clean["depth_mm"][press], curve.abscissa, curve.ordinate)
    # 3.5e-5 to 4.1e-4 measured.
    assert nmse(found, clean["force_N"][press]) < 1e-3


def test_torque_agrees_with_the_simulated_one(spot):
    clean = logs.truth(spot).clean
    twist = slice(int(np.flatnonzero(clean["angle_deg"])[0]) - 1, None)
    found = along_branches(logs.processed(spot).curves["torque"], clean["angle_deg"][twist])
    # 4e-6 to 7e-6 measured.
    assert nmse(found, clean["torque_Nmm"][twist]) < 5e-5


def test_the_onset_is_within_a_tenth_of_a_millimetre(spot):
    processed, true = logs.processed(spot), logs.truth(spot)
    surface = -(true.spot_mm - processed.motion.origin_mm) @ true.normal
    assert abs(processed.onset.travel_mm - surface) < 0.1
    assert processed.onset.std_mm < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("speed_mm_s", [1.0, 10.0])
def test_the_standard_deviation_of_the_onset_is_that_of_its_error(spot, speed_mm_s):
    """Over the noise of 30 logs, for a force that follows no law near first contact."""
    clean, ratios = logs.truth(spot).clean, []
    press = slice(0, int(np.flatnonzero(clean["angle_deg"])[0]))
    for seed in range(30):
        random = np.random.default_rng(seed)
        travel = np.arange(-4.0 - random.uniform(0.0, 0.1), 10.0, speed_mm_s / 100.0)
        force = PchipInterpolator(clean["depth_mm"][press], clean["force_N"][press])(np.maximum(travel, 0.0))
        noisy = force + random.normal(0.0, 0.04, travel.size)
        onset = find_onset(logs.recording(spot), travel, noisy, slice(None), 1.5)
        ratios.append(onset.travel_mm / onset.std_mm)
    assert 0.5 < np.sqrt(np.mean(np.square(ratios))) < 1.4


def test_phases_are_found_without_hints(spot):
    found = {phase.name: phase.start.time_s for phase in logs.processed(spot).phases}
    assert list(found) == list(logs.STARTS_S)
    for name, start in logs.STARTS_S.items():
        assert found[name] == pytest.approx(start, abs=0.02), name


def test_bias_and_drift_are_those_of_the_sensor(spot):
    processed, true = logs.processed(spot), logs.truth(spot)
    assert processed.cleaned.bias.force_N == pytest.approx(true.force_bias_N, abs=0.02)
    assert processed.cleaned.bias.moment_Nmm == pytest.approx(true.moment_bias_Nmm, abs=0.2)
    assert processed.cleaned.drift.force_N_per_s == pytest.approx(true.force_drift_N_per_s, abs=1e-3)
    assert processed.cleaned.drift.moment_Nmm_per_s == pytest.approx(true.moment_drift_Nmm_per_s, abs=5e-3)


def test_the_normal_is_that_of_the_spot(spot):
    cosine = logs.processed(spot).normal.vector @ logs.truth(spot).normal
    assert np.degrees(np.arccos(min(cosine, 1.0))) < 0.2


def test_there_is_no_lag_and_no_relaxation_to_find(spot):
    processed = logs.processed(spot)
    assert not processed.located.lag.significant
    assert abs(processed.located.lag.seconds) < 0.01
    for dwell in processed.relaxations:
        assert abs(dwell.fall) < 4.0 * dwell.fall_std
        assert dwell.time_constant_s is None


def test_standard_deviations_are_of_the_size_of_the_errors(spot):
    clean, curve = logs.truth(spot).clean, logs.processed(spot).curves["torque"]
    twist = slice(int(np.flatnonzero(clean["angle_deg"])[0]) - 1, None)
    error = along_branches(curve, clean["angle_deg"][twist]) - clean["torque_Nmm"][twist]
    size = float(np.sqrt(np.mean(error**2)) / np.mean(curve.std))
    assert 0.3 < size < 3.0


def test_curves_have_the_times_of_their_phases(spot):
    processed = logs.processed(spot)
    press, first, last = (processed.phase(name) for name in ("press", "twist_1", "twist_3"))
    force, torque = processed.curves["force"].time_s, processed.curves["torque"].time_s
    # The motion starts slowly, and first contact is found up to 0.05 mm late.
    assert force[0] == pytest.approx(press.start.time_s, abs=0.3)
    assert force[-1] == pytest.approx(press.stop.time_s, abs=0.05)
    assert (torque[0], torque[-1]) == pytest.approx((first.start.time_s, last.stop.time_s), abs=0.05)
    turns = [torque[stop - 1] for _, stop in processed.curves["torque"].branches[:-1]]
    assert turns == pytest.approx([logs.STARTS_S["twist_2"], logs.STARTS_S["twist_3"]], abs=0.05)


def test_the_record_is_complete_json(spot):
    record = logs.processed(spot).record
    assert json.loads(json.dumps(dict(record), allow_nan=False)) == dict(record)
    steps = [step["step"] for step in record["steps"]]
    assert steps == list(type(logs.settings()).model_fields)
    assert [phase["name"] for phase in record["phases"]] == list(logs.STARTS_S)
