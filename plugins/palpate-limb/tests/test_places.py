"""Surfaces without colours: their unit, openings and parts, and spots by place."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings, strategies as st

from palpate.cli.app import main
from palpate.errors import MeshError
from palpate_limb.bones import covered, read_bones
from palpate_limb.from_scan import ReadScan, read_scan
from palpate_limb.marks import locate_at
from palpate_limb.options import BoneFile, ScanOptions
from palpate_limb.places import Around, Station, place_of, position_mm
from palpate_limb.repair import closed, defects, largest, parts, repaired
from palpate_limb.segment import cut
from palpate_limb.surfaces import Surface, guessed_unit, mm_per_unit

RADIUS, LENGTH = 30.0, 200.0
UP = np.array([0.0, 0.0, 1.0])
OPTIONS = ScanOptions(unit="mm", smoothing=0)


@cache
def tube(radius: float = RADIUS, length: float = LENGTH, shift: float = 0.0) -> Surface:
    """A closed cylinder along z, its lower end at 0."""
    rings = np.linspace(0.0, length, int(length / 4.0))
    side = np.column_stack([np.full(len(rings), radius), rings])
    lid = np.linspace(0.0, radius, max(2, int(radius / 4.0)))[:-1]
    ends = np.column_stack([lid, np.zeros(len(lid))])
    line = np.vstack([ends, side, (ends + np.array([0.0, length]))[::-1]])
    body = trimesh.creation.revolve(line, sections=48)
    points = np.asarray(body.vertices) + np.array([shift, 0.0, 0.0])
    return Surface(name="tube", points_mm=points, faces=np.asarray(body.faces, dtype=np.int64))


def without(surface: Surface, lost: np.ndarray) -> Surface:
    return largest(parts(replace(surface, faces=surface.faces[~lost])))


def open_tube() -> Surface:
    """The cylinder without its upper end."""
    z = tube().points_mm[tube().faces][:, :, 2]
    return without(tube(), z.min(axis=1) > LENGTH - 1e-6)


def lifted(surface: Surface) -> Surface:
    """10 mm higher, away from the lower end of the tube."""
    return replace(surface, points_mm=surface.points_mm + 10.0 * UP)


def around(bones: tuple[Surface, ...] = ()) -> Around:
    return Around(
        skin=tube(),
        bones=bones,
        axis=UP,
        span_mm=(0.0, LENGTH),
        zero=np.array([1.0, 0.0, 0.0]),
        mm_per_unit=1.0,
    )


# ------------------------------------------------------------------- openings


def test_an_open_end_is_closed_and_its_cap_is_known() -> None:
    whole = closed(open_tube())
    assert defects(whole) == []
    assert whole.volume_mm3 == pytest.approx(tube().volume_mm3, rel=1e-9)
    assert whole.caps is not None
    np.testing.assert_allclose(whole.points_mm[whole.faces[whole.caps]][:, :, 2], LENGTH, atol=1e-6)
    assert "closed an opening of" in whole.repairs


def test_missing_triangles_are_filled_in_even_where_their_rims_touch() -> None:
    point = int(np.abs(tube().points_mm - [RADIUS, 0.0, 100.0]).sum(axis=1).argmin())
    fan = np.flatnonzero((tube().faces == point).any(axis=1))
    # Two faces that share this point alone: rims that touch in it.
    apart = next(
        (a, b) for a in fan for b in fan if len(np.intersect1d(tube().faces[a], tube().faces[b])) == 1
    )
    lost = np.isin(np.arange(len(tube().faces)), apart)
    whole = closed(without(tube(), lost))
    assert defects(whole) == []
    assert whole.caps is None
    assert whole.volume_mm3 == pytest.approx(tube().volume_mm3, rel=1e-12)


@pytest.mark.slow
@settings(max_examples=8)
@given(st.integers(0, 10_000), st.integers(1, 40))
def test_whatever_faces_are_missing_a_closed_surface_comes_back(seed: int, n: int) -> None:
    lost = np.random.default_rng(seed).choice(len(tube().faces), n, replace=False)
    whole = closed(without(tube(), np.isin(np.arange(len(tube().faces)), lost)))
    assert not [d for d in defects(whole) if " holes" in d or "edges of more" in d]
    assert whole.volume_mm3 == pytest.approx(tube().volume_mm3, rel=0.02)


def test_stray_parts_are_left_out_and_large_ones_kept() -> None:
    n = len(tube().points_mm)
    stray = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]) + 300.0
    both = replace(
        tube(),
        points_mm=np.vstack([tube().points_mm, stray]),
        faces=np.vstack([tube().faces, [[n, n + 1, n + 2]]]),
    )
    (only,) = parts(both)
    assert len(only.faces) == len(tube().faces)
    assert only.repairs == "left out 1 stray part"


def test_a_few_crossing_faces_are_cut_out_and_closed() -> None:
    points = tube().points_mm.copy()
    point = int(np.abs(points - [RADIUS, 0.0, 100.0]).sum(axis=1).argmin())
    points[point] += [-6.0, 20.0, 0.0]
    broken = replace(tube(), points_mm=points)
    (defect,) = defects(broken)
    assert "faces that intersect, first near (" in defect
    fixed = repaired(broken)
    assert defects(fixed) == []
    assert "repaired" in fixed.repairs
    assert fixed.volume_mm3 == pytest.approx(tube().volume_mm3, rel=0.02)


def test_a_gap_that_a_repair_leaves_is_skin_and_no_hole(tmp_path: Path) -> None:
    points = tube().points_mm.copy()
    points[int(np.abs(points - [RADIUS, 0.0, 100.0]).sum(axis=1).argmin())] += [-6.0, 30.0, 0.0]
    file = write(tmp_path, "crossing.stl", replace(tube(), points_mm=points))
    spot = {"p1": "50%,180deg"}
    read = read_scan(file, OPTIONS.model_copy(update={"repair": True, "spot": spot}))
    assert "faces that intersect" in read.surface.repairs
    tissue = cut(read.surface, [], read.spots["p1"].spot, UP).tissue
    assert tissue.volume_mm3 == pytest.approx(80.0 * np.pi * RADIUS**2, rel=0.02)


# ------------------------------------------------------------------------ unit


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1.0), ("cm", 10.0), ("m", 1000.0)])
def test_the_unit_in_which_a_surface_is_a_limb_is_found(unit: str, factor: float) -> None:
    limb = replace(tube(), points_mm=tube().points_mm * 2.5 / factor)
    found, why = guessed_unit(limb)
    assert found == unit
    assert f"{500.0 / factor:.4g} long" in why


def test_a_size_that_leaves_the_unit_open_is_refused() -> None:
    with pytest.raises(MeshError, match="a limb in cm and inch; say so under unit"):
        guessed_unit(replace(tube(), points_mm=0.1 * tube().points_mm))
    with pytest.raises(MeshError, match="a limb in no unit"):
        guessed_unit(replace(tube(), points_mm=1e6 * tube().points_mm))
    assert mm_per_unit("365 mm") == 365.0
    assert mm_per_unit("m") == 1000.0


# ---------------------------------------------------------------------- places


@given(st.floats(0.05, 0.95), st.floats(-180.0, 180.0))
def test_a_share_and_an_angle_are_where_they_say(share: float, angle: float) -> None:
    at = position_mm("p", Station(share=share, angle_deg=angle), around())
    assert at[2] == pytest.approx(share * LENGTH)
    assert np.hypot(at[0], at[1]) == pytest.approx(RADIUS, rel=3e-3)
    turn = np.rad2deg(np.arctan2(at[1], at[0])) - angle
    assert (turn + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-6)
    found = locate_at("p", at, tube())
    radial = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle)), 0.0])
    assert found.spot.normal @ radial > np.cos(np.deg2rad(4.0))


def test_a_share_of_a_bone_is_over_it_or_around_the_limb() -> None:
    bone = replace(tube(5.0, 100.0, shift=15.0), name="ulna")
    near = position_mm("p", place_of("ulna:50%"), around((bone,)))
    assert near[2] == pytest.approx(50.0, abs=3.0)
    np.testing.assert_allclose(near[:2], [RADIUS, 0.0], atol=1.0)
    opposite = position_mm("p", place_of("ulna:120%,180deg"), around((bone,)))
    np.testing.assert_allclose(opposite, [-RADIUS, 0.0, 120.0], atol=0.1)
    with pytest.raises(MeshError, match="beyond bone 'ulna'"):
        position_mm("p", place_of("ulna:120%"), around((bone,)))
    with pytest.raises(MeshError, match=r"no bone 'radius' \(there: ulna\)"):
        position_mm("p", place_of("radius:20%"), around((bone,)))


def test_a_point_lies_on_the_skin() -> None:
    np.testing.assert_array_equal(place_of("1.5,-29,80"), [1.5, -29.0, 80.0])
    place = place_of("0,29.5,40")
    np.testing.assert_allclose(position_mm("a", place, around()), [0.0, 30.0, 40.0], atol=0.1)
    with pytest.raises(MeshError, match=r"spot 'a': \(0, 59, 80\) mm is 29 mm from tube"):
        position_mm("a", place, replace(around(), mm_per_unit=2.0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("45%", "Add an angle"),
        ("45%,120", "has no unit"),
        ("1,2", "give x,y,z"),
        ("1,2,inf", "give x,y,z"),
        ("elbow", "a share of a bone"),
    ],
)
def test_a_place_that_means_nothing_is_refused(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        place_of(text)


def test_a_station_off_the_limb_and_an_angle_along_it_are_refused() -> None:
    with pytest.raises(MeshError, match="reaches from 0 to 200 mm"):
        position_mm("p", Station(share=1.1, angle_deg=0.0), around())
    with pytest.raises(MeshError, match="would be along the limb"):
        position_mm("p", Station(share=0.5, angle_deg=0.0), replace(around(), zero=np.array([0.0, 0.0, 1.0])))


def test_the_uncertainty_on_a_coarse_surface_counts_its_own_points_alone() -> None:
    """0.3 mm of noise on points 4 mm apart: root mean square of the normal's error over what is stated."""
    turned = []
    for seed in range(40):
        random = np.random.default_rng(seed)
        points = tube().points_mm.copy()
        points[:, :2] *= 1.0 + random.normal(0.0, 0.3 / RADIUS, len(points))[:, None]
        angle = random.uniform(0.0, 2.0 * np.pi)
        radial = np.array([np.cos(angle), np.sin(angle), 0.0])
        noisy = replace(tube(), points_mm=points)
        at, _ = noisy.nearest((RADIUS * radial + random.uniform(80.0, 120.0) * UP)[None])
        found = locate_at("p", at[0], noisy)
        assert "points of the scan within 8 mm of the spot, where 18" in found.remarks[0]
        turned.append(np.rad2deg(np.arccos(found.spot.normal @ radial)) / found.normal_deg)
    assert 0.5 < np.sqrt(np.mean(np.square(turned))) < 2.0
    fine = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS)
    ball = Surface(name="ball", points_mm=np.asarray(fine.vertices), faces=np.asarray(fine.faces))
    assert locate_at("p", RADIUS * UP, ball).remarks == ()


