"""Studies without a sweep, the default: no command speaks of one."""

import json
import shutil

import gallery
import pytest

from .conftest import edit

pytestmark = pytest.mark.usefixtures("one_figure")


@pytest.fixture
def unswept(study):
    edit(study, "n_sets = 20", "n_sets = 0")
    return study


def test_the_whole_run_comes_after_the_measured_curves(call, unswept):
    read = call("experiment", unswept)
    assert read.code == 0
    assert read.err.endswith(f"run {unswept}\n")
    assert "sample" not in read.err


@pytest.mark.parametrize("command", ["report", "score", "fit", "intervals"])
def test_what_is_missing_is_made_by_the_whole_run(call, unswept, command):
    refused = call(command, unswept)
    assert refused.code == 2
    assert "not there yet; run `palpate --plugin" in refused.err
    assert f"run {unswept}` first" in refused.err
    assert "sample" not in refused.err
    elsewhere = call(command, unswept, "--out", "other")
    assert f"run {unswept} --out other` first" in elsewhere.err


def test_the_gallery_shows_a_run_without_a_sweep(run_without_sweep, tmp_path, monkeypatch):
    shutil.copytree(run_without_sweep, tmp_path / "first-press")
    monkeypatch.setattr(gallery, "RUNS", tmp_path)
    shown = gallery.page()
    first = json.loads((run_without_sweep / "report" / "result.json").read_text())
    for text in (first["Conclusion"], first["Parameters"], "gallery/first-press/response_s1.png"):
        assert text in shown
    assert shown.count("Not run yet") == len(gallery.STUDIES) - 1
    assert "file://" not in shown
    assert "NMSE of all sets" not in shown
    names = dict(gallery.files())
    assert {"gallery/first-press/report.html", "gallery/first-press/intervals.png"} <= names.keys()
    assert all(path.is_file() for path in names.values())


def test_the_gallery_begins_with_a_success():
    assert gallery.STUDIES[0] == "first-press"
