"""Runs of the analytic tissue that several tests read."""

import shutil
from dataclasses import replace

import pytest

from palpate import pipeline
from palpate.run.result import CertaintyResult


@pytest.fixture(scope="module")
def whole_run(tmp_path_factory):
    """Folder of the run that the first test of a file makes, and the others copy."""
    return tmp_path_factory.mktemp("whole") / "run"


@pytest.fixture
def run_once(whole_run, plugins, tmp_path):
    """Run the study of a file of tests, always the same, into ``run``; every test has a copy to change."""

    def run(study):
        if not whole_run.exists():
            pipeline.run_study(study, tmp_path / "run", plugins)
            shutil.copytree(tmp_path / "run", whole_run)
        return shutil.copytree(whole_run, tmp_path / "run", dirs_exist_ok=True)

    return run


@pytest.fixture(scope="session")
def contents():
    """What ``content`` has made, by the changes: a run of the same study is made once."""
    return {}


@pytest.fixture
def content(make_study, plugins, tmp_path, monkeypatch, contents):
    """ReportData of a run of the analytic tissue, whose spots differ; with ``assessed`` its model fails."""

    def run(changes):
        kept = []
        study = make_study(**({"n_sets": 40} | changes))
        with monkeypatch.context() as patch:
            patch.setattr(pipeline, "write_report", lambda content, folder: kept.append(content) or ())
            pipeline.run_study(study, tmp_path / "run", plugins)
        return kept[-1]

    def made(*, assessed=True, truth=None, **changes):
        key = repr(sorted(changes.items()))
        if "solver" in changes or " at 0x" in key:  # not named by what it does
            kept = run(changes)
        elif key in contents:
            kept = contents[key]
        else:
            kept = contents[key] = run(changes)
        kept = replace(kept, study=replace(kept.study, truth=truth or {}))  # only the report asks for it
        return kept if assessed else replace(kept, fit=replace(kept.fit, certainty=CertaintyResult()))

    return made


@pytest.fixture
def undrawn(monkeypatch):
    """Report without drawing, for what is not about the pictures."""
    import palpate.report

    monkeypatch.setattr(palpate.report, "write_figures", lambda content, folder: (folder / "a figure.svg",))
