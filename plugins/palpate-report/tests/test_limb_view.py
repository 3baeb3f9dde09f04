"""What is shown of a limb is its surface: closed, outward, in separate parts."""

import json
from dataclasses import replace

import numpy as np
import pytest

import palpate_report
from palpate.domain import Limb, Mesh, Spot
from palpate.domain.indenter import Sphere
from palpate.mesh.specimens import block, cylinder
from palpate.stages import pipeline
from palpate_report.figures.limb_view import ViewPart, limb_view, traces


def enclosed(parts: list[ViewPart]) -> float:
    """Volume [mm³] by the divergence theorem, positive where triangles look outwards."""
    corners = np.concatenate([part.points_mm[part.triangles] for part in parts])
    a, b, c = np.moveaxis(corners, 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


@pytest.mark.parametrize("kind", ["tet4", "tet10", "hex8"])
def test_the_outer_parts_enclose_a_mesh_of_any_elements(kind: str) -> None:
    limb = block(kind, n_across=4, n_down=3, layers_mm={"skin": 6.0})
    view = limb_view(limb)
    points = limb.mesh.points_mm
    outer = [part for part in view if part.role != "interface"]
    assert enclosed(outer) == pytest.approx(np.prod(np.ptp(points, axis=0)))
    assert {part.region for part in outer} == {"skin", "soft_tissue"}


def test_faces_with_midside_nodes_are_curved_as_far_as_there_are_triangles_for_it() -> None:
    limb = cylinder("tet10", np.array([0.0, 10.0, 20.0]), np.array([0.0, 20.0]), n_core=2)
    points = np.array(limb.mesh.points_mm)
    radii = np.linalg.norm(points[:, :2], axis=1)
    on_wall = radii > 20.0 * np.cos(np.pi / 8) - 1e-6
    points[on_wall, :2] *= 20.0 / radii[on_wall, None]
    limb = replace(limb, mesh=replace(limb.mesh, points_mm=points))
    volume = np.pi * 20.0**2 * 20.0
    views = [limb_view(limb)]
    n_flat = sum(len(part.triangles) for part in views[0])
    views += [limb_view(limb, most=4 * n_flat), limb_view(limb, most=100 * n_flat)]
    flat, halved, fine = (abs(enclosed(list(view)) / volume - 1.0) for view in views)
    assert flat > 0.05
    assert flat > 3.0 * halved
    assert fine < 0.01
    assert sum(len(part.triangles) for part in views[1]) == 4 * n_flat


def test_the_spot_s_skin_and_what_is_fixed_are_separate() -> None:
    limb = block("tet10", n_across=4, n_down=3, layers_mm={"skin": 6.0})
    parts = {(part.name, part.region): part for part in limb_view(limb)}
    contact, fixed = parts["contact", "skin"], parts["fixed", "soft_tissue"]
    assert (contact.role, fixed.role) == ("contact", "fixed")
    assert np.abs(contact.points_mm[:, 2]).max() == 0.0
    assert fixed.points_mm[:, 2].max() == limb.mesh.points_mm[:, 2].min()
    between = parts["skin | soft_tissue", "skin"]
    assert between.role == "interface"
    np.testing.assert_allclose(between.points_mm[:, 2], -6.0)


def test_a_bone_is_named_by_its_node_set() -> None:
    limb = block("tet4", n_across=4, n_down=3)
    mesh = limb.mesh
    low = np.flatnonzero(mesh.points_mm[:, 2] == mesh.points_mm[:, 2].min())
    sides = np.flatnonzero(np.abs(mesh.points_mm[:, 0]) == mesh.points_mm[:, 0].max())
    named = Mesh(
        points_mm=mesh.points_mm,
        cells=mesh.cells,
        cell_regions=mesh.cell_regions,
        regions=mesh.regions,
        node_sets={**mesh.node_sets, "fixed": np.union1d(low, sides), "ulna": low, "cut": sides},
    )
    parts = {part.name: part for part in limb_view(Limb(spot=limb.spot, mesh=named))}
    assert parts["ulna"].role == parts["cut"].role == "fixed"
    assert (parts["ulna"].points_mm[:, 2] == mesh.points_mm[:, 2].min()).all()
    assert len(parts["ulna"].triangles) == 2 * 4 * 4
    assert len(parts["cut"].triangles) == 2 * 2 * 4 * 3


def test_the_sphere_rests_on_any_spot() -> None:
    spot = Spot(name="p2", position_mm=np.array([3.0, -2.0, 1.0]), normal=np.array([0.6, 0.0, 0.8]))
    mesh = block("tet4", n_across=2, n_down=2).mesh
    view = limb_view(Limb(spot=spot, mesh=mesh), Sphere(radius_mm=7.5))
    ball = next(part for part in view if part.role == "indenter")
    heights = (ball.points_mm - spot.position_mm) @ spot.normal
    assert heights.min() == pytest.approx(0.0, abs=0.05)
    assert enclosed([ball]) == pytest.approx(4.0 / 3.0 * np.pi * 7.5**3, rel=0.02)


def test_traces_are_plain_values_that_name_points_that_exist() -> None:
    limb = block("tet10", n_across=4, n_down=3, layers_mm={"skin": 6.0})
    found = json.loads(json.dumps(traces(limb, limb_view(limb, Sphere(radius_mm=7.5)), 22.5)))
    mark, normal = ([trace[axis] for axis in "xyz"] for trace in found[-2:])
    assert (mark, normal) == ([[0.0]] * 3, [[0.0, 0.0], [0.0, 0.0], [0.0, 22.5]])
    for trace in found[:-2]:
        corners = [*trace["i"], *trace["j"], *trace["k"]]
        assert (min(corners), max(corners)) == (0, len(trace["x"]) - 1)
    shown = {trace["name"]: trace.get("visible", True) for trace in found}
    assert shown["skin | soft_tissue (skin)"] == "legendonly"
    assert shown["sphere"] is True
    assert shown["mark block"] is True


def test_a_run_with_a_finer_mesh_shows_the_limbs_of_its_spots(tmp_path, pressed_meshes):
    study, plugins = pressed_meshes(tmp_path, palpate_report)
    result = pipeline.run_study(study, tmp_path / "run", plugins)
    assert result.fit.mesh.height
    report = tmp_path / "run" / "report"
    assert (report / "index.html").is_file()
    assert (report / "figures" / "limbs.svg").is_file()
