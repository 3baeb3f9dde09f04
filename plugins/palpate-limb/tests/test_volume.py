"""Volumes: sizes, elements on the true surfaces, regions, quality, and the command that writes them."""

import json
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import meshio
import numpy as np
import pytest

from palpate.cli.app import main
from palpate.domain import Limb, Mesh, Spot
from palpate.errors import MeshError, PluginError
from palpate.limb.checks import check_fine, check_limb
from palpate.mesh.specimens import block
from palpate.mesh.spot_frame import contact_edge_mm
from palpate.mesh.topology import outer_faces
from palpate_forearm import CrossSection, InkMark, Phantom, PhantomBone, Scanner, write_phantom
from palpate_indentation import MeshioSettings, MeshioSource
from palpate_limb import from_scan, volume
from palpate_limb.from_scan import layers_at_bone, sound_mesh
from palpate_limb.layers import _inside, below_skin, extruded
from palpate_limb.meshing import GROWTH, MIDDLE, SKIN_FALLS, SizeField, run_ftetwild
from palpate_limb.options import ScanOptions
from palpate_limb.quality import assess, cell_volumes, check_quality, dihedral_angles_deg, scaled_jacobians
from palpate_limb.segment import Segment, cut, gap_of_bones
from palpate_limb.surfaces import Surface
from palpate_limb.volume import COVER_MM, MeshPlan, mesh_segment, moved_to_contact

SMALL = Phantom(
    sections=tuple(
        CrossSection(station_mm=s, half_width_mm=w, half_height_mm=h)
        for s, w, h in ((0, 16, 13), (70, 18, 15))
    ),
    bones=(
        PhantomBone(
            name="bone", start_mm=(-4, 0, -2), end_mm=(74, 0, -3), start_radius_mm=4, end_radius_mm=4.5
        ),
    ),
    marks=(InkMark(name="p1", station_mm=35.0, angle_deg=90.0, colour=(0.05, 0.55, 0.15)),),
)
SIZE = SizeField(fine_mm=4.0, coarse_mm=14.0, radius_mm=6.0)


@cache
def segment() -> Segment:
    skin, bone = SMALL.skin_surface(1.2), SMALL.bone_surface("bone", 1.0)
    return cut(
        Surface(name="s", points_mm=skin.points_mm, faces=skin.faces),
        [Surface(name="bone", points_mm=bone.points_mm, faces=bone.faces)],
        SMALL.spots[0],
        np.array([1.0, 0.0, 0.0]),
        40.0,
    )


@cache
def layered() -> Limb:
    return sound_mesh(segment(), MeshPlan(size=replace(SIZE, fine_mm=3.2), layers_mm={"skin": 2.5}))


@cache
def below() -> Surface:
    return below_skin(segment(), 2.5)


def test_the_size_field_is_fine_on_its_ring_and_grows_away_from_it() -> None:
    falls, places = SKIN_FALLS * SIZE.radius_mm, [[0.0, 0, 0], [6, 0, 0], [0, 11, 0], [99, 0, 0]]
    of_disc = SIZE.at(np.array([*places, [0.0, 0, -falls], [0, 0, -falls - 5.0]]))
    np.testing.assert_allclose(of_disc, [4.0, 4.0, 4.0 + 5.0 * GROWTH, 14.0, 4.0, 4.0 + 5.0 * GROWTH])
    ring = replace(SIZE, inner_mm=4.0)
    middle, inside, on_ring, beyond = ring.at(np.array([places[0], [3.5, 0, 0], [0, -5.0, 0], places[2]]))
    assert (middle, inside) == pytest.approx((4.0 * MIDDLE, 4.0 + 0.5 * GROWTH))
    assert (on_ring, beyond) == pytest.approx((4.0, 4.0 + 5.0 * GROWTH))
    (below_layers,) = replace(ring, deep_mm=7.0).at(np.array([[5.0, 0, -7.0 - falls]]))
    assert below_layers == 4.0, "as fine as above"
    points, cells, values = SIZE.background(np.full(3, -10.0), np.full(3, 10.0))
    corners = points[cells]
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    assert volumes.min() > 0.0
    assert volumes.sum() == pytest.approx(26.0**3)
    assert values.shape == (len(points),)


