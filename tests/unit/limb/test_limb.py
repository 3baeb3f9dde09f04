"""Limbs that cannot be simulated are refused, each with the element, node or region."""

import contextlib
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import Indentation, Limb, Mesh, Spot
from palpate.domain.indenter import Sphere
from palpate.errors import MeshError, PluginError, StudyError
from palpate.limb.checks import check_depth, check_limb
from palpate.limb.loading import limb_warnings, load_limbs
from palpate.limb.mesh_joints import holes
from palpate.mesh.specimens.blocks import block
from palpate.plugins.interfaces import LimbSource, Solver
from palpate.plugins.provides import Provides
from palpate.stages import pipeline
from palpate.study.model import LimbTable

CUBE = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], dtype=float
)
TET_IN_CUBE = [[0, 1, 3, 4], [1, 2, 3, 6], [1, 6, 4, 5], [3, 4, 6, 7], [1, 3, 4, 6]]
EDGES = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
TOP = Spot(name="p1", position_mm=[0.5, 0.5, 1.0], normal=[0, 0, 1])


def quadratic(points, cells):
    """Ten-node tetrahedra with straight edges, in the order of VTK."""
    points, made, ten = [tuple(p) for p in points], {}, []
    for cell in cells:
        middles = []
        for a, b in EDGES:
            key = frozenset((cell[a], cell[b]))
            if key not in made:
                made[key] = len(points)
                points.append(tuple((np.array(points[cell[a]]) + np.array(points[cell[b]])) / 2))
            middles.append(made[key])
        ten.append([*cell, *middles])
    return np.array(points), np.array(ten)


def limb(kind="hex8", *, points=None, cells=None, regions=("soft_tissue",), ids=None, sets=None, spot=TOP):
    if cells is None:
        cells = {"hex8": [list(range(8))], "tet4": TET_IN_CUBE}.get(kind)
        points = CUBE if points is None else points
        if kind == "tet10":
            points, cells = quadratic(points, TET_IN_CUBE)
    nodes: Mapping[str, object] = {"fixed": [0, 1, 2, 3], "contact": [4, 5, 6, 7]} | (sets or {})
    ids = np.zeros(len(cells)) if ids is None else ids
    mesh = Mesh(
        points_mm=points, cells={kind: cells}, cell_regions={kind: ids}, regions=regions, node_sets=nodes
    )
    return Limb(spot=spot, mesh=mesh)


def refused(broken, match, regions=("soft_tissue",)):
    with pytest.raises(MeshError, match=match):
        check_limb(broken, regions)


@pytest.mark.parametrize("kind", ["hex8", "tet4", "tet10"])
def test_a_sound_limb_passes(kind):
    check_limb(limb(kind), ["soft_tissue"])


@pytest.mark.parametrize("kind", ["hex8", "tet4", "tet10"])
def test_a_mirrored_limb_is_inverted(kind):
    mirrored = limb(kind, points=CUBE * [1, 1, -1] + [0, 0, 1])
    refused(mirrored, rf"{kind} elements are inverted or flat, first element 0 near \[.*determinant -")


@pytest.mark.parametrize(("kind", "volumes"), [("hex8", 8.0), ("tet4", 1.0), ("tet10", 1.0)])
def test_the_determinant_of_a_box_is_its_volume_ratio(kind, volumes):
    """Corner tetrahedra have 1/6 of the box."""
    mirrored = limb(kind, points=CUBE * [2.0, 3.0, -4.0] + [0, 0, 1])
    refused(mirrored, rf"first element 0 near .*determinant -{24.0 / volumes:g} mm³")


def test_a_flat_element_is_refused():
    refused(limb(points=CUBE * [1, 1, 0]), "inverted or flat")


def test_a_midside_node_that_folds_the_element_is_refused():
    folded = limb("tet10")
    points = np.array(folded.mesh.points_mm)
    cell = folded.mesh.cells["tet10"][2]
    points[cell[4]] = points[cell[0]] + 0.95 * (points[cell[1]] - points[cell[0]])
    broken = limb("tet10", points=points, cells=folded.mesh.cells["tet10"])
    refused(broken, "3 tet10 elements are inverted or flat, first element 1")


def test_a_coordinate_that_is_not_finite_names_its_node():
    points = CUBE.copy()
    points[5, 1] = np.nan
    refused(limb(points=points), "node 5 is at")


def test_an_index_out_of_range_names_its_place():
    refused(
        limb(cells=[[0, 1, 2, 3, 4, 5, 6, 8]], points=CUBE),
        r"hex8 cells\[0, 7\] names node 8, but there are 8",
    )
    refused(limb(sets={"fixed": [0, -1]}), r"node set 'fixed'\[1\] names node -1")
    refused(limb(ids=[1]), r"regions of hex8\[0\] names region 1")


