"""The note of a mesh goes into the run's manifest, the mesh's error above all."""

import json
from dataclasses import replace

import pytest

from palpate.domain.channels import FORCE, TORQUE
from palpate.errors import MeshError
from palpate.run.manifest import manifest
from palpate.study.spots import mesh_note
from palpate_certainty.mesh_error import SpotMesh, noted_errors
from palpate_limb.limb_files import RATIOS, mesh_error
from palpate_limb.options import DEFAULT_SIZE


def test_the_note_of_a_mesh_is_in_the_manifest(make_study, plugins, tmp_path):
    note = {"spot": "p1", "mesh_error": {"force": 0.006, "torque": 0.02}}
    (tmp_path / "p1.json").write_text(json.dumps(note))
    study = make_study()
    spots = tuple(replace(spot, mesh=tmp_path / f"{spot.spot.name}.vtu") for spot in study.spots)
    found = manifest(replace(study, spots=spots), plugins.channels)["spots"]
    assert found["p1"]["mesh"] == note
    assert all("mesh" not in spot for name, spot in found.items() if name != "p1")


@pytest.mark.parametrize("text", ["{", "[1]", "\ud7ff" * 400_000])
def test_what_is_no_note_is_refused_by_name(tmp_path, text):
    (tmp_path / "p1.json").write_text(text, encoding="utf-8")
    with pytest.raises(MeshError, match=r"p1\.json: not a note .*write it again, or move it away"):
        mesh_note(tmp_path / "p1.vtu")


def test_a_mesh_without_a_note_has_none(tmp_path):
    assert mesh_note(tmp_path / "p1.vtu") is None


def test_the_note_states_the_largest_error_that_was_measured():
    found = mesh_error(0.301, 1.0)
    assert found["force"] == pytest.approx(0.012, abs=1e-3), "the phantom's; the residual limb's is 1.0 %"
    assert found["torque"] == pytest.approx(0.066, abs=1e-3), "the forearm's; the phantom's is 4.5 %"
    assert mesh_error(0.409, 1.0)["torque"] == pytest.approx(0.118, abs=1e-3), "the residual limb's"
    assert "real forearm" in found["measured_on"]


def test_the_error_of_the_default_size_is_the_default_budget_of_its_fit():
    note = {"mesh_error": mesh_error(1.14 * DEFAULT_SIZE * 7.5, 7.5)}
    mesh = SpotMesh(edge_over_radius=1.14 * DEFAULT_SIZE, noted=noted_errors(note))
    assert 0.005 < mesh.error("force", FORCE.mesh, {}) < 0.015
    assert 0.04 < mesh.error("torque", TORQUE.mesh, {}) < 0.07


def test_meshes_that_were_not_studied_have_no_error():
    assert mesh_error(0.5 * RATIOS[0], 1.0)["torque"] is None
    assert mesh_error(2.0 * RATIOS[-1], 1.0)["torque"] is None
    finer, coarser = (mesh_error(ratio, 1.0) for ratio in (0.25, 0.35))
    assert finer["force"] < coarser["force"]
    assert finer["torque"] < coarser["torque"]
