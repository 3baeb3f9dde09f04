"""What a run of the analytic tissue leaves for its report, for every test of the report."""

import pytest

from palpate import pipeline


@pytest.fixture
def content(make_study, plugins, tmp_path, monkeypatch):
    """ReportData of a run of the analytic tissue."""

    def made(**changes):
        kept = []
        study = make_study(**({"n_sets": 40} | changes))
        with monkeypatch.context() as patch:
            patch.setattr(pipeline, "write_report", lambda content, folder: kept.append(content) or ())
            pipeline.run_study(study, tmp_path / "run", plugins)
        return kept[-1]

    return made


@pytest.fixture
def undrawn(monkeypatch):
    """Report without drawing, for what is not about the pictures."""
    import palpate.report

    monkeypatch.setattr(palpate.report, "write_figures", lambda content, folder: (folder / "a figure.svg",))


@pytest.fixture
def meshes_here(monkeypatch):
    """Read mesh files that exist in this process, for what is not about the process."""
    from palpate_indentation import mesh_files, mesh_source

    def read(path):
        return mesh_files.read_here(path) if path.is_file() else mesh_files.read_mesh_file(path)

    monkeypatch.setattr(mesh_source, "read_mesh_file", read)