def test_shapes_and_kinds_are_checked():
    refused(limb(points=CUBE[:, :2]), r"points of shape \(8, 2\)")
    refused(limb(cells=[[0, 1, 2, 3]], points=CUBE), r"hex8 cells of shape \(1, 4\)")
    refused(limb("wedge6", cells=[[0, 1, 2, 3, 4, 5]], points=CUBE), "kind 'wedge6'")
    refused(limb(ids=[0, 0]), "not one region for each")
    refused(limb(cells=np.zeros((0, 8)), points=CUBE), "no volume elements")


@pytest.mark.parametrize("name", ["fixed", "contact"])
def test_a_missing_node_set_is_named(name):
    refused(limb(sets={name: []}), f"node set '{name}' is missing or empty")


def test_regions_and_materials_must_match():
    refused(limb(regions=("skin",)), "region 'skin' has no material")
    check_limb(limb(), ["soft_tissue", "muscle"])


def test_an_unused_node_is_refused():
    refused(limb(points=np.vstack([CUBE, [[9, 9, 9]]])), "1 nodes belong to no element, first node 8")


def test_a_loose_part_is_refused():
    points = np.vstack([CUBE, CUBE + np.array([0, 0, 5])])
    two = limb(points=points, cells=[list(range(8)), list(range(8, 16))])
    about = r"\(region soft_tissue\) shares no node .* spot 'p1'; merge their nodes, or remove it$"
    message = rf"2 separate parts; the part of node 8 near .* {about}"
    refused(two, message)
    held = {"fixed": [0, 1, 2, 8, 9, 10]}
    refused(limb(points=points, cells=[list(range(8)), list(range(8, 16))], sets=held), message)


def test_an_element_listed_twice_is_named():
    twice = [list(range(8)), [4, 5, 6, 7, 0, 1, 2, 3]]
    refused(limb(points=CUBE, cells=twice[:1] * 2), "hex8 elements 0 and 1 have the same nodes, near")
    again = limb("tet4", points=CUBE, cells=[*TET_IN_CUBE, TET_IN_CUBE[3]])
    refused(again, r"tet4 elements 3 and 5 have the same nodes, near .*list each element once")


@pytest.mark.parametrize("kind", ["hex8", "tet4", "tet10"])
def test_doubled_nodes_at_the_spot_are_named_as_a_crack(kind):
    sound = block(kind, n_across=4, n_down=2)
    mesh = sound.mesh
    cells = np.array(mesh.cells[kind])
    middle = int(np.flatnonzero((mesh.points_mm == 0.0).all(axis=1))[0])
    right = mesh.points_mm[cells].mean(axis=1)[:, 0] > 0.0
    on_plane = np.flatnonzero((mesh.points_mm[:, 0] == 0.0) & (mesh.points_mm[:, 2] > -9.1))
    new = np.arange(mesh.n_nodes)
    new[on_plane] = mesh.n_nodes + np.arange(len(on_plane))
    cells[right] = new[cells[right]]
    cracked = replace(
        sound,
        mesh=replace(
            mesh, points_mm=np.vstack([mesh.points_mm, mesh.points_mm[on_plane]]), cells={kind: cells}
        ),
    )
    check_limb(sound, ["soft_tissue"])
    match = rf"{len(on_plane)} pairs of nodes are at one place, such as nodes {middle} and .*0 mm from spot"
    refused(cracked, match)


def test_a_layer_that_is_bonded_nowhere_is_named():
    sound = block("hex8", n_across=4, n_down=2, layers_mm={"skin": 9.0})
    mesh = sound.mesh
    cells = np.array(mesh.cells["hex8"])
    skin = mesh.cell_regions["hex8"] == 0
    cells[skin] += mesh.n_nodes
    points = np.vstack([mesh.points_mm, mesh.points_mm * [1.0, 1.0, 0.9] + [0, 0, 1.0]])
    used, cells = np.unique(cells, return_inverse=True)
    loose = replace(
        mesh,
        points_mm=points[used],
        cells={"hex8": cells.reshape(-1, 8)},
        node_sets={
            "fixed": np.flatnonzero((points[used, 2] == -18.0) | (np.abs(points[used, 0]) == 18.0)),
            "contact": np.flatnonzero(points[used, 2] == 1.0),
        },
    )
    match = r"2 separate parts; .* \(region soft_tissue\) shares no node with the part under spot 'block'"
    refused(replace(sound, mesh=loose), match, regions=("skin", "soft_tissue"))