# ------------------------------------------------------------ bones and segments


def write(folder: Path, name: str, *bodies: Surface, unit_mm: float = 1.0) -> Path:
    trimesh.util.concatenate([body.trimesh for body in bodies]).apply_scale(1.0 / unit_mm).export(
        folder / name
    )
    return folder / name


def test_the_bones_of_a_file_come_apart_and_take_their_names(tmp_path: Path) -> None:
    thick, thin = tube(8.0, 90.0, shift=-14.0), tube(4.0, 90.0, shift=14.0)
    cavity = replace(tube(5.0, 80.0, shift=-14.0), faces=tube(5.0, 80.0, shift=-14.0).faces[:, ::-1])
    bones = write(tmp_path, "bones.stl", thin, thick, replace(cavity, points_mm=cavity.points_mm + UP * 5.0))
    assert [bone.name for bone in read_bones(bones)] == ["bones-1", "bones-2"]
    named = read_bones(bones, names=("ulna", "radius"))
    assert [bone.name for bone in named] == ["ulna", "radius"]
    assert named[1].volume_mm3 == pytest.approx(thick.volume_mm3, rel=1e-5)
    with pytest.raises(MeshError, match=r"2 bones, in its order about \(14, .*, not 1 \(ulna\)"):
        read_bones(bones, names=("ulna",))


