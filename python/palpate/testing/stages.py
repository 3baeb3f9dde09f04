"""Laws of stages, on a run of a small study."""

import json
import re
import shutil
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import polars as pl
import pytest
from polars.testing import assert_frame_equal

from palpate.domain.component import Component
from palpate.errors import StudyError
from palpate.executors.answers import plain
from palpate.plugins.catalogue import Plugins
from palpate.progress import SILENT
from palpate.run.directory import RunDirectory
from palpate.stages.stage import Run, Stage, Summary, in_order, read_run
from palpate.study.reading import Study
from palpate.testing.components import ComponentContract, missing
from palpate.testing.studies import StudyRunner


@cache
def _fitted() -> tuple[Study, Path, Plugins, tempfile.TemporaryDirectory[str]]:
    """Run of a small study with a fit; made once in a process, and removed with it."""
    from palpate.stages import pipeline

    kept = tempfile.TemporaryDirectory()
    study, plugins = StudyRunner(Path(kept.name)).study(fit={"search": "least_squares"})
    pipeline.run_study(study, Path(kept.name) / "run", plugins)
    return study, Path(kept.name) / "run", plugins, kept


class StageContract(ComponentContract):
    """Laws of a stage; override ``stage``, and ``run`` where it needs more than a fit with intervals."""

    @pytest.fixture
    def stage(self) -> Stage:
        """Provide the stage under test."""
        missing("stage", type(self).__name__)

    @pytest.fixture
    def component(self, stage: Stage) -> Component:
        """Provide the stage."""
        return stage

    @pytest.fixture
    def run(self, stage: Stage, tmp_path: Path) -> Run:
        """Provide a run of a small study to which the stage is added."""
        study, folder, plugins, _ = _fitted()
        shutil.copytree(folder, tmp_path / "run")
        found = read_run(study, RunDirectory(tmp_path / "run"), plugins, is_copy=False)
        return replace(found, stages={**found.stages, stage.name: stage})

    def test_can_be_a_command(self, stage: Stage) -> None:
        assert re.fullmatch(r"[a-z][a-z0-9_]*", stage.name), f"{stage.name!r}: use lower case and underscores"

    def test_needs_stages_that_there_are(self, stage: Stage, run: Run) -> None:
        assert in_order(run.stages, [stage.name])[-1] is stage

    def test_tables_have_names_of_files_and_a_sentence(self, stage: Stage, run: Run) -> None:
        others = {name for each in run.stages.values() if each is not stage for name in each.tables}
        for name, sentence in stage.tables.items():
            assert re.fullmatch(r"[a-z][a-z0-9_]*", name), f"table {name!r}: use lower case and underscores"
            assert sentence.strip(), f"table '{name}' needs a sentence on what it holds"
            assert name not in others, f"another stage has a table '{name}'; name yours otherwise"

    def test_what_decides_it_is_plain_and_repeats(self, stage: Stage, run: Run) -> None:
        first, again = (json.dumps(plain(dict(stage.decides(run.study))), sort_keys=True) for _ in range(2))
        assert first == again, "decides() gives other values when asked again"

    def test_gives_the_same_tables_twice(self, stage: Stage, run: Run) -> None:
        first, again = (stage.run(run, SILENT) for _ in range(2))
        assert first.keys() == again.keys()
        for name, table in first.items():
            assert name.partition(".")[0].partition("/")[0] in stage.tables, f"table '{name}' is not declared"
            if isinstance(table, pl.DataFrame) and isinstance(other := again[name], pl.DataFrame):
                assert_frame_equal(table, other)

    def test_tables_are_refused_once_what_they_were_made_from_has_changed(
        self, stage: Stage, run: Run
    ) -> None:
        run.make(stage)
        run.check(stage.name)
        records = run.directory.records
        for need in filter(records.has, stage.needs):
            content = json.loads(records.path.read_bytes())
            files, content[need]["files"] = content[need]["files"], {}
            records.path.write_text(json.dumps(content))
            with pytest.raises(StudyError, match=f"made from other results of `palpate {need}`"):
                run.check(stage.name)
            content[need]["files"] = files
            records.path.write_text(json.dumps(content))

    def test_summary_is_text_and_tables(self, stage: Stage, run: Run) -> None:
        run.make(stage)
        summary = stage.summarise(run)
        assert isinstance(summary, Summary)
        assert all(isinstance(line, str) and line.strip() for line in summary.lines)
        assert all(isinstance(table, pl.DataFrame) for table in summary.tables.values())
