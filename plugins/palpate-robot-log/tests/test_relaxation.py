"""Relaxation in a rest of a log is found, and is too much for the default budget from 5 % on."""

import numpy as np
import pytest

from palpate.experiment.relaxation import relaxation_of
from palpate.study.model import BudgetTable
from palpate_robot_log.processing.chain import process

from . import simulated_logs as logs

RELAXED = {"p1": (0.05, 0.3), "p2": (0.05, 3.0), "p3": (0.12, 0.5), "p4": (0.10, 5.0)}
"""Fall in the first rest, and its time constant [s]."""


def relaxed(spot, fall, tau_s):
    """A log whose wrench falls from the first rest on, until the tool departs."""
    whole, tissue = logs.recording(spot), logs.processed(spot).cleaned.recording
    since = np.maximum(whole.time_s - logs.STARTS_S["dwell_1"], 0.0)
    lost = fall * (1.0 - np.exp(-since / tau_s)) / (1.0 - np.exp(-1.0 / tau_s))
    lost = (lost * (whole.time_s < logs.STARTS_S["departure"]))[:, None]
    return whole.less(lost * tissue.force_N, lost * tissue.moment_Nmm)


def worst(response):
    return relaxation_of({"p": response}, BudgetTable().gain)


@pytest.mark.slow
@pytest.mark.parametrize("spot", logs.SPOTS)
def test_five_percent_in_a_rest_are_flagged(spot):
    fall, tau_s = RELAXED[spot]
    found = worst(process(relaxed(spot, fall, tau_s), logs.settings()))
    assert found.is_beyond
    assert found.share == pytest.approx(fall, abs=0.01)
    assert found.rest.duration_s == pytest.approx(1.0, abs=0.05)
    assert (found.rest.channel, found.rest.phase) == ("force", "dwell_1")


@pytest.mark.parametrize("spot", logs.SPOTS)
def test_an_elastic_tissue_is_not_flagged(spot):
    found = worst(logs.processed(spot))
    assert not found.is_beyond
    assert abs(found.share) < 0.01


def test_force_over_time_is_that_of_the_press_and_of_the_rest_after_it():
    fall, tau_s = RELAXED["p3"]
    found = process(relaxed("p3", fall, tau_s), logs.settings(over_time={"enabled": True}))
    force, over_time = found.curves["force"], found.curves["force_over_time"]
    _, press, rest, *_ = found.phases
    assert over_time.abscissa[0] == pytest.approx(0.0, abs=0.05)
    assert over_time.abscissa[-1] == pytest.approx(rest.stop.time_s - press.start.time_s, abs=0.05)
    peak = over_time.ordinate.max()
    assert peak == pytest.approx(force.ordinate.max(), rel=0.01)
    assert over_time.ordinate[-1] == pytest.approx((1.0 - fall) * peak, abs=0.01 * peak)
    assert (over_time.std > 0.0).all()
