"""Scans: read, checked, their marks found and named, their bones placed, their segments cut."""

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from palpate.errors import MeshError, PalpateError
from palpate_forearm import Phantom, Scanner, scan, write_phantom
from palpate_limb.bones import by_icp, by_landmarks, read_bones, read_landmarks, read_motion
from palpate_limb.from_scan import ReadScan, read_scan
from palpate_limb.marks import find_marks, locate, name_marks
from palpate_limb.options import BoneFile, ScanOptions
from palpate_limb.repair import BONE_MM, check_size, defects, repaired
from palpate_limb.segment import cut, limb_axis
from palpate_limb.surfaces import LIMB_MM, Surface, read_surface, smoothed

NAMES = {"p1": "red", "p2": "green", "p3": "blue", "p4": "yellow"}
X = np.array([1.0, 0.0, 0.0])
OPTIONS = ScanOptions(unit="mm")


def motion(*turn_deg: float, shift: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix()
    matrix[:3, 3] = shift
    return matrix


@cache
def scanned(shading: float = 0.5, colour_noise: float = 0.03, noise_mm: float = 0.05) -> Surface:
    made = scan(
        Phantom(), Scanner(shading=shading, colour_noise=colour_noise, noise_mm=noise_mm, spacing_mm=1.8)
    )
    return Surface(name="scan.ply", points_mm=made.points_mm, faces=made.faces, colours=made.colours)


@cache
def bone(name: str) -> Surface:
    made = Phantom().bone_surface(name, 2.0)
    return Surface(name=name, points_mm=made.points_mm, faces=made.faces)


@cache
def files(folder: Path) -> Path:
    write_phantom(folder, scanner=Scanner(spacing_mm=2.0))
    return folder


# ----------------------------------------------------------------------- marks


@pytest.mark.slow
@pytest.mark.parametrize(("shading", "noise"), [(0.0, 0.0), (0.5, 0.03), (0.85, 0.06)])
def test_marks_are_found_by_hue_in_any_light(shading: float, noise: float) -> None:
    surface = scanned(shading, noise)
    named = name_marks(find_marks(surface), NAMES, X, surface.name)
    for spot in Phantom().spots:
        found = locate(spot.name, named[spot.name], surface)
        off = found.spot.position_mm - spot.position_mm
        assert np.linalg.norm(off) < 1.0
        assert abs(off @ spot.normal) < 0.1
        assert np.rad2deg(np.arccos(min(1.0, float(found.spot.normal @ spot.normal)))) < 1.2


@pytest.mark.slow
def test_the_stated_uncertainty_is_of_the_size_of_the_errors() -> None:
    """Root mean square errors over 16 spots against the stated standard deviations."""
    across, turned = [], []
    for seed in range(4):
        made = scan(Phantom(), Scanner(seed=seed, spacing_mm=1.8))
        surface = Surface(name="s", points_mm=made.points_mm, faces=made.faces, colours=made.colours)
        named = name_marks(find_marks(surface), NAMES, X, "s")
        for spot in Phantom().spots:
            found = locate(spot.name, named[spot.name], surface)
            off = found.spot.position_mm - spot.position_mm
            off = off - (off @ spot.normal) * spot.normal
            across.append(np.linalg.norm(off) / np.sqrt(2.0) / found.across_mm)
            turned.append(np.rad2deg(np.arccos(found.spot.normal @ spot.normal)) / found.normal_deg)
    assert 0.2 < np.sqrt(np.mean(np.square(across))) < 2.0
    assert 0.2 < np.sqrt(np.mean(np.square(turned))) < 2.0


def test_names_without_colours_go_along_the_limb() -> None:
    marks = find_marks(scanned())
    names: dict[str, str | None] = dict.fromkeys(("a", "b", "c", "d"))
    named = name_marks(marks, names, X, "s")
    stations = [named[name].centre_mm[0] for name in names]
    assert stations == sorted(stations)
    assert name_marks(marks, names, -X, "s")["a"] is named["d"]


@pytest.mark.slow
def test_a_rigid_motion_of_the_scan_moves_the_spots_with_it() -> None:
    turn = motion(20.0, -35.0, 100.0, shift=(10.0, -40.0, 5.0))
    for surface in (scanned(), scanned().moved(turn)):
        assert len(find_marks(surface)) == 4
    before = locate("p1", name_marks(find_marks(scanned()), NAMES, X, "s")["p1"], scanned())
    moved = scanned().moved(turn)
    after = locate("p1", name_marks(find_marks(moved), NAMES, X, "s")["p1"], moved)
    np.testing.assert_allclose(
        after.spot.position_mm, turn[:3, :3] @ before.spot.position_mm + turn[:3, 3], atol=1e-9
    )
    np.testing.assert_allclose(after.spot.normal, turn[:3, :3] @ before.spot.normal, atol=1e-9)


@pytest.mark.slow
def test_too_many_or_too_few_marks_are_listed_with_their_places() -> None:
    surface = scanned()
    listed = r"4 marks found where 5 were named .*green of .* mm² at \((89|90)\."
    with pytest.raises(MeshError, match=listed):
        name_marks(find_marks(surface), dict.fromkeys("abcde"), X, surface.name)
    with pytest.raises(MeshError, match="4 marks found where 1 were named"):
        name_marks(find_marks(surface), {"p1": None}, X, surface.name)
    with pytest.raises(MeshError, match="no mark is magenta"):
        name_marks(find_marks(surface), {"a": "magenta", "b": "green", "c": "blue", "d": "yellow"}, X, "s")


def test_one_of_several_marks_may_be_named_by_its_colour() -> None:
    marks = find_marks(scanned())
    every = name_marks(marks, NAMES, X, "s")
    (spot, colour) = next((spot, colour) for spot, colour in NAMES.items() if colour == "green")
    assert name_marks(marks, {spot: colour}, X, "s") == {spot: every[spot]}
    twice = (*marks, replace(every[spot], centre_mm=every[spot].centre_mm + 20.0))
    with pytest.raises(MeshError, match=r"s: several marks are green\. Found: .* Name them all"):
        name_marks(twice, {spot: colour}, X, "s")


def test_a_scan_without_colours_is_refused() -> None:
    s = scanned()
    with pytest.raises(MeshError, match="no colours"):
        find_marks(Surface(name="s", points_mm=s.points_mm, faces=s.faces))
    grey = np.full_like(s.points_mm, 0.5)
    with pytest.raises(MeshError, match="single colour; no marks found"):
        find_marks(Surface(name="s", points_mm=s.points_mm, faces=s.faces, colours=grey))


# ------------------------------------------------------------- files and checks


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["ply", "obj", "glb"])
def test_every_format_gives_the_same_scan(tmp_path: Path, suffix: str) -> None:
    given = scanned()
    body = given.trimesh
    body.visual.vertex_colors = np.round(255 * given.colours).astype(np.uint8)
    body.export(tmp_path / f"s.{suffix}")
    read = read_surface(tmp_path / f"s.{suffix}")
    assert len(read.points_mm) == len(given.points_mm)
    assert read.volume_mm3 == pytest.approx(given.volume_mm3, rel=1e-5)
    assert sorted(str(m.colour) for m in find_marks(read)) == ["blue", "green", "red", "yellow"]


