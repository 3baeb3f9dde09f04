"""Logs and records: good, partial, garbled and lying ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.domain import Status
from palpate.domain.channels import PRESS_AND_TWIST
from palpate.executors.sandbox import Ended
from palpate_febio.log import BAD_BANNER, GOOD_BANNER, last_reason, read_log
from palpate_febio.outcome import RecordError, as_rows, judge, read_record
from palpate_febio.steps import Steps

BOX = " " + 73 * "*"
STEPS = Steps(np.array([0.0, 1.0, 2.0, 2.0, 2.0]), np.array([0.0, 0.0, 0.0, -10.0, 10.0]))


def boxed(kind, *lines):
    body = "".join(f" * {line:<70}*\n" for line in lines)
    return f"\n\n{BOX}\n *{kind:^71}*\n{body}{BOX}\n\n"


HEAD = "  version 4.11.0.65622b536\n" + boxed("WARNING", "dtmax is ignored when specifying must points.")
GOOD_LOG = HEAD + "\n------- converged at time : 1\n\n------- converged at time : 4\n" + f"\n {GOOD_BANNER}\n"
BAD_LOG = (
    HEAD
    + "\n------- converged at time : 1\n"
    + boxed("ERROR", "Negative jacobian was detected at element 12 at gauss point 3", "jacobian = -0.1")
    + "------- failed to converge at time : 2.25\n\nMax. nr of retries reached.\n\n"
    + f"\n {BAD_BANNER}\n"
)


def record_of(steps=STEPS, n=None, radius=7.5, **change):
    blocks = []
    for k in range(steps.n + 1 if n is None else n):
        row = [radius - steps.depth_mm[k], np.deg2rad(steps.rotation_deg[k]), 0, 0, -0.1 * k, 0, 0, 0.2 * k]
        row = change.get("row", lambda _, values: values)(k, row)
        time = change.get("time", float)(k)
        blocks.append(
            f"*Step  = {k}\n*Time  = {time:.9g}\n*Data  = z;thz\n2,"
            + ",".join(f"{v:.12g}" for v in row)
            + "\n"
        )
    return "".join(blocks)


def ended(code=0, stopped="", tail=""):
    return Ended(exit_code=code, stopped=stopped, tail=tail, seconds=1.0)


# ------------------------------------------------------------------------ log


def test_a_good_log():
    said = read_log(GOOD_LOG)
    assert said.finished is True
    assert said.version == "4.11.0.65622b536"
    assert said.converged == (1.0, 4.0)
    assert said.reason is None
    assert said.warnings == ("dtmax is ignored when specifying must points.",)


def test_a_bad_log_has_the_cause_and_not_its_consequence():
    said = read_log(BAD_LOG)
    assert said.finished is False
    assert said.failed_at == 2.25
    assert said.reason.name == "negative Jacobian"
    assert "element 12" in str(said.reason)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("Max nr of reformations reached.", "too many reformations"),
        ("Max. nr of retries reached.", "too many retries"),
        ("NAN detected in residual vector at index 3.", "not a number"),
        ('FATAL ERROR: unrecognized tag "rigid_bc" (line 7)', "deck refused"),
        ("Reading file job.feb ...FAILED!\nXML error: unclosed", "deck not read"),
        ("Failed loading plugin libfoo.so", "plugin"),
        ("License check failed", "licence"),
        ("A memory allocation failure has occured.", "out of memory"),
        ("Model initialization failed", "model refused"),
        ("something quite new" + boxed("ERROR", "the moon is not in the house"), "error"),
    ],
)
def test_reasons_have_names(text, name):
    reason = last_reason(text)
    assert reason.name == name
    assert reason.remedy


def test_the_last_cause_counts():
    text = "Negative jacobian was detected at element 1\n" * 3 + "NAN detected in solution vector\n"
    assert last_reason(text).name == "not a number"


def test_both_banners_or_none_are_inconclusive():
    assert read_log(GOOD_LOG + BAD_LOG).finished is None
    assert read_log(HEAD).finished is None
    assert read_log("").finished is None


@given(st.text(max_size=400))
def test_any_text_is_read(text):
    assert read_log(text).finished in (None, True, False)


@pytest.mark.slow
@pytest.mark.parametrize(
    "line",
    ["* ERROR *\n", "\n\t", "invalid ", "linear solver ", "failed to loading ", "invalid " * 120 + "\n"],
)
def test_a_long_log_without_an_end_is_inconclusive(line):
    """In a second; in minutes where the time grows with the square of the length."""
    assert read_log(line * (400_000 // len(line))).finished is None


@given(st.integers(0, len(BAD_LOG)))
def test_a_log_cut_anywhere_never_claims_success(n):
    assert read_log(BAD_LOG[:n]).finished is not True


# -------------------------------------------------------------- FEBio's own

RECORDED = Path(__file__).parent / "data" / "recorded"
GOOD_STEPS = Steps(np.array([0.0, 1.0, 1.0]), np.array([0.0, 0.0, -5.0]))
DIVERGED_STEPS = Steps(np.array([0.0, 0.5, 16.0]), np.zeros(3))


def recorded(name):
    return (RECORDED / name).read_text()


def test_a_good_run_of_febio_is_read():
    said = read_log(recorded("good.log"))
    assert (said.finished, said.version, said.reason) == (True, "4.11.0", None)
    assert said.converged[0] == 1.0
    assert said.converged[-1] == 2.0
    verdict = judge(ended(), recorded("good.log"), recorded("good.csv"), GOOD_STEPS, 7.5)
    assert verdict.status is Status.OK, verdict.message
    reached = {name: values[-1] for name, values in as_rows(verdict.states).items()}
    expected = {
        "depth_mm": 1.0,
        "rotation_deg": -5.0,
        "force_N": 1.10880987723,
        "torque_Nmm": -0.708773624838,
    }
    assert reached == pytest.approx(expected)


def test_a_run_of_febio_that_diverged_keeps_what_it_reached():
    verdict = judge(ended(1), recorded("diverged.log"), recorded("diverged.csv"), DIVERGED_STEPS, 7.5)
    assert verdict.status is Status.DIVERGED
    assert "negative Jacobian" in verdict.message
    assert "no balance at step 1.5" in verdict.message
    force = verdict.states.observed(PRESS_AND_TWIST)["force"]
    np.testing.assert_allclose(force.ordinate, [0.0, 0.00982525103588])


def test_a_record_of_another_body_is_rejected():
    verdict = judge(ended(), recorded("good.log"), recorded("other_body.csv"), GOOD_STEPS, 7.5)
    assert verdict.status is Status.UNREADABLE
    assert not verdict.states.observed(PRESS_AND_TWIST).curves


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("xml_error", 'tag "MeshDomains" (line 3398) : unrecognized tag'),
        ("unknown_tag", 'tag "rigid_bond" (line 3410) : unrecognized tag'),
        ("unknown_parameter", 'tag "friction" (line 3448) : unrecognized tag'),
        ("no_such_material", 'tag "material" (line 44) : invalid value for attribute "type"'),
    ],
)
def test_what_febio_prints_of_a_deck_that_it_refuses_is_passed_on(name, words):
    verdict = judge(ended(1, tail=recorded(f"{name}.txt")), None, None, GOOD_STEPS, 7.5)
    assert verdict.status is Status.CRASHED
    assert f"deck refused ({words})" in verdict.message


def test_a_model_that_febio_refuses_is_named_by_its_cause():
    verdict = judge(ended(1), recorded("unstable.log"), "", GOOD_STEPS, 7.5)
    assert verdict.status is Status.CRASHED
    assert "Invalid value for parameter: 1_soft_tissue.v" in verdict.message


@given(st.integers(0, len(recorded("good.log"))), st.integers(0, len(recorded("good.csv")) - 1))
def test_a_run_cut_off_anywhere_is_never_sound(n, m):
    verdict = judge(ended(-9), recorded("good.log")[:n], recorded("good.csv")[:m], GOOD_STEPS, 7.5)
    assert verdict.status is not Status.OK
    assert verdict.n_steps < GOOD_STEPS.n


# --------------------------------------------------------------------- record


def test_a_record_is_its_rows():
    record = read_record(record_of(), 8)
    np.testing.assert_array_equal(record.times, np.arange(5.0))
    np.testing.assert_allclose(record.values[:, 0], 7.5 - STEPS.depth_mm)


@given(st.integers(0, len(record_of())))
def test_a_record_cut_anywhere_keeps_its_whole_blocks(n):
    text = record_of()
    record = read_record(text[:n], 8)
    whole = read_record(text, 8)
    assert len(record.times) == sum(line.startswith("2,") for line in text[:n].split("\n")[:-1])
    np.testing.assert_array_equal(record.values, whole.values[: len(record.times)])


@pytest.mark.parametrize(
    "text",
    [
        "2,1,2,3\n",
        "*Time  = 1\n2,1,2,3\n",
        "*Time  = soon\n2,1,2,3,4,5,6,7,8\n",
        "*Time  = 1\n2,1,2,3,4,5,6,7,rubbish\n",
        record_of(time=lambda k: float(k % 3)),
    ],
)
def test_garbled_records_are_refused(text):
    with pytest.raises(RecordError):
        read_record(text, 8)


# -------------------------------------------------------------------- verdict


def test_all_is_well():
    verdict = judge(ended(), GOOD_LOG, record_of(), STEPS, 7.5)
    assert (verdict.status, verdict.message) == (Status.OK, "")
    response = verdict.states.observed(PRESS_AND_TWIST)
    np.testing.assert_allclose(response["force"].ordinate, [0.0, 0.1, 0.2])
    np.testing.assert_allclose(response["torque"].abscissa, [0.0, -10.0, 10.0])
    np.testing.assert_allclose(response["torque"].ordinate, [0.4, 0.6, 0.8])


def test_between_the_steps_there_may_be_more():
    """FEBio cuts a step that is hard, and writes down where it got to."""
    lines = record_of().replace("*Time  = 2\n", "*Time  = 1.5\n*Data  = z\n2,6,0,0,0,0,0,0,0\n*Time  = 2\n")
    assert judge(ended(), GOOD_LOG, lines, STEPS, 7.5).status is Status.OK


def spoiled(where, value):
    return record_of(row=lambda k, row: [value if (k, j) == where else v for j, v in enumerate(row)])


@pytest.mark.parametrize(
    ("how", "log", "record", "status", "words"),
    [
        (ended(), GOOD_LOG, None, Status.UNREADABLE, "there is none"),
        (ended(), GOOD_LOG, "", Status.UNREADABLE, "missing"),
        (ended(), GOOD_LOG, record_of(n=4), Status.UNREADABLE, "1 of 4 steps missing"),
        (ended(), GOOD_LOG, spoiled((3, 4), np.nan), Status.UNREADABLE, "not finite"),
        (ended(), GOOD_LOG, spoiled((3, 7), np.inf), Status.UNREADABLE, "not finite"),
        (ended(), GOOD_LOG, spoiled((2, 0), 7.0), Status.UNREADABLE, "was sent to 2 mm"),
        (ended(), GOOD_LOG, spoiled((3, 1), 0.2), Status.UNREADABLE, "was sent to 2 mm, -10 degrees"),
        (ended(), GOOD_LOG, record_of(row=lambda _, row: [*row[:2], *[0] * 6]), Status.UNREADABLE, "zero"),
        (ended(), HEAD, record_of(), Status.UNREADABLE, "without its banner"),
        (ended(), GOOD_LOG + BAD_LOG, record_of(), Status.UNREADABLE, "negative Jacobian"),
        (ended(), None, None, Status.UNREADABLE, "without its banner"),
        (ended(3), GOOD_LOG, record_of(), Status.CRASHED, "code 3"),
        (ended(-11), HEAD, record_of(n=2), Status.CRASHED, "code -11"),
        (ended(1), BAD_LOG, record_of(n=3), Status.DIVERGED, "negative Jacobian"),
        (ended(1), None, None, Status.CRASHED, "gave no reason"),
        (ended(1, tail="FATAL ERROR: unrecognized tag <a> (line 7)"), None, None, Status.CRASHED, "line 7"),
        (ended(-15, "stopped after 1 s, its time limit"), HEAD, record_of(n=3), Status.TIMED_OUT, "limit"),
    ],
)
def test_what_febio_claims_is_checked(how, log, record, status, words):
    verdict = judge(how, log, record, STEPS, 7.5)
    assert verdict.status is status
    assert words in verdict.message


def test_a_partial_run_keeps_what_it_reached():
    verdict = judge(ended(1), BAD_LOG, record_of(n=3), STEPS, 7.5)
    np.testing.assert_allclose(verdict.states.observed(PRESS_AND_TWIST)["force"].abscissa, [0.0, 1.0, 2.0])
    assert "torque" not in verdict.states.observed(PRESS_AND_TWIST).curves
    assert not verdict.states.cut(slice(1)).observed(PRESS_AND_TWIST).curves


def test_a_turn_beyond_half_a_circle_is_recognised():
    steps = Steps(np.array([0.0, 1.0, 1.0]), np.array([0.0, 0.0, 200.0]))
    wrapped = record_of(
        steps, row=lambda k, row: [row[0], np.deg2rad(-160.0) if k == 2 else row[1], *row[2:]]
    )
    assert judge(ended(), GOOD_LOG, wrapped, steps, 7.5).status is Status.OK


def test_steps_that_the_printed_times_cannot_tell_apart_are_refused():
    """A short hold after a long rest: each of its steps would be read from the same row."""
    times = np.array([0.0, 1.0, 1e4, 1e4 + 1e-4, 1e4 + 2e-4])
    steps = replace(STEPS, time_s=times)
    verdict = judge(ended(), GOOD_LOG, record_of(steps, time=lambda k: times[k]), steps, 7.5)
    assert verdict.status is Status.UNREADABLE
    assert "steps 2 and 3 are alike" in verdict.message
