"""Cycles of one log: each is found, chosen and processed as a log of its own, and their drift is measured."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, strategies as st
from pydantic import ValidationError

from palpate.domain import Response
from palpate.errors import CurveError
from palpate.experiment.cycles import cycle_warnings
from palpate.experiment.measured import load_measured, load_presses, mean
from palpate.plugins.catalogue import Plugins
from palpate.study.reading import read_study
from palpate_robot_log import RobotLogSettings, pictures
from palpate_robot_log.processing.chain import process
from palpate_robot_log.processing.cycles import parts_of, process_cycles
from palpate_robot_log.reading.assembly import Reading
from palpate_robot_log.recording import Recording, thinned

from . import simulated_logs as logs

SOFTER = 0.05
SIGNALS = ("position_mm", "quaternion", "force_N", "moment_Nmm", "rows")
EVERY_S = 40.0


@cache
def one(stiffness: float = 1.0) -> Recording:
    """A log of one press on a tissue that is softer, with noise of its own, of few rows."""
    whole, tissue = logs.recording("p1"), logs.processed("p1").cleaned.recording
    softer = whole.less((1.0 - stiffness) * tissue.force_N, (1.0 - stiffness) * tissue.moment_Nmm)
    few, _ = thinned(softer, 1500)
    return few.changed(
        force_N=few.force_N + np.random.default_rng(int(1e6 * stiffness)).normal(0.0, 0.02, (few.n_rows, 3))
    )


def joined(*presses: Recording) -> Recording:
    """One log of presses, one after the other."""
    return Recording(
        source="robot_p1.csv",
        time_s=np.concatenate([press.time_s + EVERY_S * k for k, press in enumerate(presses)]),
        **{name: np.concatenate([getattr(press, name) for press in presses]) for name in SIGNALS},
    )


@cache
def three():
    return joined(*(one((1.0 - SOFTER) ** k) for k in range(3)))


@cache
def processed():
    return process_cycles(three(), logs.settings(), "all")


@given(st.lists(st.tuples(st.integers(1, 12), st.integers(1, 12)), min_size=1, max_size=5))
def test_a_log_is_cut_where_the_tool_is_in_free_air(lacking):
    """However long the tool was above the limb before and after each press."""
    presses = [one().part(slice(few, one().n_rows - less)) for few, less in lacking]
    parts = parts_of(joined(*presses))
    assert len(parts) == len(presses)
    assert sum(part.n_rows for part in parts) == sum(press.n_rows for press in presses)
    for k, part in enumerate(parts):
        assert part.time_s[0] < EVERY_S * k + logs.STARTS_S["press"]
        assert part.time_s[-1] > EVERY_S * k + logs.STARTS_S["departure"]


def test_each_cycle_is_processed_as_a_log_that_holds_it_alone():
    alone = process(one(1.0 - SOFTER), logs.settings())
    for channel, curve in alone.curves.items():
        found = processed().processed[2].curves[channel]
        np.testing.assert_allclose(found.abscissa, curve.abscissa, atol=1e-9)
        np.testing.assert_allclose(found.ordinate, curve.ordinate, atol=1e-9)


def test_the_drift_is_that_of_the_tissue():
    first, *others = processed().table
    assert first["changes"] == {}
    for k, row in enumerate(others, start=1):
        assert set(row["changes"]) == {"force", "torque"}
        for change in row["changes"].values():
            assert change["share"] == pytest.approx(-SOFTER, abs=3.0 * change["std"])
            assert 0.0 < change["std"] < 0.01
            assert change["since_first"] == pytest.approx((1.0 - SOFTER) ** k - 1.0, abs=0.02)
    work = [row["work_Nmm"] for row in processed().table]
    assert work[2] / work[0] == pytest.approx((1.0 - SOFTER) ** 2, rel=0.02)
    starts = [row["start_s"] for row in processed().table]
    assert starts == pytest.approx([logs.STARTS_S["press"] + EVERY_S * k for k in range(3)], abs=0.05)


@pytest.mark.parametrize(("cycle", "counted"), [("last", 3), (1, 1)])
def test_a_setting_chooses_what_counts(cycle, counted, monkeypatch):
    monkeypatch.setattr("palpate_robot_log.processing.cycles.process", each_of(processed()))
    found = process_cycles(three(), logs.settings(), cycle)
    assert [row["counts"] for row in found.table] == [k == counted for k in (1, 2, 3)]
    assert found.labelled == {"": processed().processed[counted]}
    assert list(processed().labelled) == ["cycle_1", "cycle_2", "cycle_3"]


def each_of(cycles):
    """What processes one cycle after the other, as they were before."""
    left = list(cycles.processed.values())
    return lambda part, settings: left.pop(0)


def test_the_cycles_are_drawn_with_their_drift(monkeypatch, tmp_path):
    drawn = {}

    def keep(canvas, path, dpi):
        drawn[path.name] = canvas.figure

    monkeypatch.setattr(pictures.FigureCanvasAgg, "print_figure", keep)
    pictures.draw_cycles(processed(), tmp_path)
    (axis,) = drawn["6_cycles.png"].axes
    labels = [text.get_text() for text in axis.get_legend().get_texts()]
    assert labels[0] == "cycle 1"
    assert [label.startswith(f"cycle {k}, -") for k, label in enumerate(labels[1:], start=2)] == [True, True]


def test_a_cycle_that_does_not_count_may_be_no_press():
    half = one().part(slice(0, 500)).changed(quaternion=np.tile(one().quaternion[0], (500, 1)))
    back = one().part(slice(one().n_rows - 300, None))
    broken = joined(half.part(slice(0, 250)), back, one())
    found = process_cycles(broken, logs.settings())
    assert (found.counted, list(found.processed)) == ((2,), [2])
    assert "robot_p1.csv" in found.table[0]["problem"]
    with pytest.raises(CurveError):
        process_cycles(broken, logs.settings(), "all")


@pytest.mark.parametrize(
    ("presses", "steps", "cycle", "message"),
    [
        ((one,), {}, 2, "cycle = 2, but the log has 1"),
        ((one, one), {"onset": {"method": "given", "time": "0.5 s"}}, 1, "onset.time .* has 2 cycles"),
        ((one, lambda: next_to(2.0)), {}, "last", "cycle 1 presses 2 mm from cycle 2 .* several spots"),
    ],
)
def test_what_is_no_cycle_of_one_spot_is_refused(presses, steps, cycle, message):
    with pytest.raises(CurveError, match=message):
        process_cycles(joined(*(press() for press in presses)), logs.settings(**steps), cycle)


def next_to(shift_mm: float) -> Recording:
    along = np.cross(logs.truth("p1").normal, [1.0, 0.0, 0.0])
    return one().changed(position_mm=one().position_mm + shift_mm * along / np.linalg.norm(along))


@cache
def plugins():
    return Plugins.load()


@pytest.fixture
def study(monkeypatch):
    """A study of one spot whose log holds three cycles; called with the setting."""
    whole = read_study(plugins().studies["robot-log"].directory, plugins())
    loader = type(whole.loader)
    monkeypatch.setattr(loader, "_read", lambda self, path: Reading(recording=three(), record={}))
    monkeypatch.setattr("palpate_robot_log.processing.cycles.process", each_of(processed()))

    def of(cycle):
        settings = whole.loader.settings.model_copy(update={"cycle": cycle})
        return replace(whole, spots=whole.spots[:1], loader=loader(settings))

    return of


def test_all_cycles_are_presses_of_the_spot(study):
    presses = load_presses(study("all"), plugins().channels)["p1"]
    names = [f"logs/simulated_p1.parquet, cycle_{k}" for k in (1, 2, 3)]
    assert list(presses.responses) == names
    found = mean(presses)
    assert found.record["averages"]["force"]["n_presses"] == 3
    assert [name for name, record in found.record["files"].items() if "cycles" in record] == names[2:]
    peaks = [response["force"].ordinate.max() for response in presses.responses.values()]
    assert found["force"].ordinate.max() == pytest.approx(np.mean(peaks), rel=1e-3)


@pytest.mark.parametrize(("cycle", "n_warnings"), [("last", 1), (1, 0)])
def test_cycles_that_do_not_repeat_are_warned_of_where_a_later_one_counts(study, cycle, n_warnings):
    one_spot = study(cycle)
    found = cycle_warnings(one_spot, load_measured(one_spot, plugins().channels))
    assert len(found) == n_warnings
    for text in found:
        assert re.search(r"force changes by -\S+ % and torque changes by -\S+ % from the cycle before", text)
        assert "to cycle 3 of 3, so the tissue may not be preconditioned" in text


def test_early_cycles_that_do_not_repeat_are_warned_of_where_all_count(study):
    changes = {2: {"force": {"share": -0.2, "std": 0.001}}, 3: {"force": {"share": -0.005, "std": 0.001}}}
    rows = [{"cycle": k, "counts": True, "changes": changes.get(k, {})} for k in (1, 2, 3)]
    measured = {"p1": Response(curves={}, record={"files": {"press.csv": {"cycles": rows}}})}
    (text,) = cycle_warnings(study("all"), measured)
    assert "force changes by -20 % from the cycle before to cycle 2 of 3" in text


@pytest.mark.parametrize("cycle", [True, "2", 2.0, 0])
def test_a_cycle_is_a_whole_number_or_a_word(cycle):
    with pytest.raises(ValidationError) as refused:
        RobotLogSettings.model_validate({"cycle": cycle})
    assert "cycle" in {error["loc"][0] for error in refused.value.errors()}


def test_cycles_of_a_tissue_that_relaxes_in_the_model_are_warned_of(study, monkeypatch):
    rows = [{"cycle": k, "counts": k == 2, "changes": {}} for k in (1, 2)]
    measured = {"p1": Response(curves={}, record={"files": {"press.csv": {"cycles": rows}}})}
    assert cycle_warnings(study("last"), measured) == ()
    relaxing = study("last")
    monkeypatch.setattr(type(relaxing), "models_relaxation", lambda self, scenario: True)
    (text,) = cycle_warnings(relaxing, measured)
    assert text.startswith("press.csv: spot 'p1': the fit takes the tissue as at rest before cycle 2 of 2")
