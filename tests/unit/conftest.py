"""What a run of the analytic tissue leaves for its report, for every test of the report."""

from dataclasses import replace

import pytest

from palpate import pipeline
from palpate.run.result import CertaintyResult


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