def hollow(kind):
    """A block without some elements in its inside."""
    sound = block(kind, n_across=4, n_down=4)
    centres = sound.mesh.points_mm[sound.mesh.cells[kind]].mean(axis=1)
    kept = np.linalg.norm(centres - [4.0, 4.0, -9.0], axis=1) > 4.0
    assert not kept.all()
    used, cells = np.unique(sound.mesh.cells[kind][kept], return_inverse=True)
    index = np.full(sound.mesh.n_nodes, -1)
    index[used] = np.arange(len(used))
    sets = {name: index[nodes] for name, nodes in sound.mesh.node_sets.items()}
    mesh = replace(
        sound.mesh,
        points_mm=sound.mesh.points_mm[used],
        cells={kind: cells.reshape(kept.sum(), -1)},
        cell_regions={kind: sound.mesh.cell_regions[kind][kept]},
        node_sets=sets,
    )
    return replace(sound, mesh=mesh)


@pytest.mark.parametrize("kind", ["hex8", "tet10"])
def test_a_hole_in_the_tissue_is_warned_of(kind):
    check_limb(hollow(kind), ["soft_tissue"])
    (warning,) = holes(hollow(kind).mesh)
    assert "a hole in the tissue, or a bone whose nodes are not in 'fixed'" in warning
    assert holes(block(kind, n_across=4, n_down=4).mesh) == []


@pytest.mark.parametrize("fixed", [[0], [0, 1], [0, 0, 1, 1]])
def test_a_limb_that_can_turn_about_its_fixed_nodes_is_refused(fixed):
    refused(
        limb(sets={"fixed": fixed}), rf"the fixed nodes are on one line \({len(fixed)} nodes, the first 0\)"
    )


def test_elements_of_two_orders_that_share_an_edge_are_refused():
    points, ten = quadratic(CUBE, TET_IN_CUBE[:1])
    both = Mesh(
        points_mm=points,
        cells={"tet10": ten, "tet4": TET_IN_CUBE[1:]},
        cell_regions={"tet10": [0], "tet4": [0] * 4},
        regions=("soft_tissue",),
        node_sets={"fixed": [0, 1, 2, 3], "contact": [4, 5, 6, 7]},
    )
    middle = next(k for k, p in enumerate(points) if np.allclose(p, [0.5, 0.5, 0.0]))
    refused(Limb(spot=TOP, mesh=both), rf"between nodes 1 and 3 has node {middle} and none in its middle")


def test_two_nodes_in_the_middle_of_one_edge_are_refused():
    sound = limb("tet10")
    cells, points = np.array(sound.mesh.cells["tet10"]), np.array(sound.mesh.points_mm)
    twice = cells[4, 4]
    cells[4, 4] = len(points)
    torn = limb("tet10", points=np.vstack([points, points[twice]]), cells=cells)
    with pytest.raises(MeshError, match=rf"between nodes 1 and 3 has nodes {twice} and {len(points)} in"):
        check_limb(torn, ["soft_tissue"])


def test_hexahedra_and_linear_tetrahedra_may_share_edges():
    points = np.vstack([CUBE, CUBE[4:] + np.array([0, 0, 1])])
    above = np.array([4, 5, 6, 7, 8, 9, 10, 11])
    both = Mesh(
        points_mm=points,
        cells={"hex8": [list(range(8))], "tet4": above[np.array(TET_IN_CUBE)]},
        cell_regions={"hex8": [0], "tet4": [0] * 5},
        regions=("soft_tissue",),
        node_sets={"fixed": [0, 1, 2, 3], "contact": [8, 9, 10, 11]},
    )
    check_limb(Limb(spot=Spot(name="p1", position_mm=[0.5, 0.5, 2.0]), mesh=both), ["soft_tissue"])


def test_a_spot_off_the_surface_is_refused():
    away = Spot(name="p1", position_mm=[0.5, 0.5, 3.0], normal=[0, 0, 1])
    refused(limb(spot=away), r"spot 'p1' .* is 2.12 mm from the nearest contact node")


def test_a_normal_that_points_inwards_is_refused():
    inwards = Spot(name="p1", position_mm=[0.5, 0.5, 1.0], normal=[0, 0, -1])
    refused(limb(spot=inwards), "points into the limb")


@pytest.mark.parametrize(("depth_mm", "sound"), [(0.99, True), (1.0, False)])
def test_a_sphere_that_passes_through_the_limb_is_refused(depth_mm, sound):
    protocol = Indentation(indenter=Sphere(radius_mm=1.0), path=[(0, 0), (depth_mm, 0)], friction=0.0)
    with contextlib.nullcontext() if sound else pytest.raises(MeshError, match="check the unit of the mesh"):
        check_depth(limb(), protocol)


