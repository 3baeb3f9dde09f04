"""Figures of causes, of the limb and of the pressure on it."""

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest

from palpate.fit.least_squares import LeastSquares
from palpate.mesh.specimens import block
from palpate_report.figures.drawings import generalised
from palpate_report.figures.panels import budget_bars, causes, colour_of, limbs, pressed, pressures
from palpate_report.figures.style import STYLE, save, sized, styled, symbol
from palpate_report.settings import ReportSettings

from .dimple import dimple


def test_bars_have_the_shares_and_colours_of_the_causes(content):
    data = content(search=LeastSquares())
    axis = causes(data).axes[0]
    shares = [(c, s) for _, parts in budget_bars(data) for c, s in parts]
    assert shares
    assert [bar.get_width() for bar in axis.patches] == pytest.approx([share for _, share in shares])
    assert [bar.get_label() for bar in axis.containers] == [cause for cause, _ in shares]
    drawn = ["#" + "".join(f"{round(255 * c):02x}" for c in bar.get_facecolor()[:3]) for bar in axis.patches]
    assert drawn == [colour_of(cause) for cause, _ in shares]


def test_pressures_of_all_spots_share_a_scale_that_holds_the_largest(content):
    states = dimple()
    harder = replace(states, pressures_MPa=2.0 * states.pressures_MPa)
    figure = pressures(replace(content(n_sets=8), surfaces={"p1": states, "p2": harder}))
    first, second = (axis.collections[0] for axis in figure.axes[:2])
    assert first.get_clim() == second.get_clim()
    assert first.levels[-2] < 2.0 * states.pressures_MPa.max() <= first.levels[-1]
    # In the frame of the indenter, whose axis is the middle of the dimple.
    highest = [path for path in second.get_paths() if len(path.vertices)][-1]
    assert highest.get_extents().contains(0.0, 0.0)


def test_contact_of_a_single_node_is_drawn_and_a_lifted_press_is_not(content):
    states = dimple(n_across=13)
    middle = int(np.argmin(np.linalg.norm(states.points_mm - states.positions_mm[0], axis=1)))
    single, none = np.zeros_like(states.pressures_MPa), np.zeros_like(states.pressures_MPa)
    single[:, middle] = 0.01
    data = content(n_sets=8)
    surfaces = {"p1": replace(states, pressures_MPa=single), "p2": replace(states, pressures_MPa=none)}
    figure = pressures(replace(data, surfaces=surfaces))
    assert [axis.get_title() for axis in figure.axes] == ["spot p1", ""]
    assert not pressed(replace(data, surfaces={"p2": surfaces["p2"]}))


def test_a_limb_is_drawn_with_its_normal_upwards(content):
    limb = block("tet10", n_across=4, n_down=3)
    figure = limbs(replace(content(n_sets=8), limbs={"p1": limb, "p1/fine": limb, "p2": limb}))
    assert [axis.get_title() for axis in figure.axes] == ["spot p1", "spot p2"]
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"surface in contact", "fixed surface", "sphere"} <= set(labels)
    left, right, low, high = figure.axes[0].images[0].get_extent()
    pixels = np.asarray(figure.axes[0].images[0].get_array())

    def at(x_mm: float, y_mm: float) -> np.ndarray:
        row = round((high - y_mm) / (high - low) * (len(pixels) - 1))
        return pixels[row, round((x_mm - left) / (right - left) * (pixels.shape[1] - 1))]

    red, _, blue, opacity = at(0.0, 4.0)
    assert opacity == 1.0
    assert blue > red, "the sphere is above the spot"
    red, _, blue, _ = at(0.0, -8.0)
    assert red > blue, "the skin is below it"
    assert at(left, high)[3] == 0.0, "around them is nothing"


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("c1", "c₁"),
        ("c12 (kPa)", "c₁₂ (kPa)"),
        ("μ", "μ"),
        ("k1@p2", "k₁@p2"),
        ("x.c1", "x.c1"),
        ("mu2", "μ₂"),
        ("nu", "ν"),
        ("number", "number"),
    ],
)
def test_the_number_of_a_symbol_is_lowered(name, shown):
    assert symbol(name) == shown


def test_panels_have_letters_and_no_grid(content):
    with mpl.rc_context(dict(STYLE)):
        axes = generalised(content()).axes
        assert [axis.get_title(loc="left") for axis in axes] == ["a", "b", "c", "d"]
        assert not any(line.get_visible() for axis in axes for line in axis.get_xgridlines())


def test_a_font_without_a_lowered_number_takes_it_from_another(tmp_path):
    with styled(ReportSettings(font="STIXSizeOneSym")):  # comes with Matplotlib
        figure = sized(80.0, 40.0)
        figure.subplots().set_xlabel("c₁ (kPa)")
        written = save(figure, tmp_path / "figure")  # a missing glyph would be a warning, an error here
    assert "STIXSizeOneSym" in written[0].read_text()