@pytest.mark.slow
def test_skin_and_bones_may_be_in_one_file(tmp_path: Path) -> None:
    whole = write(tmp_path, "limb.stl", open_tube(), lifted(tube(8.0, 150.0)), unit_mm=1000.0)

    def read_with(bone: BoneFile | None, **more: object) -> ReadScan:
        update = {"spot": {"p1": "50%,90deg"}, "unit": None, "bones": [bone] if bone else []}
        return read_scan(whole, OPTIONS.model_copy(update=update | more))

    tibia = BoneFile(whole, ("tibia",))
    read = read_with(tibia)
    assert (read.unit, read.bones[0].name) == ("m", "tibia")
    np.testing.assert_allclose(read.spots["p1"].spot.position_mm, [0.0, RADIUS, 100.0], atol=0.3)
    with pytest.raises(MeshError, match="if its parts are bones, name the file under bones too"):
        read_with(None, unit="m")
    by_bone = read_with(tibia, axis="tibia")
    np.testing.assert_allclose(by_bone.spots["p1"].spot.position_mm[2], 85.0, atol=0.3)
    with pytest.raises(MeshError, match=r"axis 'ulna': no such bone \(there: tibia\)"):
        read_with(tibia, axis="ulna")
    whole = write(tmp_path, "alone.stl", tube())
    with pytest.raises(MeshError, match="no bone besides the skin"):
        read_with(BoneFile(whole))


