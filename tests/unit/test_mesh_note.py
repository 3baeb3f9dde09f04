"""What was written beside a mesh goes into the run's manifest, the mesh's own error above all."""

import json
from dataclasses import replace

import pytest

from palpate.errors import MeshError
from palpate.limb import mesh_note
from palpate.run_directory import manifest


def test_the_note_beside_a_mesh_stands_in_the_manifest(make_study, plugins, tmp_path):
    note = {"spot": "p1", "mesh_error": {"force": 0.006, "torque": 0.02}}
    (tmp_path / "p1.json").write_text(json.dumps(note))
    study = make_study()
    spots = tuple(replace(spot, mesh=tmp_path / f"{spot.spot.name}.vtu") for spot in study.spots)
    told = manifest(replace(study, spots=spots), plugins.channels)["spots"]
    assert told["p1"]["mesh"] == note
    assert all("mesh" not in spot for name, spot in told.items() if name != "p1")


@pytest.mark.parametrize("text", ["{", "[1]", "\ud7ff" * 400_000])
def test_what_is_no_note_is_refused_by_name(tmp_path, text):
    (tmp_path / "p1.json").write_text(text, encoding="utf-8")
    with pytest.raises(MeshError, match=r"p1\.json: not a note .*make it anew, or move it away"):
        mesh_note(tmp_path / "p1.vtu")


def test_a_mesh_without_a_note_has_none(tmp_path):
    assert mesh_note(tmp_path / "p1.vtu") is None