def test_a_source_that_returns_no_limb_is_named(make_study, tissue, tmp_path):
    class Empty(Source):
        def load(self, path, spot):
            return None

    class Meshed(tissue.Analytic):
        provides = Provides()

    spots = tuple(replace(s, mesh=tmp_path / "x.vtu") for s in make_study().spots)
    with pytest.raises(PluginError, match=r"reading .*x\.vtu: 'cube' .* returned a NoneType and not a Limb"):
        load_limbs(make_study(solver=Meshed(), limb_source=Empty(), spots=spots))


class Source(LimbSource):
    name = "cube"
    summary = "a cube"

    def load(self, path, spot):
        return limb(spot=spot, points=CUBE if path.name == "good.vtu" else CUBE * [1, 1, 0])


def test_the_message_names_the_file(make_study, tissue, tmp_path):
    class Meshed(tissue.Analytic):
        provides = Provides()

    def study(mesh, protocol=None):
        spots = tuple(replace(s, mesh=mesh and tmp_path / mesh, spot=TOP) for s in make_study().spots[:1])
        return make_study(solver=Meshed(), limb_source=Source(), spots=spots, protocol=protocol)

    assert set(load_limbs(study("good.vtu"))) == {"p1"}
    with pytest.raises(MeshError, match=r"bad\.vtu: mesh: 1 hex8 elements"):
        load_limbs(study("bad.vtu"))
    with pytest.raises(StudyError, match="spot 'p1' has no mesh, which solver 'analytic' needs"):
        load_limbs(study(None))
    assert load_limbs(make_study()) == {}
    with pytest.raises(
        MeshError, match=r"good\.vtu: spot 'p1': the protocol presses 10 mm deep, .* 1 mm below"
    ):
        load_limbs(study("good.vtu", make_study().protocol))
    assert issubclass(Meshed, Solver)


def test_spots_of_different_anatomy_share_a_study(make_study, tissue, tmp_path):
    class Meshed(tissue.Analytic):
        provides = Provides()

    class Named(Source):
        def load(self, path, spot):
            return limb(spot=spot, regions=(path.stem,))

    study = make_study(solver=Meshed(), limb_source=Named(), protocol=None)
    (region,) = study.space.regions
    regions = tuple(replace(region, region=name) for name in ("muscle", "fat"))
    spots = tuple(
        replace(s, mesh=tmp_path / f"{name}.vtu", spot=replace(TOP, name=s.spot.name))
        for s, name in zip(study.spots[:2], ("muscle", "fat"), strict=True)
    )
    both = replace(study, spots=spots, space=replace(study.space, regions=regions))
    assert limb_warnings(both, load_limbs(both)) == [
        "spot 'p1' has no region fat: its parameters change nothing there",
        "spot 'p2' has no region muscle: its parameters change nothing there",
    ]
    with pytest.raises(
        MeshError, match=r"region 'fat' has a material but no element that deforms in any mesh; .*: muscle\)"
    ):
        load_limbs(replace(both, spots=spots[:1]))


def test_a_rigid_region_is_in_one_mesh_at_least(make_study, tissue, tmp_path):
    class Meshed(tissue.Analytic):
        provides = Provides()

    class Named(Source):
        def load(self, path, spot):
            made = block("hex8", n_across=2, n_down=2, layers_mm={"soft_tissue": 9.0})
            lower = "bone" if path.stem == "p1" else "soft_tissue"
            regions = ("soft_tissue", lower) if lower == "bone" else ("soft_tissue",)
            ids = {"hex8": np.minimum(made.mesh.cell_regions["hex8"], len(regions) - 1)}
            return replace(made, spot=spot, mesh=replace(made.mesh, regions=regions, cell_regions=ids))

    table = LimbTable(source="", rigid=["bone"])
    study = replace(make_study(solver=Meshed(), limb_source=Named(), protocol=None), meshes=table)
    spots = [
        replace(s, mesh=tmp_path / f"{s.spot.name}.vtu", spot=Spot(name=s.spot.name)) for s in study.spots
    ]
    limbs = load_limbs(replace(study, spots=tuple(spots[:2])))
    assert limbs["p1"].mesh.regions == ("soft_tissue",)
    assert limbs["p1"].mesh.n_cells < limbs["p2"].mesh.n_cells
    assert "no region bone in this mesh: nothing is fixed by rigid there" in limbs["p2"].remarks
    with pytest.raises(MeshError, match=r"no mesh has region 'bone', which rigid under .*: soft_tissue\)"):
        load_limbs(replace(study, spots=tuple(spots[1:2])))


