"""Pictures of a log show what was done to it."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given, strategies as st
from matplotlib import rcParams
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.image import imread
from scipy.spatial.transform import Rotation

from palpate_robot_log import pictures
from palpate_robot_log.pictures import N_BUCKETS, draw_processed, draw_recording, envelope
from palpate_robot_log.processing.chain import process
from palpate_robot_log.processing.settings import ProcessingSettings
from palpate_robot_log.recording import Recording

RATE_HZ = 100.0
PHASES = [
    "approach", "press", "dwell_1", "twist_1", "twist_2", "twist_3", "dwell_2", "retract", "departure",
]  # fmt: skip


def recording():
    """One press of 10 mm along the sensor's z axis, twisted by 20 degrees, with bias and noise."""
    marks = np.array([0.0, 1.0, 5.0, 6.0, 9.0, 15.0, 18.0, 19.0, 23.0, 24.0])
    depths = [-4.0, 0.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 0.0, -4.0]
    turns = [0.0, 0.0, 0.0, 0.0, -20.0, 20.0, 0.0, 0.0, 0.0, 0.0]
    time = np.arange(0.0, marks[-1], 1.0 / RATE_HZ)
    depth, turn = np.interp(time, marks, depths), np.interp(time, marks, turns)
    random = np.random.default_rng(5)
    force, moment = (random.normal(0.0, s, (time.size, 3)) for s in (0.03, 0.2))
    # The tool points down: its z axis is the inward normal, about which it turns the other way.
    force += [0.5, -0.4, 1.0]
    force[:, 2] -= 0.4 * np.maximum(depth, 0.0) ** 1.5
    moment[:, 2] += turn
    down = Rotation.from_euler("x", 180.0, degrees=True)
    return Recording(
        source="logs/press.csv",
        time_s=time,
        position_mm=np.stack([np.zeros_like(depth), np.zeros_like(depth), -depth], axis=1),
        quaternion=(Rotation.from_euler("z", turn[:, None], degrees=True) * down).as_quat(),
        force_N=force,
        moment_Nmm=moment,
        rows=np.arange(time.size) + 2,
    )


@pytest.fixture(scope="module")
def processed():
    return process(recording())


@pytest.fixture
def figures(monkeypatch):
    """Figures by file name, kept instead of being written."""
    kept = {}

    def keep(canvas, path, dpi):
        kept[path.name] = canvas.figure

    monkeypatch.setattr(pictures.FigureCanvasAgg, "print_figure", keep)
    return kept


@pytest.mark.slow
def test_five_pictures_are_written_and_nobodys_style_changes(processed, tmp_path):
    before = dict(rcParams)
    files = (draw_recording(processed.raw, tmp_path), *draw_processed(processed, tmp_path))
    assert [file.name for file in files] == [
        "1_as_read.png", "2_tared.png", "3_phases.png", "4_onset.png", "5_curves.png", "over_time.csv",
    ]  # fmt: skip
    for file in files[:-1]:
        pixels = imread(file)
        assert min(pixels.shape[:2]) > 300
        assert np.ptp(pixels[..., :3]) > 0.5
    assert dict(rcParams) == before


def test_the_table_over_time_has_the_whole_press_in_the_clock_of_the_log(processed, figures, tmp_path):
    table = pl.read_csv(draw_processed(processed, tmp_path)[-1])
    assert table.columns == ["time_s", "depth_mm", "rotation_deg", "force_N", "torque_Nmm"]
    assert list(table["time_s"][[0, -1]]) == pytest.approx([0.0, processed.raw.time_s[-1]])
    assert table["depth_mm"].max() == pytest.approx(10.0, abs=0.05)
    assert table["rotation_deg"].abs().max() == pytest.approx(20.0, abs=0.05)
    assert table["force_N"].max() == pytest.approx(0.4 * 10.0**1.5, abs=0.2)


def test_every_phase_is_named_and_shaded_in_every_panel(processed, figures, tmp_path):
    assert [phase.name for phase in processed.phases] == PHASES
    draw_processed(processed, tmp_path)
    axes = figures["3_phases.png"].axes
    assert len(axes) == 4
    for axis in axes:
        assert len(axis.patches) == len(PHASES)
    assert [text.get_text() for text in axes[0].texts] == [name.replace("_", " ") for name in PHASES]
    for shade, phase in zip(axes[0].patches, processed.phases, strict=True):
        assert shade.get_x() == pytest.approx(phase.start.time_s)


def test_the_tared_wrench_is_drawn_next_to_the_raw_one(processed, figures, tmp_path):
    draw_processed(processed, tmp_path)
    figure = figures["2_tared.png"]
    assert figure.get_suptitle() == "press.csv: without drift, bias"
    before, after = (line.get_ydata() for line in figure.axes[0].lines[:2])
    assert np.mean(before[:50]) == pytest.approx(0.5, abs=0.03)
    assert np.mean(after[:50]) == pytest.approx(0.0, abs=0.03)
    # Free air at both ends is shaded.
    assert len(figure.axes[0].patches) == 2


def test_the_force_over_time_has_a_panel_of_press_and_rest(figures, tmp_path):
    settings = ProcessingSettings(over_time={"enabled": True})
    draw_processed(process(recording(), settings), tmp_path)
    labels = [axis.get_xlabel() for axis in figures["5_curves.png"].axes]
    assert labels.count("time (s)") == 1


def test_steps_that_were_left_out_are_not_claimed(figures, tmp_path):
    draw_processed(process(recording(), ProcessingSettings(drift={"enabled": False})), tmp_path)
    assert figures["2_tared.png"].get_suptitle() == "press.csv: without bias"


def test_residuals_are_those_of_the_rows(processed, figures, tmp_path):
    draw_processed(processed, tmp_path)
    *_, force_left, torque_left = figures["5_curves.png"].axes
    assert np.std(force_left.lines[0].get_ydata()) == pytest.approx(0.03, rel=0.2)
    for line in torque_left.lines[:3]:
        assert np.std(line.get_ydata()) == pytest.approx(0.2, rel=0.2)
    assert "N·mm" in torque_left.get_ylabel()


@pytest.mark.slow
def test_no_legend_hides_the_residuals(processed, figures, tmp_path):
    draw_processed(processed, tmp_path)
    figure = figures["5_curves.png"]
    FigureCanvasAgg(figure).draw()
    for axis in figure.axes[2:]:
        assert axis.get_legend().get_window_extent().y0 > axis.bbox.y1 - 3.0


@given(st.integers(1, 12 * N_BUCKETS), st.integers(0, 2**32 - 1))
def test_an_envelope_keeps_the_extremes_and_the_order(n_rows, seed):
    values = np.random.default_rng(seed).normal(size=n_rows)
    rows = envelope(values)
    assert (np.diff(rows) > 0).all()
    assert rows.size <= 3 * N_BUCKETS + 2
    assert values[rows].max() == values.max()
    assert values[rows].min() == values.min()
