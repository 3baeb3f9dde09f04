"""The page of measured curves: every curve is on it, and the cursor reads all of them at one place."""

import json
import re

import numpy as np
import polars as pl
import pytest

from palpate.api import FORCE, TORQUE, Channel, Curve, PluginError, Response
from palpate.api.report import Table
from palpate_report.page.measured import write_measured_page

from .chromium import COMMAND, Chromium
from .hostile import ATTACK
from .test_report_chromium import violations

FORCE_OVER_TIME = Channel(
    name="force_over_time",
    abscissa="time_s",
    ordinate="force_N",
    abscissa_label="time (s)",
    ordinate_label="normal force (N)",
)
CHANNELS = {"force": FORCE, "torque": TORQUE, "force_over_time": FORCE_OVER_TIME}
DEPTH = np.linspace(0.0, 10.0, 11)


def press(stiffness):
    """Force over depth, and a torque that ends below zero on its way back."""
    force = Curve(channel="force", abscissa=DEPTH, ordinate=0.5 * stiffness * DEPTH)
    torque = Curve(channel="torque", abscissa=[0.0, 20.0, 0.0], ordinate=[0.0, 8.0, -2.0])
    return Response(curves={"force": force, "torque": torque})


@pytest.fixture
def page(tmp_path):
    """Page of presses by spot; the log of the first spot is known over time, and twice as long as drawn."""

    def made(presses, notice="simulated data", over_time=None):
        pictures = {spot: tmp_path / f"plots{k}" for k, spot in enumerate(presses)}
        for folder in pictures.values():
            folder.mkdir()
        log = next(iter(pictures.values())) / "log"
        log.mkdir()
        time = np.linspace(5.0, 25.0, 2001)
        values = {"time_s": time, "depth_mm": 0.5 * (time - 5.0), "force_N": time - 5.0}
        pl.DataFrame(over_time or values).write_csv(log / "over_time.csv")
        path = tmp_path / "curves.html"
        write_measured_page("arm", presses, pictures, CHANNELS, notice, path)
        return path

    return made


def test_every_curve_is_on_it_under_its_axis_time_first(page):
    spots = {f"p{k}": {"one.csv": press(k), "two.csv": press(k + 0.5)} for k in range(1, 8)}
    text = page(spots).read_text()
    assert re.findall(r"<h2[^>]*>(.*)</h2>", text) == [
        "Curves over time of the log (s)",
        "Curves over indentation depth (mm)", "Curves over rotation (degrees)",
    ]  # fmt: skip
    assert "these are simulated data" in text
    time, depth, rotation = json.loads(re.search(r'id="data">(.*)</script>', text)[1])
    assert [len(figure["lines"]) for figure in time] == [1]
    (at_depth, at_force) = time[0]["lines"][0]
    assert at_depth[0][0] == at_depth[1][0] == 0.0
    assert len(at_force[0]) <= 1000
    # Six spots have looks of their own; the seventh is in a figure by itself.
    assert (
        [len(figure["lines"]) for figure in depth] == [len(figure["lines"]) for figure in rotation] == [12, 2]
    )
    assert depth[1]["lines"][0][0][1][-1] == pytest.approx(35.0)
    assert '<th scope="row">p7, two.csv</th>' in text


def numbers(path):
    """Figures of a page by their axis."""
    text = path.read_text()
    axes = re.findall(r"<h2[^>]*>Curves over (.*)</h2>", text)
    return dict(zip(axes, json.loads(re.search(r'id="data">(.*)</script>', text)[1]), strict=True))


def test_a_curve_over_time_from_first_contact_is_not_on_the_axis_of_the_log(page):
    curve = Curve(channel="force_over_time", abscissa=[0.0, 1.0], ordinate=[0.0, 3.0])
    found = numbers(page({"p1": {"one.csv": Response(curves={"force_over_time": curve})}}))
    assert {axis: len(figures[0]["lines"]) for axis, figures in found.items()} == {
        "time of the log (s)": 1,
        "time (s)": 1,
    }


def test_a_long_curve_keeps_its_ends_peaks_and_gaps(page):
    time, force = np.arange(40_003.0), np.sin(np.arange(40_003.0))
    force[12_346], force[30_001], force[20_000:20_003], force[-1] = 24.16, -7.5, np.nan, 0.125
    found = numbers(page({"p1": {"one.csv": press(1.0)}}, over_time={"time_s": time, "force_N": force}))
    (((along, values),),) = found["time of the log (s)"][0]["lines"]
    known = dict(zip(along, values, strict=True))
    assert len(values) <= 1000
    assert (known[0.0], known[12_346.0], known[30_001.0], known[40_002.0]) == (0.0, 24.16, -7.5, 0.125)
    assert known[20_000.0] is None