def test_a_unit_is_applied_and_a_wrong_one_is_named(tmp_path: Path) -> None:
    folder = files(tmp_path)
    assert read_surface(folder / "scan.ply", "cm").points_mm.max() == pytest.approx(2200.0, rel=1e-2)
    with pytest.raises(MeshError, match=r"scan\.ply: its unit"):
        read_surface(folder / "scan.ply", "MPa")
    metres = scanned()
    small = Surface(name="s", points_mm=metres.points_mm / 1000.0, faces=metres.faces)
    with pytest.raises(MeshError, match="perhaps m: say so"):
        check_size(small, LIMB_MM, "mm")
    with pytest.raises(MeshError, match="check its unit"):
        check_size(bone("ulna").moved(np.diag([1e4, 1e4, 1e4, 1.0])), BONE_MM, "mm")


def spoiled(kind: str) -> Surface:
    s = bone("ulna")
    faces, points = s.faces, s.points_mm
    if kind == "hole":
        faces = np.delete(faces, [500, 501, 502], axis=0)
    elif kind == "part":
        faces, points = (
            np.vstack([faces, faces[:1] * 0 + np.arange(3) + len(points)]),
            np.vstack([points, points[:3] + 100.0]),
        )
    elif kind == "edge":
        points = np.vstack([points, points[faces[700, 0]] + [0.0, 0.0, 3.0]])
        faces = np.vstack([faces, [*faces[700, :2], len(points) - 1]])
    elif kind == "crossing":
        points = points.copy()
        points[faces[700, 0]] -= 3.0 * (points[faces[700, 0]] - [points[faces[700, 0], 0], -12.5, -3.0])
    return Surface(name="ulna", points_mm=points, faces=faces)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "what"),
    [("hole", "holes"), ("part", "parts"), ("edge", "more than two"), ("crossing", "faces that intersect")],
)
def test_defects_are_named_with_a_place_and_repaired(kind: str, what: str) -> None:
    broken = spoiled(kind)
    found = [defect for defect in defects(broken) if what in defect]
    assert found, defects(broken)
    assert "first near (" in found[0]
    fixed = repaired(broken)
    assert not defects(fixed)
    assert fixed.volume_mm3 == pytest.approx(bone("ulna").volume_mm3, rel=0.02)


