"""Mesh files that are read in the process of the test."""

import pytest


@pytest.fixture
def meshes_here(monkeypatch):
    """Read mesh files that exist in this process, for what is not about the process."""
    from palpate_indentation import mesh_files, mesh_source

    def read(path):
        return mesh_files.read_here(path) if path.is_file() else mesh_files.read_mesh_file(path)

    monkeypatch.setattr(mesh_source, "read_mesh_file", read)