def test_a_regular_tetrahedron_is_perfect_and_a_folded_one_negative() -> None:
    points = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    cells = np.array([[0, 1, 3, 2]])
    if np.linalg.det(points[cells[0, 1:]] - points[cells[0, 0]]) < 0:
        cells = np.array([[0, 1, 2, 3]])
    assert scaled_jacobians(points, cells)[0] == pytest.approx(1.0)
    assert scaled_jacobians(points, cells[:, [0, 2, 1, 3]])[0] == pytest.approx(-1.0)
    np.testing.assert_allclose(dihedral_angles_deg(points, cells), np.rad2deg(np.arccos(1 / 3)))
    assert cell_volumes(points, cells)[0] == pytest.approx(8.0 / 3.0)


def test_a_bent_edge_lowers_the_quality_before_it_folds_the_element() -> None:
    mesh = block("tet10", n_across=2, n_down=2).mesh
    cells, points = mesh.cells["tet10"], mesh.points_mm.copy()
    before = scaled_jacobians(points, cells)
    assert cell_volumes(points, cells).sum() == pytest.approx(36.0 * 36.0 * 18.0)
    points[cells[0, 4]] += 0.45 * (points[cells[0, 2]] - points[cells[0, 4]])
    after = scaled_jacobians(points, cells)
    assert after[0] < 0.5 * before[0]


@pytest.mark.slow
def test_the_level_below_the_skin_is_at_its_depth() -> None:
    surface = below()
    middle = surface.points_mm[np.abs(surface.points_mm @ segment().axis) < 15.0]
    _, depth = segment().skin.nearest(middle)
    np.testing.assert_allclose(depth, 2.5, atol=0.05)
    assert surface.volume_mm3 > 0.0
    with pytest.raises(MeshError, match="leaves nothing"):
        below_skin(segment(), 20.0)


@pytest.mark.slow
def test_a_layered_mesh_is_on_its_surfaces_and_can_be_simulated() -> None:
    limb = layered()
    mesh = limb.mesh
    check_limb(limb, ["skin", "soft_tissue"])
    on_skin = mesh.points_mm[mesh.node_sets["contact"]]
    _, off = segment().skin.nearest(on_skin)
    assert np.quantile(off, 0.9) < 0.02, "midside nodes are on the skin too"
    bone = mesh.points_mm[mesh.node_sets["bone"]]
    assert np.quantile(segment().bones[0].nearest(bone)[1], 0.9) < 0.05
    cuts = mesh.points_mm[mesh.node_sets["cut"]] @ segment().axis
    off = np.abs(np.abs(cuts) - 20.0)
    assert (np.quantile(off, 0.98) < 0.05, off.max() < 0.3) == (True, True)
    assert set(mesh.node_sets["fixed"]) == set(mesh.node_sets["cut"]) | set(mesh.node_sets["bone"])
    quality = assess(limb, segment(), 6.0)
    check_quality(quality, "p1", 3.2)
    assert quality.contact_edge_mm == pytest.approx(3.2, rel=0.25), "the size asked for"
    assert abs(quality.volume_error) < 0.01
    mean, sd = quality.layers_mm["skin"]
    assert (mean, sd < 0.05) == (pytest.approx(2.5, abs=0.05), True), "the thickness asked for"
    middles = mesh.points_mm[mesh.cells["tet10"][:, :4]].mean(axis=1)
    np.testing.assert_array_equal(below().contains(middles), mesh.cell_regions["tet10"])
    # Skin of 2.5 mm around 40 mm of limb, from the half-axes at its middle; 5 % are 0.12 mm of thickness.
    outer, inner = 17.0 * 14.0, 14.5 * 11.5
    assert quality.regions["skin"] == pytest.approx((outer - inner) / (outer - 4.25**2), rel=0.05)


