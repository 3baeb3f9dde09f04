"""Limbs whose spot, bone or layers are elsewhere: their geometry, and what they do to intervals."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.api import LimbSource, hookimpl
from palpate.domain import Response, Spot
from palpate.mesh import layers
from palpate.mesh.specimens import block
from palpate.mesh.topology import CELLS
from palpate.stages import pipeline
from palpate.testing.bench import HalfSpaceOnMesh
from palpate_certainty.anatomy import changed_limb
from palpate_certainty.error_sources import ErrorSource, columns_of, error_sources_of, n_differences
from palpate_certainty.stages import joint_assessed

KINDS = ("hex8", "tet4", "tet10")
LAYERS = {"skin": 3.0, "fat": 6.0}


@pytest.mark.parametrize("kind", KINDS)
@given(by_mm=st.floats(-3.0, 3.0))
def test_a_nearer_bone_under_a_block_is_a_lower_block(kind, by_mm):
    limb = block(kind)
    moved, lower = changed_limb(limb, "bone", "", by_mm), block(kind, height_mm=18.0 - by_mm)
    z = limb.mesh.points_mm[:, 2]
    for mesh in (moved.mesh, lower.mesh):
        assert np.array_equal(mesh.cells[kind], limb.mesh.cells[kind])
        np.testing.assert_allclose(mesh.points_mm[z == -18.0][:, 2], by_mm - 18.0)
    np.testing.assert_array_equal(moved.mesh.points_mm[z == 0.0], limb.mesh.points_mm[z == 0.0])
    np.testing.assert_allclose(moved.mesh.points_mm, lower.mesh.points_mm, atol=0.35 * abs(by_mm))


@pytest.mark.parametrize("kind", KINDS)
@given(by=st.floats(-0.4, 0.4))
def test_a_thicker_layer_moves_its_lower_face_alone(kind, by):
    limb = block(kind, n_down=6, layers_mm=LAYERS)
    z, moved = limb.mesh.points_mm[:, 2], changed_limb(limb, "layers", "skin", by).mesh.points_mm
    np.testing.assert_allclose(moved[z == -3.0][:, 2], -3.0 * (1.0 + by))
    for rests in (0.0, -9.0, -18.0):
        np.testing.assert_array_equal(moved[z == rests], limb.mesh.points_mm[z == rests])
    second = changed_limb(limb, "layers", "fat", by).mesh.points_mm
    np.testing.assert_allclose(second[z == -9.0][:, 2], -9.0 - 6.0 * by)
    np.testing.assert_array_equal(second[z == -3.0], limb.mesh.points_mm[z == -3.0])


def test_nodes_in_the_middle_of_an_edge_stay_there():
    limb = block("tet10", n_down=6, layers_mm=LAYERS)
    moved = changed_limb(limb, "layers", "skin", 0.3).mesh
    (cells,) = moved.cells.values()
    middle = moved.points_mm[cells[:, 4]]
    np.testing.assert_allclose(middle, moved.points_mm[cells[:, :2]].mean(axis=1), atol=1e-12)


@pytest.mark.parametrize("of", ["soft_tissue", "bone"])
def test_without_a_lower_face_a_layer_is_as_it_is(of):
    limb = block(n_down=6, layers_mm=LAYERS)
    assert changed_limb(limb, "layers", of, 0.2) is limb


@given(by_mm=st.floats(-3.0, 3.0))
def test_the_ends_of_a_cut_limb_go_with_its_bones(by_mm):
    """Held ends that the mesh names move as the tissue between bone and skin does, others as if of bone."""
    limb = block()
    x, _, z = limb.mesh.points_mm.T
    ends = np.flatnonzero(np.abs(x) == np.abs(x).max())
    sets = {**limb.mesh.node_sets, "cut": ends, "fixed": np.union1d(limb.mesh.node_sets["fixed"], ends)}
    cut = replace(limb, mesh=replace(limb.mesh, node_sets=sets))
    moved = changed_limb(cut, "bone", "", by_mm).mesh.points_mm
    np.testing.assert_allclose(moved, changed_limb(limb, "bone", "", by_mm).mesh.points_mm, atol=1e-9)
    np.testing.assert_array_equal(moved[z == 0.0], limb.mesh.points_mm[z == 0.0])


@pytest.mark.parametrize("kind", KINDS)
def test_regions_that_meet_at_an_edge_alone_are_no_neighbours(kind):
    """Muscle that meets the skin along an edge, and fat by faces, is as deep as the fat allows."""
    limb = block(kind, n_down=6, layers_mm=LAYERS)
    mesh, (cells,) = limb.mesh, limb.mesh.cells.values()
    x, _, z = mesh.points_mm[cells[:, : CELLS[kind].n_corners]].mean(axis=1).T
    names = np.select([(z > -3.0) & (x > 0.0), (z < -3.0) & (x < 0.0)], [0, 2], 1)
    top = (mesh.points_mm[:, 2] == 0.0) & (mesh.points_mm[:, 0] > 0.0)
    sets = {**mesh.node_sets, "contact": np.flatnonzero(top)}
    regions = ("skin", "fat", "muscle")
    named = replace(mesh, regions=regions, cell_regions={kind: names}, node_sets=sets)
    assert layers._levels(named) == {"skin": 0, "fat": 1, "muscle": 2}


def test_without_held_nodes_below_the_skin_there_is_no_bone():
    limb = block()
    sets = {**limb.mesh.node_sets, "fixed": limb.mesh.node_sets["contact"]}
    floating = replace(limb, mesh=replace(limb.mesh, node_sets=sets))
    assert changed_limb(floating, "bone", "", 1.0) is floating


@given(by_mm=st.floats(-3.0, 3.0), axis=st.sampled_from("xy"))
def test_another_spot_on_a_cylinder_is_on_the_cylinder(by_mm, axis):
    limb = block(n_across=24)
    points = np.array(limb.mesh.points_mm)
    angle = points[:, 0] / 40.0
    points[:, 0], points[:, 2] = (40.0 + points[:, 2]) * np.array([np.sin(angle), np.cos(angle)])
    spot = Spot(name="p1", position_mm=np.array([0.0, 0.0, 40.0]))
    bent = replace(limb, spot=spot, mesh=replace(limb.mesh, points_mm=points))
    moved = changed_limb(bent, "position", axis, by_mm)
    x, y, z = moved.spot.position_mm
    assert (x, y) == pytest.approx((by_mm, 0.0) if axis == "x" else (0.0, by_mm))
    assert np.hypot(x, z) == pytest.approx(40.0, abs=2e-3)
    np.testing.assert_array_equal(moved.spot.normal, spot.normal)


@pytest.fixture
def measured_run(tmp_path, pressed_meshes):
    """Run a study of measured data whose solver knows the mesh by its thickness alone; open it again."""
    study, plugins = pressed_meshes(
        tmp_path,
        solver={"name": "half_space_on_mesh"},
        budget={"bone": "2 mm"},
        fit={"search": "least_squares"},
    )
    study = replace(study, data="measured")
    pipeline.run_study(study, tmp_path / "run", plugins)
    with pipeline.locked_run(study, tmp_path / "run", plugins, needs=["fit"]) as run:
        yield run


def test_the_bone_is_in_the_intervals_of_measured_limbs(measured_run):
    assert measured_run.table("budget").filter(cause="bone")["share"].max() > 0.01
    assert "position" not in measured_run.table("budget")["cause"]


def test_doubt_in_the_bone_is_that_of_the_closed_form(measured_run):
    stage, assessed = joint_assessed(measured_run)
    columns, failures = stage.columns(assessed.case)
    end = assessed.case.end
    (term,) = end.problem.terms
    simulation = end.problem.simulated(term, end.problem.inputs("p1", end.best.point))
    thickness_mm = np.ptp(measured_run.limbs["p1"].mesh.points_mm[:, 2])
    curve = simulation.response["force"]
    stiffening = contact_mm(term.protocol, curve.abscissa) / thickness_mm
    expected = curve.ordinate * stiffening / (1.0 + stiffening) * 2.0 / thickness_mm
    found = columns["p1", "force"]
    at = term.measured["force"].abscissa
    # One step of 0.93 mm to a nearer bone, by which the change grows.
    np.testing.assert_allclose(found["bone"], np.interp(at, curve.abscissa, expected), rtol=0.08, atol=1e-4)
    assert not failures
    np.testing.assert_allclose([found["position p1 x"], found["position p1 y"]], 0.0, atol=1e-9)


def test_a_change_of_a_limb_costs_one_simulation(measured_run):
    """So the run says in advance."""
    stage, assessed = joint_assessed(measured_run)
    known = set(measured_run.simulations.known)
    moved = [ErrorSource(kind="bone", of="", sd=sd) for sd in (0.5, 0.7)]
    columns_of(assessed.case.end, moved[:1], ["force"], stage.limbs)
    one = set(measured_run.simulations.known) - known
    columns_of(assessed.case.end, moved[1:], ["force"], stage.limbs)
    assert (len(one), len(set(measured_run.simulations.known) - known)) == (1, 2)
    assert n_differences(moved, measured_run.study) == 2


def test_a_bone_that_leaves_the_limb_is_no_cause_and_says_why(measured_run):
    stage, assessed = joint_assessed(measured_run)
    beyond = ErrorSource(kind="bone", of="", sd=3000.0)
    columns, failures = columns_of(assessed.case.end, [beyond], ["force"], stage.limbs)
    assert columns["p1", "force"] == {}
    assert re.match(r"cannot move the bones by -?\S+ mm: .*element", failures[beyond])
    assert "repair" not in failures[beyond]  # the user's mesh is as it should be


def test_a_step_that_a_limb_cannot_take_is_halved(measured_run):
    stage, assessed = joint_assessed(measured_run)
    small, large = (ErrorSource(kind="bone", of="", sd=sd) for sd in (1.0, 30.0))
    found = [columns_of(assessed.case.end, [cause], ["force"], stage.limbs) for cause in (small, large)]
    assert [failures for _, failures in found] == [{}, {}]
    one, other = (columns["p1", "force"]["bone"] for columns, _ in found)
    assert np.abs(one).max() > 0.0
    # The larger step brings the bone nearer by 7 of 18 mm, by which the change grows.
    np.testing.assert_allclose(other / 30.0, one, rtol=0.6, atol=1e-3 * np.abs(one).max())


def contact_mm(protocol, depths_mm):
    return np.array([protocol.indenter.contact_radius_mm(depth_mm) for depth_mm in depths_mm.tolist()])


@pytest.mark.parametrize(("data", "share"), [("measured", 0.3), ("simulated", 0.1)])
def test_friction_that_was_measured_on_skin_is_less_known(tmp_path, pressed_meshes, data, share):
    study, _ = pressed_meshes(tmp_path)
    causes = error_sources_of(replace(study, data=data), {"p1": Response(curves={})}, [])
    (friction,) = (cause for cause in causes if cause.kind == "friction")
    assert friction.sd == share * study.protocol.friction


@pytest.mark.parametrize(("data", "sd"), [("measured", 1.0), ("simulated", 0.0)])
def test_the_anatomy_of_simulated_data_is_known(tmp_path, pressed_meshes, data, sd):
    study, _ = pressed_meshes(tmp_path)
    found = error_sources_of(replace(study, data=data), {"p1": Response(curves={})}, [])
    sds = {cause.name: cause.sd for cause in found if cause.kind in ("position", "bone", "layers")}
    assert sds == ({"position p1 x": sd, "position p1 y": sd, "bone": sd} if sd else {})


def test_presses_at_one_place_share_its_position(tmp_path, pressed_meshes):
    study, _ = pressed_meshes(tmp_path)
    (first,) = study.spots
    again = replace(first, spot=replace(first.spot, name="p1-again"))
    away = replace(first, spot=replace(first.spot, name="p2", position_mm=np.array([5.0, 0.0, 0.0])))
    measured = dict.fromkeys(("p1", "p1-again", "p2", "planned"), Response(curves={}))
    study = replace(study, data="measured", spots=(first, again, away))
    found = [each for each in error_sources_of(study, measured, []) if each.kind == "position"]
    assert {each.of: each.spots for each in found} == {
        "p1 x": ("p1", "p1-again"),
        "p1 y": ("p1", "p1-again"),
        "p2 x": ("p2",),
        "p2 y": ("p2",),
        "planned x": ("planned",),
        "planned y": ("planned",),
    }


@pytest.mark.parametrize(("noted", "sd"), [("2.5", 2.5), ("2", 2.0), ("-1.0", 1.0), ("null", 1.0)])
def test_the_position_is_as_uncertain_as_its_note_says(tmp_path, pressed_meshes, noted, sd):
    study, _ = pressed_meshes(tmp_path)
    study.spots[0].mesh.with_suffix(".json").write_text(f'{{"std_across_mm": {noted}}}')
    found = error_sources_of(replace(study, data="measured"), {"p1": Response(curves={})}, [])
    assert [each.sd for each in found if each.kind == "position"] == [sd, sd]


class Film(HalfSpaceOnMesh):
    """A film on a rigid base: as thin as the skin of the mesh."""

    name = "film"
    summary = "an indenter on a film as thin as the skin of the mesh"

    def simulate(self, job, limb):
        skin = limb.mesh.points_mm[layers.nodes_of_regions(limb.mesh, ["skin"])]
        return super().simulate(job, SimpleNamespace(mesh=SimpleNamespace(points_mm=skin)))


class Layered(LimbSource):
    name = "layered"
    summary = "a block with a skin"

    def load(self, path, spot):
        limb = block(n_down=6, layers_mm={"skin": 3.0})
        return replace(limb, spot=spot, mesh=replace(limb.mesh, regions=("skin", "tissue")))


class WithFilm:
    palpate_solvers = staticmethod(hookimpl(lambda: [Film], specname="palpate_solvers"))
    palpate_limb_sources = staticmethod(hookimpl(lambda: [Layered], specname="palpate_limb_sources"))


@pytest.fixture
def layered_run(tmp_path, pressed_meshes, soft_region):
    """Run a study of a film, of which ``[spot.layers]`` has a measured thickness; open it again."""
    known = {"material": "neo_hookean", "parameters": {"E": "50 kPa", "nu": 0.45}}
    study, plugins = pressed_meshes(
        tmp_path,
        WithFilm(),
        solver={"name": "film"},
        limb={"source": "layered"},
        region={"skin": known, **soft_region},
        fit={"search": "least_squares"},
    )
    (spot,) = study.spots
    study = replace(study, spots=(replace(spot, layers_mm={"skin": (3.0, 0.3)}),))
    pipeline.run_study(study, tmp_path / "run", plugins)
    with pipeline.locked_run(study, tmp_path / "run", plugins, needs=["fit"]) as run:
        yield run


def test_a_measured_thickness_is_a_source_in_proportion_to_its_error(layered_run):
    """Also of simulated data, for which no other error of the anatomy is assumed."""
    assert layered_run.table("budget").filter(cause="layers")["share"].max() > 0.001
    stage, assessed = joint_assessed(layered_run)
    every = error_sources_of(layered_run.study, layered_run.measured, [])
    (own,) = (each for each in every if each.kind == "layers")
    assert (own.of, own.sd, own.spots) == ("p1 skin", pytest.approx(0.1), ("p1",))
    one, two = (
        columns_of(assessed.case.end, [replace(own, sd=sd)], ["force"], stage.limbs)[0]["p1", "force"]
        for sd in (0.05, 0.1)
    )
    assert np.abs(one[own.name]).max() > 0.0
    # One step of 0.46 standard deviations each, the other one half as long.
    np.testing.assert_allclose(two[own.name], 2.0 * one[own.name], rtol=0.03)


@pytest.mark.parametrize("data", ["measured", "simulated"])
def test_a_measured_thickness_takes_the_place_of_the_usual_one_at_its_spot(tmp_path, pressed_meshes, data):
    study, _ = pressed_meshes(tmp_path)
    (first,) = study.spots
    (region,) = study.space.regions
    away = replace(first, spot=replace(first.spot, name="p2", position_mm=np.array([5.0, 0.0, 0.0])))
    again = replace(first, spot=replace(first.spot, name="p1-again"))
    known = replace(first, layers_mm={"skin": (2.0, 0.0)}), replace(away, layers_mm={"skin": (1.6, 0.2)})
    regions = (replace(region, region="skin"), region)
    study = replace(study, data=data, space=replace(study.space, regions=regions))

    def found(*spots):
        measured = {each.spot.name: Response(curves={}) for each in spots}
        every = error_sources_of(replace(study, spots=spots), measured, [])
        return {(s.of, s.sd, s.spots) for s in every if s.kind == "layers" and "tissue" not in s.of}

    assert found(known[0], again) == set(), "of no error, and of all presses there"
    assert found(known[0], known[1]) == {("p2 skin", 0.2 / 1.6, ("p2",))}
    usual = {("skin", 0.1, ("p1", "p1-again"))} if data == "measured" else set()
    assert found(first, again, known[1]) == usual | {("p2 skin", 0.2 / 1.6, ("p2",))}
