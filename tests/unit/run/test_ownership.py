"""palpate overwrites and removes only its files, in its folders."""

import errno
import json
import os
from dataclasses import replace
from functools import partial

import pytest

from palpate.errors import LedgerError, StudyError
from palpate.run.lock import locked, runner_of
from palpate.run.ownership import keep_only, listed
from palpate.stages import pipeline
from palpate_report import from_run

VERBS = ("run_study", "measure", "sample", "simulate", "score", "select", "report")

pytestmark = pytest.mark.usefixtures("one_figure")


def called(verb):
    """Function of the pipeline, or what runs a stage."""
    return getattr(pipeline, verb, None) or partial(pipeline.run_stage, verb)


@pytest.fixture
def done(make_study, plugins, tmp_path):
    """A study with its file, and a finished run of it."""
    (tmp_path / "study.toml").write_text("# as run\n")
    study = make_study(n_sets=4)
    pipeline.run_study(study, tmp_path / "run", plugins)
    return study, tmp_path / "run"


def test_a_folder_that_holds_something_else_is_refused_untouched(make_study, plugins, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    (other / "study.toml").write_text("# of another program\n")
    for verb in VERBS:
        with pytest.raises(
            StudyError, match=r"other: is not empty and not a run .*study\.toml.*--out|not there"
        ):
            called(verb)(make_study(), other, plugins)
    assert [path.name for path in other.iterdir()] == ["study.toml"]
    assert (other / "study.toml").read_text() == "# of another program\n"


def test_an_empty_folder_and_a_copy_without_hidden_files_are_taken(done, plugins, tmp_path):
    study, run = done
    (tmp_path / "empty").mkdir()
    pipeline.run_stage("sample", study, tmp_path / "empty", plugins)
    (run / ".palpate-run").unlink()
    from_run.report(study, run, plugins)
    assert (run / ".palpate-run").is_file()


def test_a_run_of_another_study_file_of_the_same_name_is_refused(done, plugins, tmp_path):
    study, run = done
    other = tmp_path / "variant.toml"
    other.write_text("# another\n")
    variant = replace(study, file=other)
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    for verb in VERBS:
        with pytest.raises(
            StudyError, match=r"run of .*study\.toml, not of .*variant\.toml; .*--out.*palpate run"
        ):
            called(verb)(variant, run, plugins)
    assert {path: path.read_bytes() for path in run.rglob("*") if path.is_file()} == before
    pipeline.run_study(variant, run, plugins, adopt=True)
    study.file.unlink()
    pipeline.run_study(variant, run, plugins)


def test_what_is_removed_is_what_palpate_wrote(done, plugins, tmp_path):
    study, run = done
    tables, deep = run / "report" / "tables", run / "notes" / "deep"
    deep.mkdir(parents=True)
    mine = [tables / "paper.tex", tables / "mine.csv", run / "report" / "figures" / "mine.svg"]
    mine += [run / ".thesis.part", deep / ".movie.part", deep / f".x.{'0' * 16}.palpate"]
    for path in mine:
        path.write_text("mine")
    left = [run / f".manifest.json.{'0' * 16}.palpate", run / "measured" / f".p1.json.{'a' * 16}.palpate"]
    for path in left:
        path.write_text("half")
    listing = run / "report" / "files.json"
    stale = tables / "refined.csv"
    stale.write_text("of an earlier report")
    names = json.loads(listing.read_text())["files"]
    listing.write_text(
        json.dumps({"files": [*names, "tables/refined.csv", "../manifest.json", "/etc/passwd"]})
    )
    pipeline.run_study(study, run, plugins)
    assert all(path.read_text() == "mine" for path in mine)
    assert not any(path.exists() for path in [*left, stale])
    assert (run / "manifest.json").exists()


def test_no_link_is_followed_to_what_is_removed(tmp_path):
    (tmp_path / "away").mkdir()
    (tmp_path / "away" / "a.csv").write_text("mine")
    report = tmp_path / "report"
    report.mkdir()
    (report / "tables").symlink_to(tmp_path / "away")
    (report / "b.csv").symlink_to(tmp_path / "away" / "a.csv")
    (report / "files.json").write_text(json.dumps({"files": ["tables/a.csv", "b.csv"]}))
    keep_only(report, ())
    assert (tmp_path / "away" / "a.csv").read_text() == "mine"
    assert not (report / "b.csv").is_symlink()
    for nonsense in ("[", "[]", '{"files": 3}', '{"files": [3]}', "[" * 100_000):
        (report / "files.json").write_text(nonsense)
        assert listed(report) == set()


def test_every_verb_keeps_to_the_lock(done, plugins):
    study, run = done
    with locked(run):
        for verb in VERBS:
            with pytest.raises(LedgerError, match="in use by process"):
                called(verb)(study, run, plugins)


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS])
def test_a_disk_that_refuses_is_an_error_with_its_path(done, plugins, monkeypatch, code):
    study, run = done
    opening = os.open

    def failing(path, flags, *more, **options):
        if flags & os.O_CREAT and str(run) in str(path):
            raise OSError(code, os.strerror(code), str(path))
        return opening(path, flags, *more, **options)

    monkeypatch.setattr(os, "open", failing)
    for verb in VERBS:
        with pytest.raises(LedgerError, match=r"run/.*: (no space is left|cannot be written).*; everything"):
            called(verb)(study, run, plugins)


def test_a_report_that_cannot_be_written_keeps_the_tables_of_the_last(done, plugins, monkeypatch):
    study, run = done
    before = {path: path.read_bytes() for path in (run / "report" / "tables").iterdir()}

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("palpate_report.from_run.write_figures", full)
    with pytest.raises(LedgerError, match="no space is left"):
        from_run.report(study, run, plugins)
    assert {path: path.read_bytes() for path in (run / "report" / "tables").iterdir()} == before


@pytest.mark.parametrize(
    "changes",
    [{"pid": 10**30}, {"pid": "7"}, {"pid": 0}, {"pid": -1}, {"pid": True}, {"host": 3}, {"beat": "x"}],
)
def test_a_damaged_record_of_the_runner_is_as_none(tmp_path, changes):
    record = {"host": "h", "pid": 7, "since": "s", "token": "t", "beat": 1}
    (tmp_path / "runner.json").write_text(json.dumps(record))
    assert runner_of(tmp_path).pid == 7
    (tmp_path / "runner.json").write_text(json.dumps(record | changes))
    assert runner_of(tmp_path) is None
