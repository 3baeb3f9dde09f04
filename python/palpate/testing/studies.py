"""A small study around the plugin under test: 50 nodes, 3 sets, a few seconds."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import polars as pl
import pytest

from palpate.domain import Simulation, Status
from palpate.plugins.catalogue import Plugins
from palpate.study.reading import Study
from palpate.testing import bench
from palpate.testing.components import plugins_with
from palpate.toml_text import toml_value

DEFAULTS: Mapping[str, Any] = {
    "study": {"name": "small", "data": "simulated"},
    "experiment": {"loader": "points"},
    "protocol": {
        "indenter": {"shape": "sphere", "radius": "7.5 mm"},
        "depth": "2 mm",
        "twist": ["-10 deg", "10 deg", "0 deg"],
        "friction": 1.0,
    },
    "region": {"tissue": {"material": "linear"}},
    "sampling": {"n_sets": 3},
    "solver": {"name": "half_space"},
    "executor": {"name": "in_process"},
    "selection": {"scenarios": ["both"]},
}
"""Tables of the small study; those that a test gives take their place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SmallStudy:
    """Result of a small study.

    Parameters
    ----------
    simulations : tuple of Simulation
    scores, selection : DataFrame
        Tables of the stages ``score`` and ``select``.
    fitted : DataFrame
        Where each fit ended; empty unless the test gives a table ``fit``.
    """

    study: Study
    plugins: Plugins
    simulations: tuple[Simulation, ...]
    scores: pl.DataFrame
    selection: pl.DataFrame
    fitted: pl.DataFrame


class StudyRunner:
    """Makes a study of one spot in a folder, and runs its stages in this process.

    The study's own solver simulates its measured curves, in the middle of every range.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __call__(self, *plugins: object, mesh: str = "", **tables: Mapping[str, Any]) -> SmallStudy:
        """Run a study of these plugins and the parts of :mod:`palpate.testing.bench`.

        Parameters
        ----------
        plugins : module or object
            With hooks marked ``@palpate.hookimpl``.
        mesh : str
            Text of the spot's mesh file, for a limb source of one's own.
        tables : mapping
            Tables of study.toml that take the place of those in ``DEFAULTS``:
            ``solver={"name": "mine"}``. With ``limb`` the solver is one that needs a mesh.

        Raises
        ------
        PalpateError
            The study is refused.
        AssertionError
            palpate would leave a plugin out, or a simulation failed.
        """
        from palpate.stages import pipeline

        study, loaded = self.study(*plugins, mesh=mesh, **tables)
        folder = self.folder / "run"
        pipeline.measure(study, folder, loaded)
        for stage in ("sample", "simulate", "score", "select"):
            run = pipeline.run_stage(stage, study, folder, loaded)
        failed = [each.message for each in run.swept() if each.status is not Status.OK]
        assert not failed, f"a simulation failed: {failed[0]}"
        fitted = pipeline.run_study(study, folder, loaded).fit.table if "fit" in tables else pl.DataFrame()
        return SmallStudy(
            study=study,
            plugins=loaded,
            simulations=run.swept(),
            scores=run.table("scores"),
            selection=run.table("selection"),
            fitted=fitted,
        )

    def study(self, *plugins: object, mesh: str = "", **tables: Mapping[str, Any]) -> tuple[Study, Plugins]:
        """Write a study with the curves of its own solver, and read it; the arguments are as in a call."""
        from palpate.simulation.synthesis import synthesise
        from palpate.study.reading import read_study

        loaded = plugins_with(bench, *plugins)
        study = read_study(self.write(mesh, **tables), loaded, need_measured=False)
        middle = {p.name: (p.lower + p.upper) / 2.0 for p in study.space.parameters}
        study = replace(study, truth=middle)
        synthesise(study, loaded.channels)
        return study, loaded

    def write(self, mesh: str = "", **tables: Mapping[str, Any]) -> Path:
        """Write the study file, without its measured curves, and return its path."""
        parts = {**DEFAULTS, **tables}
        spot: dict[str, Any] = {"name": "p1", "measured": "p1.txt"}
        if "limb" in tables:
            spot["mesh"] = "mesh.txt"
            (self.folder / "mesh.txt").write_text(mesh, encoding="utf-8")
            parts["solver"] = tables.get("solver", {"name": "half_space_on_mesh"})
        lines = [f"[{name}]\n{_rows(table)}" for name, table in parts.items()]
        file = self.folder / "study.toml"
        file.write_text("\n".join([*lines, f"[[spot]]\n{_rows(spot)}"]), encoding="utf-8")
        return file

    def command(self, plugin: ModuleType, *words: object) -> int:
        """Call ``palpate`` with these words, and with the plugin and the bench as ``--plugin`` files."""
        from palpate.cli.app import main

        files = [str(module.__file__) for module in (bench, plugin)]
        return main([*(f"--plugin={file}" for file in files), *map(str, words)])


@pytest.fixture
def study_runner(tmp_path: Path) -> StudyRunner:
    """Provide what runs a small study; import the fixture in a ``conftest.py``."""
    return StudyRunner(tmp_path)


def _rows(table: Mapping[str, Any]) -> str:
    return "".join(f"{key} = {toml_value(value)}\n" for key, value in table.items())