@pytest.mark.parametrize("depths", [(3.0,), (1.0, 3.0)])
def test_extruded_layers_fill_what_is_between_core_and_skin(depths: tuple[float, ...]) -> None:
    core = block("tet4", n_across=3, n_down=2).mesh
    tets, points = core.cells["tet4"], core.points_mm
    faces = outer_faces("tet4", tets)
    top = (points[faces, 2] == 0.0).all(axis=1)
    square = np.array([[-40.0, -40, 3], [40, -40, 3], [40, 40, 3], [-40, 40, 3]])
    skin = Surface(name="plane", points_mm=square, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    points, tets, layers, boundary, wanted = extruded(
        points, tets, {"skin": faces[top], "cut": faces[~top]}, skin, depths
    )
    np.testing.assert_allclose(3.0 - points[~np.isnan(wanted), 2], wanted[~np.isnan(wanted)])
    volumes = np.abs(np.linalg.det(points[tets[:, 1:]] - points[tets[:, :1]])) / 6.0
    thickness = [*np.diff([0.0, *depths]), 18.0]
    np.testing.assert_allclose(np.bincount(layers, volumes), 36.0**2 * np.array(thickness))
    made = {tuple(sorted(face)) for face in np.concatenate(list(boundary.values())).tolist()}
    assert made == {tuple(sorted(face)) for face in outer_faces("tet4", tets).tolist()}, "no crack"
    np.testing.assert_allclose(points[boundary["skin"], 2], 3.0)


def test_points_of_a_grid_that_hang_together_around_an_end_have_rays_of_their_own() -> None:
    skin = segment().skin
    axes = (
        np.linspace(low, high, 15)
        for low, high in zip(skin.points_mm.min(0), skin.points_mm.max(0), strict=True)
    )
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    true = skin.contains(grid.reshape(-1, 3)).reshape(grid.shape[:3])
    everywhere = np.ones(true.shape, dtype=np.bool_)  # one part, on both sides of the skin
    near = skin.nearest(grid.reshape(-1, 3))[1].reshape(true.shape) < 8.0
    for away in (everywhere, ~near):
        np.testing.assert_array_equal(_inside(skin, grid, away), true)


def test_layers_near_an_end_are_refused_with_a_length_that_fits() -> None:
    """There the surface below them would bend around the end of the scan."""
    skin = SMALL.skin_surface(1.2)
    scan = Surface(name="s", points_mm=skin.points_mm, faces=skin.faces)
    given = scan, [], SMALL.spots[0], np.array([1.0, 0.0, 0.0])
    assert cut(*given, 40.0, deep_mm=10.0).length_mm == 40.0
    with pytest.raises(MeshError, match=r"layers of 15 mm needs 36\.5 mm on either side") as refused:
        cut(*given, 40.0, deep_mm=15.0)
    shorter = float(str(refused.value).partition("shorten the segment to ")[2].split()[0])
    assert cut(*given, shorter, deep_mm=15.0).length_mm == shorter


def test_what_simplifying_leaves_is_within_what_the_mesher_may_flatten(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Simplified surfaces have fins as high as their tolerance, over which layers fold."""
    given: list[Surface] = []

    def kept(points: np.ndarray, faces: np.ndarray, *_: object) -> None:
        given.append(Surface(name="tissue", points_mm=points, faces=faces))
        raise MeshError("kept")

    monkeypatch.setattr(volume, "run_ftetwild", kept)
    plan = MeshPlan(size=SIZE)
    with pytest.raises(MeshError, match="kept"):
        mesh_segment(segment(), plan)
    assert given[0].nearest(segment().tissue.points_mm)[1].max() < 0.8 * plan.tolerance_mm


def test_a_thick_layer_has_several_elements_through_it() -> None:
    core = block("tet4", n_across=6, n_down=2).mesh
    tets, points = core.cells["tet4"], core.points_mm
    faces = outer_faces("tet4", tets)
    top = (points[faces, 2] == 0.0).all(axis=1)
    square = np.array([[-40.0, -40, 20], [40, -40, 20], [40, 40, 20], [-40, 40, 20]])
    skin = Surface(name="plane", points_mm=square, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    sides = {"skin": faces[top], "cut": faces[~top]}

    def made(highest_mm: float) -> tuple[float, int]:
        now, cells, layers, boundary, _ = extruded(points, tets, sides, skin, (2.0, 20.0), highest_mm)
        volumes = np.bincount(layers, np.abs(np.linalg.det(now[cells[:, 1:]] - now[cells[:, :1]])) / 6.0)
        np.testing.assert_allclose(volumes, 36.0**2 * np.array([2.0, 18.0, 18.0]))
        outer = {tuple(sorted(face)) for face in np.concatenate(list(boundary.values())).tolist()}
        assert outer == {tuple(sorted(face)) for face in outer_faces("tet4", cells).tolist()}, "no crack"
        a, b, c, d = np.moveaxis(now[cells], 1, 0)
        negative = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0.0
        cells = np.where(negative[:, None], cells[:, [0, 2, 1, 3]], cells)
        return float(scaled_jacobians(now, cells[layers == 1]).min()), int((layers == 1).sum())

    (one, n_one), (several, n_several) = made(np.inf), made(6.0)
    assert n_several == 3 * n_one
    assert several > 2.0 * one, "no slivers"


def test_layers_are_thinner_where_there_is_less_room_and_stay_whole() -> None:
    core = block("tet4", n_across=6, n_down=2).mesh
    tets, points = core.cells["tet4"], core.points_mm
    faces = outer_faces("tet4", tets)
    top = (points[faces, 2] == 0.0).all(axis=1)
    # The core's upper side rises to 1.5 mm below the plane of the skin, as over a bone.
    rises = points[:, 2] == 0.0
    points = points + np.where(rises, 6.5 * np.exp(-(points[:, 0] ** 2) / 60.0), 0.0)[:, None] * [0, 0, 1.0]
    square = np.array([[-40.0, -40, 8], [40, -40, 8], [40, 40, 8], [-40, 40, 8]])
    skin = Surface(name="plane", points_mm=square, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    sides = {"skin": faces[top], "cut": faces[~top]}
    now, cells, layers, boundary, depths = extruded(
        points, tets, sides, skin, (2.0, 8.0), 2.0, room_mm=8.0 - points[:, 2]
    )
    volumes = np.abs(np.linalg.det(now[cells[:, 1:]] - now[cells[:, :1]])) / 6.0
    assert volumes.min() > 1e-6
    of_core = np.abs(np.linalg.det(points[tets[:, 1:]] - points[tets[:, :1]])).sum() / 6.0
    assert volumes[layers < 2].sum() == pytest.approx(36.0**2 * 26.0 - of_core)
    outer = {tuple(sorted(face)) for face in np.concatenate(list(boundary.values())).tolist()}
    assert outer == {tuple(sorted(face)) for face in outer_faces("tet4", cells).tolist()}, "no crack"
    between = np.intersect1d(cells[layers == 0], cells[layers == 1])
    over_bone = np.abs(now[between, 0]) < 1e-9
    np.testing.assert_allclose(depths[between[np.abs(now[between, 0]) > 17.0]], 2.0, atol=0.05)
    assert 0.9 < depths[between[over_bone]].min() < 1.3, "the fat is thinner first"
    through = np.bincount(layers, np.abs(now[cells].mean(axis=1)[:, 0]) < 4.0)
    assert through[1] < through[0] * 2.5, "fewer elements through thin fat than three"


@pytest.mark.slow
def test_layers_that_reach_a_bone_thin_above_it() -> None:
    gap = gap_of_bones(segment())
    plan = MeshPlan(size=replace(SIZE, fine_mm=3.2), layers_mm={"skin": 1.5, "fat": gap - 2.0})
    limb = sound_mesh(segment(), plan)
    quality = assess(limb, segment(), 6.0)
    check_quality(quality, "p1", 3.2)
    mesh = limb.mesh
    cells, regions = mesh.cells["tet10"], mesh.cell_regions["tet10"]
    in_layers = np.intersect1d(np.unique(cells[regions < 2]), mesh.node_sets["bone"])
    assert not in_layers.size, "the core is around the bone"
    gaps = segment().bones[0].nearest(mesh.points_mm[np.unique(cells[regions == 1])])[1]
    assert gaps.min() > 0.6 * COVER_MM
    assert quality.layers_mm["skin"][0] == pytest.approx(1.5, abs=0.05)


@pytest.mark.slow
def test_a_mesh_is_graded_towards_the_edge_of_the_contact() -> None:
    plan = with_layers('length = "40 mm"\nsize = "1.1 mm"').mesh
    limb = mesh_segment(segment(), plan)
    on_ring, whole = (
        contact_edge_mm(limb, plan.size.radius_mm, beyond) for beyond in (plan.size.inner_mm, 0.0)
    )
    middle = contact_edge_mm(limb, 0.5 * plan.size.inner_mm)
    assert on_ring == pytest.approx(1.1, rel=0.12)
    assert on_ring < whole < middle < 1.2 * MIDDLE * on_ring
    even = mesh_segment(segment(), replace(plan, size=replace(plan.size, inner_mm=0.0)))
    assert limb.mesh.n_nodes < 0.9 * even.mesh.n_nodes


@pytest.mark.slow
def test_the_sphere_rests_on_the_mesh() -> None:
    limb, rise = moved_to_contact(layered(), 7.5)
    assert abs(rise) < 0.1
    again, more = moved_to_contact(limb, 7.5)
    assert abs(more) < 1e-9
    assert again.mesh.points_mm[again.mesh.node_sets["contact"], 2].max() == pytest.approx(0.0, abs=0.05)


@pytest.mark.slow
def test_a_poor_mesh_is_refused() -> None:
    limb = layered()
    quality = assess(limb, segment(), 6.0)
    with pytest.raises(MeshError, match="edges under the indenter"):
        check_quality(quality, "p1", 0.7 * quality.contact_edge_mm)
    with pytest.raises(MeshError, match="under the indenter with scaled Jacobian"):
        check_quality(replace(quality, near_scaled_jacobian=0.09), "p1", 3.2)
    mesh = limb.mesh
    cells = mesh.cells["tet10"][:-100]
    holed = Limb(
        spot=Spot(name="p1"),
        mesh=Mesh(
            points_mm=mesh.points_mm,
            cells={"tet10": cells},
            cell_regions={"tet10": mesh.cell_regions["tet10"][:-100]},
            regions=mesh.regions,
            node_sets=mesh.node_sets,
        ),
    )
    with pytest.raises(MeshError, match="% more volume than the scan"):
        check_quality(assess(holed, segment(), 6.0), "p1", 4.0)


def with_layers(text: str) -> ScanOptions:
    return ScanOptions.model_validate(tomllib.loads(text))


def test_layers_have_their_own_thickness_at_a_spot() -> None:
    options = with_layers(
        'size = "3.2 mm"\ncore = "muscle"\nlayer.skin = "2 mm"\n'
        'layer_at.p1 = { skin = "1.6 mm", fat = "4 mm" }\nlayer_at.p2 = { skin = "1.4 mm", fat = "8 mm" }'
    )
    assert options.layers == ("skin", "fat")
    assert dict(options.mesh.layers_mm) == {"skin": 2.0}
    assert dict(options.mesh_at("p1").layers_mm) == {"skin": 1.6, "fat": 4.0}
    with pytest.raises(MeshError, match="spot 'p3': layer 'fat' has a thickness at other spots"):
        options.mesh_at("p3")
    too_thin = r"'p2': layer 'skin' of 1\.4 mm is thinner than half an edge of 3\.2 mm.*size = \"2\.8 mm\""
    with pytest.raises(MeshError, match=too_thin):
        options.mesh_at("p2")
    small = options.model_copy(update={"size": 2.8}).mesh_at("p2")
    assert (dict(small.layers_mm), small.core) == ({"skin": 1.4, "fat": 8.0}, "muscle")


@pytest.mark.parametrize(
    ("layers", "order"),
    [
        ('layer.fat="5 mm"\nlayer_at.p1.skin="1 mm"', ("skin", "fat")),
        (
            '[layer_at]\np1={fascia="1 mm", fat="4 mm"}\np2={fat="4 mm", deep="3 mm"}',
            ("fascia", "fat", "deep"),
        ),
        ('[layer_at]\np1={deep="3 mm"}\np2={fat="4 mm", deep="3 mm"}', ("fat", "deep")),
    ],
)
def test_layers_come_in_the_order_of_what_is_named_together(layers: str, order: tuple[str, ...]) -> None:
    assert with_layers(layers).layers == order


@pytest.mark.parametrize(
    ("layers", "why"),
    [
        ('[layer_at]\np1={fat="4 mm", deep="3 mm"}\np2={deep="3 mm", fat="4 mm"}', "named above the other"),
        ('layer.fat="4 mm"\nlayer_at.p1.deep="3 mm"', "is not said"),
        ('layer.fat="4 mm"\nlayer_at.p1={skin="1 mm", deep="3 mm"}', "is not said"),
    ],
)
def test_layers_in_no_order_or_in_several_are_refused(layers: str, why: str) -> None:
    options = with_layers(layers)
    with pytest.raises(MeshError, match=f"layers '(fat' and 'deep|deep' and 'fat)': .*{why}"):
        options.mesh_at("p1")


def test_layers_that_reach_a_bone_are_remarked() -> None:
    assert layers_at_bone(segment(), {"skin": 1.0}) == []
    (remark,) = layers_at_bone(segment(), {"skin": 2.5, "fat": 20.0})
    assert "layers of 22.5 mm together reach bone 'bone', " in remark


# --------------------------------------------------------------------- meshers


def filled(time_limit_s: float) -> None:
    body = segment().tissue
    run_ftetwild(body.points_mm, body.faces, SIZE, 0.3, time_limit_s)


def test_a_mesher_that_is_slow_or_missing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(MeshError, match=r"fTetWild failed \(.*stopped after 0\.05 s"):
        filled(0.05)
    (tmp_path / "pytetwild.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(PluginError, match="fTetWild: pytetwild is missing; install it"):
        filled(60.0)


# --------------------------------------------------------------------- command


def run(folder: Path, *more: str) -> int:
    return main(["limb", str(folder / "scan.ply"), "--bones", str(folder / "bone.stl"), *more])


@pytest.mark.slow
def test_the_command_writes_a_mesh_a_note_and_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_phantom(tmp_path, SMALL, Scanner(spacing_mm=1.4))
    out = tmp_path / "meshes"
    (tmp_path / "limb.toml").write_text('length = "40 mm"\nradius = "5 mm"\nsize = "9 mm"\nunit = "mm"\n')
    options = ["--options", str(tmp_path / "limb.toml"), "--mark", "p1=green", "--size", "4.5 mm", "--fine"]
    assert run(tmp_path, *options, "--into", str(out)) == 0
    printed = capsys.readouterr().out
    source, spot = MeshioSource(MeshioSettings()), Spot(name="p1")
    limb, fine = source.load(out / "p1.vtu", spot), source.load(out / "fine" / "p1.vtu", spot)
    assert f'mesh = "{out}/p1.vtu"\nfine_mesh = "{out}/fine/p1.vtu"\n' in printed
    check_limb(limb, ["soft_tissue"])
    check_fine(limb, fine, 6.0, "study.toml:9")
    assert 2.0 < fine.mesh.n_nodes / limb.mesh.n_nodes < 4.5
    assert meshio.read(out / "p1.vtu").point_data["bone"].any()
    assert (out / "p1.png").read_bytes().startswith(b"\x89PNG")
    written = json.loads((out / "p1.json").read_text())
    assert "volume_error" in written["quality"]
    axes = limb.mesh.cell_fields["axis"]["tet10"]
    along_limb = np.array(written["scan_to_mesh"])[:3, 0]  # the phantom's x
    np.testing.assert_allclose(axes, np.tile(along_limb, (len(axes), 1)), atol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ('unit = "m"', "is plausible"),
        ('length = "100 mm"', "too near an end"),
        ("axis = [0, 0, 1]", "its normal points along the limb"),
        ('mark_radii = ["6 mm", "9 mm"]', "0 marks found where 1 were named"),
    ],
)
def test_the_command_refuses_what_it_cannot_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: str, message: str
) -> None:
    write_phantom(tmp_path, SMALL, Scanner(spacing_mm=2.5))
    (tmp_path / "limb.toml").write_text(f'unit = "mm"\n{options}' if "unit" not in options else options)
    given = ["--mark", "p1=green", "--options", str(tmp_path / "limb.toml"), "--into", str(tmp_path / "out")]
    assert run(tmp_path, *given) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_a_poor_mesh_is_made_again_as_long_as_that_may_help(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Limb] = []
    poor = replace(layered(), mesh=block("tet10", n_across=2, n_down=1, width_mm=40.0, height_mm=9.0).mesh)

    def meshed(of: Segment, plan: MeshPlan) -> Limb:
        made.append(layered() if len(made) == n_poor else poor)
        return made[-1]

    monkeypatch.setattr(from_scan, "mesh_segment", meshed)
    plan = MeshPlan(size=replace(SIZE, fine_mm=3.2), layers_mm={"skin": 2.5})
    for n_poor in (0, 2):
        made.clear()
        assert sound_mesh(segment(), plan) is layered()
        assert len(made) == n_poor + 1
    n_poor = 99
    made.clear()
    assert sound_mesh(segment(), plan) is poor
    assert len(made) == from_scan.MOST_MESHES
