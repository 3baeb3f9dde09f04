"""The skin under the press on the page: what is kept of it, and that numbers survive in two bytes."""

import base64
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.domain import SurfaceStates
from palpate_report.answer.result import Report, make_conclusion
from palpate_report.data.tables import make_tables
from palpate_report.figures.scene import MOST_BYTES, MOST_STATES, deepest, shown_states, skins
from palpate_report.page.html import render
from palpate_report.sections.origins import LimbAndDeformation

from .dimple import dimple

UNDRAWN = Report(tables={}, conclusion=None)


def unpacked(part, *shape):
    return part["scale"] * np.frombuffer(base64.b64decode(part["data"]), "<i2").reshape(shape)


@pytest.fixture
def shown(content):
    def made(**skin):
        states = dimple(**skin)
        return replace(content(n_sets=8), surfaces={"p1": states}), states

    return made


def test_positions_and_pressures_survive_to_a_part_in_thirty_thousand(shown):
    data, states = shown(n_states=9)
    skin, missing = skins(data)
    assert missing is None
    n, k = skin["n"], len(skin["labels"])
    assert (n, k) == (len(states.points_mm), 9)
    axes, origin = states.rotations[0], states.positions_mm[0]
    for name, expected in (
        ("points", (states.points_mm - origin) @ axes),
        ("displacements", states.displacements_mm @ axes),
        ("pressures", states.pressures_MPa),
    ):
        found = unpacked(skin[name], *expected.shape)
        np.testing.assert_allclose(found, expected, atol=np.abs(expected).max() / 60_000)
    np.testing.assert_array_equal(np.reshape(skin["triangles"], (-1, 3)), states.triangles)
    # The tool's frame in that of the spot: on its axis, and pressed by the depth.
    np.testing.assert_allclose(
        skin["positions"][-1], [0.0, 0.0, states.depth_mm[0] - states.depth_mm[-1]], atol=1e-3
    )
    np.testing.assert_allclose(skin["rotations"], np.tile(np.eye(3), (k, 1, 1)), atol=1e-5)


def test_pressures_are_in_the_unit_of_the_study(shown):
    data, states = shown()
    name = "soft_tissue.stiffness"
    data = replace(data, factors={name: 1.0}, design=replace(data.design, parameters=tuple(
        replace(p, unit="kPa", kind="modulus") for p in data.design.parameters)))  # fmt: skip
    skin = skins(data)[0]
    assert skin["unit"] == "kPa"
    assert unpacked(skin["pressures"], -1).max() == pytest.approx(1e3 * states.pressures_MPa.max(), rel=1e-3)


def test_a_large_skin_is_cut_around_the_spot_and_a_long_path_is_thinned(shown):
    data, states = shown(n_across=60, n_states=50)
    skin = skins(data)[0]
    size = sum(len(base64.b64decode(skin[name]["data"])) for name in ("displacements", "pressures"))
    assert 0.7 * MOST_BYTES < size <= MOST_BYTES
    points = unpacked(skin["points"], skin["n"], 3)
    whole = (states.points_mm - states.positions_mm[0]) @ states.rotations[0]
    farthest, of_all = (np.linalg.norm(each, axis=1).max() for each in (points, whole))
    assert farthest < 0.75 * of_all
    assert max(skin["triangles"]) == skin["n"] - 1


@given(st.integers(1, 80), st.integers(0, 79))
def test_both_ends_and_the_deepest_state_are_shown(n, last):
    states = dimple(n_across=2, n_states=n, turned=min(last, n - 1))
    chosen = shown_states(states)
    assert {0, n - 1, deepest(states)} <= set(chosen.tolist())
    assert len(chosen) <= MOST_STATES
    assert states.depth_mm[deepest(states)] == states.depth_mm.max()


def test_the_section_comes_with_a_surface_and_lists_its_deepest_state(shown, content):
    data, states = shown(turned=3)
    blocks = list(LimbAndDeformation().blocks(data, UNDRAWN))
    (row,) = blocks[-1].rows
    k = deepest(states)
    assert row[:3] == ["p1", states.depth_mm[k], states.rotation_deg[k]]
    assert row[3] == pytest.approx(np.linalg.norm(states.displacements_mm[k], axis=1).max())
    assert row[5] == pytest.approx((states.areas_mm2 * states.touching)[k].sum())
    tables = make_tables(data)
    page = render(data, tables, make_conclusion(data, tables), [])
    assert 'id="skin"' in page
    without = replace(data, surfaces={})
    assert list(LimbAndDeformation().blocks(without, UNDRAWN)) == []
    assert 'id="skin"' not in render(without, tables, make_conclusion(without, tables), [])


def test_a_skin_without_a_state_or_a_triangle_is_none(shown):
    data, states = shown()
    empty = {
        each: getattr(states, each)[:0]
        for each in SurfaceStates.__dataclass_fields__
        if each not in ("points_mm", "triangles")
    }
    for bare in (replace(states, **empty), replace(states, triangles=states.triangles[:0])):
        assert skins(replace(data, surfaces={"p1": bare})) == [None, None]
    data = replace(data, surfaces={"p1": replace(states, **empty)})
    assert list(LimbAndDeformation().blocks(data, UNDRAWN)) == []
