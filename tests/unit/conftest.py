"""What a run of the analytic tissue leaves for its report, for every test of the report."""

from dataclasses import replace

import pytest

from palpate import pipeline
from palpate.run.result import CertaintyResult


@pytest.fixture
def content(make_study, plugins, tmp_path, monkeypatch):
    """ReportData of a run of the analytic tissue, whose spots differ; with ``assessed`` its model fails."""

    def made(*, assessed=True, **changes):
        kept = []
        study = make_study(**({"n_sets": 40} | changes))
        with monkeypatch.context() as patch:
            patch.setattr(pipeline, "write_report", lambda content, folder: kept.append(content) or ())
            pipeline.run_study(study, tmp_path / "run", plugins)
        fit = kept[-1].fit
        return kept[-1] if assessed else replace(kept[-1], fit=replace(fit, certainty=CertaintyResult()))

    return made


@pytest.fixture
def undrawn(monkeypatch):
    """Report without drawing, for what is not about the pictures."""
    import palpate.report

    monkeypatch.setattr(palpate.report, "write_figures", lambda content, folder: (folder / "a figure.svg",))
