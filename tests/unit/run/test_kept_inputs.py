"""Copies that a run keeps of its inputs lie around that of the study as these lie around the study."""

from types import SimpleNamespace

import pytest

from palpate.run import kept_inputs
from palpate.run.kept_inputs import keep_inputs, kept_plugin, kept_study


@pytest.fixture
def study(tmp_path):
    files = {
        "arm/study.toml": 'name = "arm"\n[[spot]]\nmesh = "../meshes/p1.vtu"\nmeasured = "p1.csv"\n',
        "arm/p1.csv": "0,0\n",
        "arm/other.csv": "not named\n",
        "meshes/p1.vtu": "mesh",
        "meshes/p1.json": "its note",
        "elsewhere/tissue.py": "plugin",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    plugin = tmp_path / "elsewhere" / "tissue.py"
    return SimpleNamespace(file=tmp_path / "arm" / "study.toml", plugin_files=(plugin,))


def test_the_study_and_what_it_names_keep_their_places(study, tmp_path):
    run = tmp_path / "run"
    manifest = {"kept_study": keep_inputs(run, study)}
    kept = kept_study(run, manifest)
    assert kept is not None
    assert kept.read_bytes() == study.file.read_bytes()
    assert (kept.parent / "p1.csv").is_file()
    assert not (kept.parent / "other.csv").exists()
    assert {file.name for file in (kept.parent / ".." / "meshes").iterdir()} == {"p1.vtu", "p1.json"}
    assert kept_plugin(run, 0, study.plugin_files[0]).read_text() == "plugin"


def test_a_link_is_kept_at_its_own_place(study, tmp_path):
    file = tmp_path / "arm" / "p1.csv"
    file.rename(tmp_path / "elsewhere" / "press 7.csv")
    file.symlink_to(tmp_path / "elsewhere" / "press 7.csv")
    kept = kept_study(tmp_path / "run", {"kept_study": keep_inputs(tmp_path / "run", study)})
    assert kept is not None
    assert (kept.parent / "p1.csv").read_text() == "0,0\n"


def test_plugin_files_of_one_name_are_kept_apart(study, tmp_path):
    other = tmp_path / "other" / study.plugin_files[0].name
    other.parent.mkdir()
    other.write_text("another")
    run, files = tmp_path / "run", (study.plugin_files[0], other)
    keep_inputs(run, SimpleNamespace(file=study.file, plugin_files=files))
    assert [kept_plugin(run, k, file).read_text() for k, file in enumerate(files)] == ["plugin", "another"]


def test_the_kept_study_is_not_copied_into_itself(study, tmp_path):
    run = tmp_path / "run"
    place = keep_inputs(run, study)
    before = sorted(run.rglob("*"))
    again = SimpleNamespace(file=run / place, plugin_files=(kept_plugin(run, 0, study.plugin_files[0]),))
    assert keep_inputs(run, again) == place
    assert sorted(run.rglob("*")) == before


def test_a_large_file_is_left_where_it_is(study, tmp_path, monkeypatch):
    monkeypatch.setattr(kept_inputs, "MOST_BYTES", 3)
    keep_inputs(tmp_path / "run", study)
    assert not list((tmp_path / "run").rglob("*.json"))


def test_a_run_of_a_study_without_a_file_keeps_none(tmp_path):
    study = SimpleNamespace(file=tmp_path / "none.toml", plugin_files=())
    assert keep_inputs(tmp_path / "run", study) == ""
    assert kept_study(tmp_path / "run", {}) is None