def test_what_is_left_out_is_in_one_mesh_at_least(make_study, tissue, tmp_path):
    class Meshed(tissue.Analytic):
        provides = Provides()

    class Named(Source):
        def load(self, path, spot):
            return replace(block("hex8", n_across=2, n_down=2), spot=spot, absent=absent[path.stem])

    study = make_study(solver=Meshed(), limb_source=Named(), protocol=None)
    spots = [replace(s, mesh=tmp_path / f"{s.spot.name}.vtu") for s in study.spots]
    absent = {s.spot.name: ("gel",) for s in spots}
    with pytest.raises(MeshError, match="no mesh has elements of 'gel', which leave_out under"):
        load_limbs(replace(study, spots=tuple(spots)))
    absent["p1"] = ()
    assert {*load_limbs(replace(study, spots=tuple(spots)))} == {*absent}


def test_check_prints_warnings_about_a_limb(make_study, tissue, plugins, tmp_path):
    class Meshed(tissue.Analytic):
        provides = Provides()

    class Hollow(Source):
        def load(self, path, spot):
            return replace(hollow("hex8"), spot=spot)

    study = make_study(solver=Meshed(), limb_source=Hollow())
    spots = tuple(replace(s, mesh=tmp_path / "x.vtu", spot=Spot(name=s.spot.name)) for s in study.spots)
    checked = pipeline.check_study(replace(study, spots=spots), plugins)
    assert any(text.startswith("spot 'p1': a closed inner surface of") for text in checked.warnings)


@pytest.fixture
def warned(make_study, tissue, tmp_path):
    """Warnings about a block that a sphere presses."""

    def of(limb, radius_mm=7.5, **layers_mm):
        class Meshed(tissue.Analytic):
            provides = Provides()

        class Blocks(Source):
            def load(self, path, spot):
                return replace(limb, spot=spot)

        press = Indentation(indenter=Sphere(radius_mm=radius_mm), path=[(0, 0), (1, 0)], friction=0.0)
        first, *_ = make_study().spots
        spots = (
            replace(first, spot=Spot(name=first.spot.name), mesh=tmp_path / "a.vtu", layers_mm=layers_mm),
        )
        study = make_study(solver=Meshed(), limb_source=Blocks(), spots=spots, protocol=press)
        (region,) = study.space.regions
        regions = tuple(replace(region, region=name) for name in limb.mesh.regions)
        study = replace(study, space=replace(study.space, regions=regions))
        return limb_warnings(study, load_limbs(study))

    return of


def test_an_edge_that_the_mesh_does_not_resolve_is_a_warning(warned):
    edges_of_4_mm = block(width_mm=24.0)
    assert warned(edges_of_4_mm) == []
    (text,) = warned(edges_of_4_mm, radius_mm=3.0)
    assert text.startswith("spot 'p1': edges of the mesh under the indenter are 4")
    assert "'sphere' is rounded by 3 mm: the pressure at its edge is not resolved" in text


@pytest.mark.parametrize("kind", ["hex8", "tet10"])
@pytest.mark.parametrize("thin", ["skin", "fat"])
def test_a_layer_thinner_than_half_an_edge_is_a_warning(warned, kind, thin):
    layers = {"skin": 3.0, "fat": 3.0} | {thin: 1.0}
    (text,) = warned(block(kind, width_mm=24.0, n_down=18, layers_mm=layers))
    assert text.startswith(f"spot 'p1': layer '{thin}' is 1 mm thick, less than half of an edge there")
    assert '`palpate limb SCAN --size "2 mm"`' in text
    assert warned(block(kind, width_mm=24.0, n_down=18, layers_mm={"skin": 3.0, "fat": 3.0})) == []


def test_a_layer_unlike_its_measured_thickness_is_a_warning(warned):
    limb = block(width_mm=24.0, n_down=18, layers_mm={"skin": 3.0, "fat": 3.0})
    assert warned(limb, skin=(3.2, 0.2), fat=(3.0, 0.0)) == []
    (text,) = warned(limb, skin=(3.4, 0.2))
    assert text.startswith("spot 'p1': layer 'skin' is 3 mm thick in the mesh, but its measured thickness")
    assert 'layer_at.p1.skin = "3.4 mm"' in text
    (text,) = warned(limb, soft_tissue=(3.0, 0.2))
    assert "region 'soft_tissue' is no layer of the mesh" in text
