"""The table of checks: each row refuses by its own limits, with message and remedy."""

import string

import pytest

from palpate.errors import CurveError
from palpate_robot_log.checks import CHECKS, Check, check, errors_of
from palpate_robot_log.measures import given

from . import simulated_logs as logs


@pytest.mark.parametrize("row", CHECKS, ids=lambda row: f"{row.stage} {row.measure.__name__}")
def test_a_row_has_limits_a_message_and_a_remedy(row: Check) -> None:
    if not callable(row.limits):
        least, most = row.limits
        assert least <= most
    fields = [name for _, name, _, _ in string.Formatter().parse(f"{row.message}; {row.remedy}") if name]
    assert all(name.partition("[")[0].isidentifier() for name in fields)
    assert row.remedy
    assert not row.message.endswith((".", ";"))


@pytest.mark.parametrize("value", [0.0, 0.5, 0.50001, float("nan"), float("-inf")])
def test_values_beyond_the_limits_are_refused_with_their_row(value: float) -> None:
    recording = logs.recording("p1")
    errors = [str(error) for error in errors_of(recording, "lag", value, 3)]
    if value in (0.0, 0.5):
        check(recording, "lag", value)
        assert errors == []
        return
    assert len(errors) == 1
    assert errors[0].startswith(f"robot_p1.csv: row {recording.rows[3]} (t = ")
    assert errors[0].endswith("or give alignment.lag")
    with pytest.raises(CurveError, match="correct the clock"):
        check(recording, "lag", value)


def test_each_row_of_a_stage_is_tried() -> None:
    assert {row.stage for row in CHECKS if row.measure is not given} >= {"time", "sensor", "torque"}
    recording = logs.recording("p1")
    tool = logs.processed("p1").cleaned.tool
    assert tool is not None
    heavy = type(tool)(weight_N=101.0, centre_mm=tool.centre_mm * 100.0)
    messages = [str(error) for error in errors_of(recording, "tool", heavy)]
    assert ["a tool of 101 N" in messages[0], "mm from the sensor" in messages[1]] == [True, True]