def test_a_hole_in_the_segment_is_refused_and_one_beyond_it_closed() -> None:
    whole, axis = closed(open_tube()), UP
    low = locate_at("p1", np.array([RADIUS, 0.0, 60.0]), whole).spot
    assert cut(whole, [], low, axis).tissue.volume_mm3 == pytest.approx(80.0 * np.pi * RADIUS**2, rel=0.01)
    with pytest.raises(
        MeshError, match=r"spot 'p1': the scan has a hole 50 mm along the limb from it, near \["
    ):
        cut(whole, [], replace(low, position_mm=low.position_mm + UP * 90.0), axis, 100.0)


def test_a_segment_ends_with_a_stump_but_with_no_scan() -> None:
    axis = UP
    spot = locate_at("p1", np.array([RADIUS, 0.0, 30.0]), tube()).spot
    with pytest.raises(MeshError, match="stump = true"):
        cut(tube(), [], spot, axis)
    segment = cut(tube(), [], spot, axis, stump=True)
    assert segment.tissue.volume_mm3 == pytest.approx(70.0 * np.pi * RADIUS**2, rel=0.01)


def test_bones_that_touch_are_one_hole_and_bones_that_cross_are_refused() -> None:
    axis, bone = UP, replace(tube(6.0, LENGTH), name="a")
    spot = locate_at("p1", np.array([0.0, RADIUS, 100.0]), tube()).spot
    touching = replace(tube(6.0, LENGTH, shift=11.9), name="b")
    segment = cut(tube(), [bone, touching], spot, axis)
    assert segment.remarks[0].startswith("bone 'b' touches bone 'a': they share")
    with pytest.raises(MeshError, match="bone 'b' crosses bone 'a'"):
        cut(tube(), [bone, replace(tube(6.0, LENGTH, shift=9.0), name="b")], spot, axis)