def test_a_valid_surface_is_not_changed() -> None:
    assert defects(bone("ulna")) == []
    assert repaired(bone("ulna")) is bone("ulna")


def test_repair_names_what_it_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pymeshfix", None)
    with pytest.raises(MeshError, match=r'holes.*pip install "palpate-limb\[repair\]"'):
        repaired(spoiled("hole"))
    assert repaired(bone("ulna")) is bone("ulna")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("missing.ply", None, "no such file"),
        ("scan.xyz", b"0 0 0", "reads surfaces from"),
        ("empty.ply", b"", "export"),
        (
            "points.ply",
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
            b"property float z\nend_header\n0 0 0\n",
            "no triangles|cannot be read",
        ),
        ("text.glb", b"hello", "cannot be read"),
        (
            "away.obj",
            b"mtllib ../../etc/passwd\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
            "outside of its folder",
        ),
        ("nan.obj", b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "is at|cannot be read"),
        ("index.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "names points|cannot be read"),
    ],
)
def test_a_broken_file_is_refused(tmp_path: Path, name: str, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(MeshError, match=message):
        read_surface(tmp_path / name)


PLY = b"".join(
    [
        b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n",
        b"property float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n",
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4").tobytes(),
        *(b"\x03" + np.array(f, dtype="<i4").tobytes() for f in ([0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3])),
    ]
)


@given(st.data(), st.sampled_from(["ply", "stl", "obj", "glb"]))
def test_damage_to_a_file_never_escapes_as_anything_but_an_error(data: st.DataObject, suffix: str) -> None:
    import tempfile

    content = bytearray(PLY if suffix == "ply" else data.draw(st.binary(max_size=200)))
    for _ in range(data.draw(st.integers(1, 4)) if content else 0):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"s.{suffix}"
        path.write_bytes(bytes(content[: data.draw(st.integers(0, len(content)))]))
        try:
            surface = read_surface(path)
        except PalpateError:
            return
    assert np.isfinite(surface.points_mm).all()
    assert surface.faces.max() < len(surface.points_mm)


# ----------------------------------------------------------------------- bones


def test_landmarks_and_a_motion_place_the_bones(tmp_path: Path) -> None:
    turn = motion(30.0, -20.0, 70.0, shift=(5.0, 6.0, 7.0))
    source = np.array([[0.0, 0, 0], [100, 0, 0], [50, 30, 0], [20, 10, 25]])
    target = source @ turn[:3, :3].T + turn[:3, 3]
    np.testing.assert_allclose(by_landmarks(source, target).motion, turn, atol=1e-9)
    np.savetxt(tmp_path / "l.csv", np.hstack([source, target]), delimiter=",")
    np.testing.assert_allclose(read_landmarks(tmp_path / "l.csv").motion, turn, atol=1e-9)
    np.savetxt(tmp_path / "m.txt", turn)
    np.testing.assert_allclose(read_motion(tmp_path / "m.txt").motion, turn, atol=1e-12)
    for chosen in ([0, 1, 1], [0, 0, 0]):
        with pytest.raises(MeshError, match="on one line"):
            by_landmarks(source[chosen], target[chosen])
        with pytest.raises(MeshError, match="on one line"):
            by_landmarks(source[:3], target[chosen])
    np.savetxt(tmp_path / "m.txt", 2.0 * turn)
    with pytest.raises(MeshError, match="not a rigid motion"):
        read_motion(tmp_path / "m.txt")


def test_a_reference_is_laid_onto_the_scan() -> None:
    turn = motion(6.0, -4.0, 5.0, shift=(4.0, -3.0, 6.0))
    skin = Phantom().skin_surface(3.0)
    reference = Surface(name="mould", points_mm=skin.points_mm, faces=skin.faces)
    placed = by_icp(reference, scanned().moved(turn), n_points=600)
    off = np.linalg.inv(turn) @ placed.motion
    assert np.abs(off[:3, 3]).max() < 0.5, "mm, along the limb too"
    assert np.rad2deg(Rotation.from_matrix(off[:3, :3]).magnitude()) < 0.5
    assert placed.residual_mm < 0.2


def test_a_bone_with_holes_is_closed_when_it_is_read(tmp_path: Path) -> None:
    spoiled("hole").trimesh.export(tmp_path / "ulna.stl")
    (read,) = read_bones(tmp_path / "ulna.stl")
    assert read.name == "ulna"
    assert not defects(read)


MYO_SIM = Path(__file__).parent / "data" / "myo_sim"


@pytest.mark.parametrize(("name", "holes", "length_mm"), [("radius", 3, 246.0), ("ulna", 3, 259.7)])
def test_bones_as_others_publish_them_are_closed_and_repairs_are_reported(
    name: str, holes: int, length_mm: float
) -> None:
    """MyoSim's bones: in metres, with holes and edges of three faces. A forearm's bone has 20 to 60 cm³."""
    with pytest.raises(MeshError, match="its unit is perhaps m: say so"):
        read_bones(MYO_SIM / f"{name}.stl")
    (read,) = read_bones(MYO_SIM / f"{name}.stl", "m")
    assert not defects(read)
    assert f"{holes} holes" in read.repairs
    assert "edges of more than two faces" in read.repairs
    assert "changed by" in read.repairs
    assert np.ptp(read.points_mm, axis=0).max() == pytest.approx(length_mm, abs=0.1)
    assert 20e3 < read.volume_mm3 < 60e3


@pytest.mark.slow
def test_a_scan_that_is_inside_out_has_the_same_normals(tmp_path: Path) -> None:
    body = scanned().trimesh
    body.visual.vertex_colors = np.round(255 * scanned().colours).astype(np.uint8)
    body.invert()
    body.export(tmp_path / "s.ply")
    found = read_scan(tmp_path / "s.ply", OPTIONS)
    for spot in Phantom().spots:
        assert found.spots[spot.name].spot.normal @ spot.normal > 0.99


def test_smoothing_takes_the_noise_and_leaves_the_limb() -> None:
    """Against the phantom's own sections: noise halves, while volume and mean distance stay."""
    noisy = scanned()
    smooth = smoothed(noisy, 20)

    def off(surface: Surface) -> np.ndarray:
        inner = surface.points_mm[np.abs(surface.points_mm[:, 0] - 110.0) < 95.0]
        a, b = Phantom().half_axes_mm(inner[:, 0]).T
        share = np.hypot(inner[:, 1] / a, inner[:, 2] / b) - 1.0
        return share * np.hypot(inner[:, 1], inner[:, 2])

    assert off(smooth).std() < 0.55 * off(noisy).std()
    assert abs(off(smooth).mean()) < 0.02
    assert smooth.volume_mm3 == pytest.approx(noisy.volume_mm3, rel=2e-3)
    assert smooth.colours is noisy.colours
    moved = np.linalg.norm(smooth.points_mm - noisy.points_mm, axis=1)
    assert moved.max() < 0.5, "the rims of the flat ends stay too"
    assert smoothed(noisy, 0) is noisy


# --------------------------------------------------------------------- segment


def test_a_segment_is_the_limb_between_the_cuts_without_its_bones() -> None:
    """Volume against the integral of the sections, at right angles to the limb's axis."""
    phantom = Phantom()
    skin = phantom.skin_surface(1.5)
    surface = Surface(name="s", points_mm=skin.points_mm, faces=skin.faces)
    spot = phantom.spots[1]
    segment = cut(surface, [bone("radius"), bone("ulna")], spot, X, 80.0)
    stations = np.linspace(50.0, 130.0, 801)
    a, b = phantom.half_axes_mm(stations).T
    tissue = np.pi * a * b
    for each in phantom.bones:
        start, end = np.array(each.start_mm), np.array(each.end_mm)
        share = (stations - start[0]) / (end[0] - start[0])
        radius = each.start_radius_mm + share * (each.end_radius_mm - each.start_radius_mm)
        tissue -= np.pi * radius**2 * np.linalg.norm(end - start) / (end[0] - start[0])
    assert segment.tissue.volume_mm3 == pytest.approx(np.trapezoid(tissue, stations), rel=4e-3)
    np.testing.assert_allclose(
        segment.to_spot[:3, :3] @ spot.position_mm + segment.to_spot[:3, 3], 0.0, atol=1e-9
    )
    np.testing.assert_allclose(segment.to_spot[:3, :3] @ spot.normal, [0, 0, 1], atol=1e-12)
    along = segment.tissue.points_mm @ segment.axis
    assert (along.min(), along.max()) == pytest.approx((-40.0, 40.0))


@pytest.mark.slow
@pytest.mark.parametrize("k", range(4))
def test_every_segment_lacks_both_bones(k: int) -> None:
    phantom = Phantom()
    skin = phantom.skin_surface(2.4)
    surface = Surface(name="s", points_mm=skin.points_mm, faces=skin.faces)
    segment = cut(surface, [bone("radius"), bone("ulna")], phantom.spots[k], limb_axis(surface))
    assert [b.name for b in segment.bones] == ["radius", "ulna"]
    for each in segment.bones:
        middle = each.points_mm[np.abs(each.points_mm @ segment.axis) < 30.0]
        _, gaps = segment.tissue.nearest(middle)
        assert gaps.max() < 1e-3, "the tissue's surface is the bone's"


def test_a_bone_within_the_segment_counts_and_one_outside_does_not() -> None:
    """A knee cap is a hole that reaches no cut; a bone of the hand is none of this segment's."""
    phantom = Phantom()
    skin = phantom.skin_surface(2.4)
    surface = Surface(name="s", points_mm=skin.points_mm, faces=skin.faces)
    ulna = bone("ulna")
    cap = Surface(name="cap", points_mm=ulna.points_mm * [0.1, 1.0, 1.0] + [80.0, 0.0, 0.0], faces=ulna.faces)
    far = Surface(name="far", points_mm=cap.points_mm + np.array([90.0, 0.0, 0.0]), faces=ulna.faces)
    segment = cut(surface, [cap, far], phantom.spots[1], X)
    assert [b.name for b in segment.bones] == ["cap"]
    whole = cut(surface, [], phantom.spots[1], X).tissue.volume_mm3
    assert segment.tissue.volume_mm3 == pytest.approx(whole - cap.volume_mm3, rel=1e-9)
    middle = segment.bones[0].points_mm.mean(axis=0)
    assert not segment.tissue.contains(middle[None])[0]


def test_the_axis_of_the_limb_is_found() -> None:
    axis = limb_axis(scanned().moved(motion(10.0, 40.0, -20.0)))
    expected = motion(10.0, 40.0, -20.0)[:3, :3] @ X
    assert abs(axis @ expected) > np.cos(np.deg2rad(3.0))


def test_bones_out_of_place_and_marks_at_an_end_are_refused() -> None:
    surface, spot = scanned(), Phantom().spots[1]
    out = bone("ulna").moved(motion(0, 0, 0, shift=(0.0, -18.0, 0.0)))
    with pytest.raises(MeshError, match=r"bone 'ulna' leaves the skin, by .* near \["):
        cut(surface, [out], spot, X)
    with pytest.raises(MeshError, match="bone 'radius' crosses bone 'radius'"):
        cut(surface, [bone("radius"), bone("radius")], spot, X)
    with pytest.raises(MeshError, match=r"the scan reaches 9\d"):
        cut(surface, [], spot, X, length_mm=200.0)
    with pytest.raises(MeshError, match="points along the limb"):
        cut(surface, [], spot, spot.normal)


def test_a_scan_and_its_bones_are_read_together(tmp_path: Path) -> None:
    folder = files(tmp_path)

    def read_with(*names: str) -> ReadScan:
        bones = [BoneFile(folder / f"{name}.stl") for name in names]
        return read_scan(folder / "scan.ply", OPTIONS.model_copy(update={"bones": bones}))

    read = read_with("radius", "ulna")
    assert list(read.spots) == ["p1", "p2", "p3", "p4"]
    assert [b.name for b in read.bones] == ["radius", "ulna"]
    with pytest.raises(MeshError, match="that name is taken"):
        read_with("radius", "radius")
    for name in ("skin", "bonded"):  # names of other sets of a mesh
        (folder / f"{name}.stl").write_bytes((folder / "ulna.stl").read_bytes())
        with pytest.raises(MeshError, match=f"'{name}': that name is taken"):
            read_with(name)