@pytest.mark.parametrize("times", [[], [np.nan, np.nan]])
def test_a_log_without_rows_is_left_out(page, times):
    over_time = {"time_s": times, "force_N": [1.0 for _ in times]}
    frame = pl.DataFrame(over_time, schema={"time_s": pl.Float64, "force_N": pl.Float64})
    found = numbers(page({"p1": {"one.csv": press(1.0)}}, over_time=frame.to_dict()))
    assert list(found) == ["indentation depth (mm)", "rotation (degrees)"]


def test_a_log_without_its_time_is_refused_by_name(page):
    with pytest.raises(PluginError, match=r"over_time\.csv: no column 'time_s'"):
        page({"p1": {"one.csv": press(1.0)}}, over_time={"force_N": [1.0, 2.0]})


def test_text_in_a_log_is_refused_by_row_and_column(page):
    over_time = {"time_s": [0.0, 1.0], "force_N": ["1.0", "high"]}
    with pytest.raises(PluginError, match=r"over_time\.csv: row 2, column 'force_N': 'high' is not a number"):
        page({"p1": {"one.csv": press(1.0)}}, over_time=over_time)


def test_columns_of_texts_are_numbers_where_the_table_states_it():
    table = Table("Values", ["name", "value", "unit"], [["c1", "1.20", "kPa"]], numeric=frozenset({1}))
    assert table.is_number == (False, True, False)
    assert Table("Names", ["spot", "number"], [["p1", "12"]]).is_number == (False, False)


@pytest.mark.slow
def test_names_are_shown_as_they_are_and_a_single_press_without_its_file(page):
    text = page({ATTACK: {"one.csv": press(1.0)}}, notice=ATTACK).read_text()
    assert ATTACK not in text
    assert "one.csv" not in text


@pytest.mark.browser
@pytest.mark.skipif(COMMAND is None, reason="no Chromium is installed")
def test_the_cursor_reads_every_curve_at_one_place(page, tmp_path):
    path = page({"p1": {"a.csv": press(1.0)}, "p2": {"b.csv": press(2.0)}})
    cells = "[...document.querySelectorAll('[data-view=\"{}\"] td')].map(c => c.textContent)"
    with Chromium(tmp_path / "chromium") as browser:
        for width, dark in ((1100, False), (390, True), (320, False)):
            browser.open(path, width, dark=dark)
            assert browser.value("document.documentElement.scrollWidth") <= width
            assert (browser.complaints(), violations(browser)) == ([], [])
        browser.value("document.querySelectorAll('input').forEach(s => {"
                      "s.value = 8; s.dispatchEvent(new Event('input'))})")  # fmt: skip
        assert browser.value(cells.format(0)) == ["4.000", "8.000"]
        assert browser.value(cells.format(1)) == ["4.000", "8.000"]
        # The way in and the way back.
        assert browser.value(cells.format(2)) == ["3.200 / 2.000"] * 2
        left = browser.value("document.querySelector('.cursor').getBoundingClientRect().left")
        frame = browser.value("document.querySelector('.under').getBoundingClientRect().left")
        browser.value("{const f = document.querySelector('.under').getBoundingClientRect();"
                      "document.querySelector('.under').dispatchEvent(new PointerEvent('pointermove',"
                      f"{{clientX: {left}, clientY: f.top + 20}}))}}")  # fmt: skip
        assert float(browser.value("document.querySelector('output').textContent")) == pytest.approx(
            8.0, abs=0.1
        )
        assert left > frame
        browser.print_media(path, dark=True)
        assert browser.value("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
        assert browser.n_printed_pages() <= 2


@pytest.mark.browser
@pytest.mark.skipif(COMMAND is None, reason="no Chromium is installed")
def test_the_cursor_reads_nothing_between_missing_values(page, tmp_path):
    force = [0.0, 1.0, np.nan, np.nan, 4.0, 5.0]
    path = page(
        {"p1": {"a.csv": press(1.0)}}, over_time={"time_s": [3.0, 4.0, 5.0, 6.0, 7.0, 8.0], "force_N": force}
    )
    shown = "document.querySelector('[data-view=\"0\"] td').textContent"
    read = {}
    with Chromium(tmp_path / "chromium") as browser:
        browser.open(path, 1100)
        for place in (0.5, 1.0, 1.5, 2.5, 3.5, 4.0, 4.5):
            browser.value("{const s = document.querySelector('[data-view=\"0\"] input');"
                          f"s.value = {place}; s.dispatchEvent(new Event('input'))}}")  # fmt: skip
            read[place] = browser.value(shown)
    assert read == {
        0.5: "0.5000", 1.0: "1.000", 1.5: "–", 2.5: "–", 3.5: "–", 4.0: "4.000", 4.5: "4.500",
    }  # fmt: skip