def test_bones_of_another_frame_are_remarked_where_none_is_left() -> None:
    spot = locate_at("p1", np.array([0.0, RADIUS, 100.0]), tube()).spot
    bone = replace(tube(6.0, 50.0), name="a")
    elsewhere = replace(bone, points_mm=bone.points_mm * [-1.0, 1.0, 1.0] - 300.0 * UP)
    segment = cut(tube(), [replace(elsewhere, faces=bone.faces[:, ::-1])], spot, UP)
    assert segment.bones == ()
    assert segment.remarks == (
        "no bone is between the cuts (given: a); check that all are in the scan's frame",
    )
    assert cut(tube(), [], spot, UP).remarks == ()


def test_a_bone_in_another_is_refused_however_large_the_other_bones_are() -> None:
    spot = locate_at("p1", np.array([0.0, RADIUS, 100.0]), tube()).spot
    thin, far, around_thin = (
        replace(tube(radius, LENGTH, shift=shift), name=name)
        for name, radius, shift in (("thin", 1.0, -10.0), ("far", 8.0, 12.0), ("shell", 8.0, -10.0))
    )
    for bones in ([thin, far, around_thin], [around_thin, far, thin]):
        with pytest.raises(MeshError, match="crosses bone"):
            cut(tube(), bones, spot, UP)


def test_a_bone_at_the_skin_is_moved_inwards_where_a_cover_is_asked_for() -> None:
    axis, bone = UP, replace(lifted(tube(8.0, 180.0, shift=21.9)), name="a")
    spot = locate_at("p1", np.array([0.0, RADIUS, 100.0]), tube()).spot
    with pytest.raises(MeshError, match=r"bone 'a' touches the skin .*\(cover moves it inwards\)"):
        cut(tube(), [bone], spot, axis)
    inside = covered(bone, tube(), 1.5)
    assert tube().nearest(inside.points_mm)[1].min() == pytest.approx(1.5, abs=0.05)
    assert "points moved inwards by 1.4 mm at most" in inside.repairs
    assert cut(tube(), [inside], spot, axis).bones[0].name == "a"
    assert covered(inside, tube(), 0.1) is inside


# --------------------------------------------------------------------- command


@pytest.mark.slow
def test_an_uncoloured_model_is_meshed_by_a_file_of_options(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path, "skin.stl", open_tube(), unit_mm=1000.0)
    write(tmp_path, "bone.stl", lifted(tube(8.0, 180.0)), unit_mm=1000.0)
    (tmp_path / "limb.toml").write_text(
        'bones = ["core=bone.stl"]\nspot = { p1 = "core:30%,90deg" }\nlength = "36 mm"\nsize = "9 mm"\n'
        'into = "meshes"\nsmoothing = 0\n'
    )
    assert main(["limb", str(tmp_path / "skin.stl"), "--options", str(tmp_path / "limb.toml")]) == 0
    shown = capsys.readouterr()
    assert "so its unit is taken to be m;" in " ".join(shown.err.split())
    note = json.loads((tmp_path / "meshes" / "p1.json").read_text())
    assert (note["unit"], note["unit_guessed"], note["bones"]) == ("m", True, ["core"])
    np.testing.assert_allclose(note["position_in_scan_mm"], [0.0, RADIUS, 64.0], atol=0.3)
    used = note["options"]
    assert (used["spot"], used["size"], used["smoothing"]) == ({"p1": "core:30%,90deg"}, "9 mm", 0)
    again = ScanOptions.model_validate(used, context={"folder": Path()})
    assert again.model_dump(mode="json", exclude_none=True, exclude={"mark"}) == used
    assert again.bones == [BoneFile(tmp_path / "bone.stl", ("core",))]
    assert note["quality"]["volume_error"] == pytest.approx(0.0, abs=0.01)
