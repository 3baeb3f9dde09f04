"""Contracts of stages and scores."""

import json
import re
import shutil
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import ClassVar

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from palpate.domain import BoolArray, Curve, FloatArray
from palpate.errors import StudyError
from palpate.executors.answers import plain
from palpate.plugins.catalogue import Plugins
from palpate.plugins.score import Score
from palpate.plugins.sections import Summary
from palpate.plugins.table import StageTable
from palpate.progress import SILENT
from palpate.run.directory import RunDirectory
from palpate.stages.order import in_order
from palpate.stages.stage import Run, Stage, read_run
from palpate.study.reading import Study
from palpate.testing.components import ComponentContract, overridden
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

    stage = overridden("the stage under test")

    component = pytest.fixture(lambda self, stage: stage)

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
        for name, declared in stage.tables.items():
            assert re.fullmatch(r"[a-z][a-z0-9_]*", name), f"table {name!r}: use lower case and underscores"
            assert isinstance(declared, StageTable), f"table '{name}' is no StageTable"
            for text in (declared.text, *(column.text for column in declared.columns.values())):
                assert text.strip(), f"table '{name}' needs a sentence on it, and on each column"
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
                if declared := stage.tables.get(name):
                    lacking = declared.missing(table)
                    assert not lacking, f"table '{name}' has not the columns that it declares: {lacking}"

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
            with pytest.raises(StudyError, match=f"made before a change of results of `palpate {need}`"):
                run.check(stage.name)
            content[need]["files"] = files
            records.path.write_text(json.dumps(content))

    def test_summary_is_text_and_tables(self, stage: Stage, run: Run) -> None:
        run.make(stage)
        summary = stage.summarise(run)
        assert isinstance(summary, Summary)
        assert all(isinstance(line, str) and line.strip() for line in summary.lines)
        assert all(isinstance(table, pl.DataFrame) for table in summary.tables.values())


LINE = np.linspace(0.0, 4.0, 9)


class ScoreContract(ComponentContract):
    """Laws of a score; override ``score``, and ``measured`` if it scores other curves than a press."""

    has_unit: ClassVar[bool] = False
    """Whether the misfit has the unit of the ordinate, so that N and mN give other numbers."""

    score = overridden("the score under test")

    component = pytest.fixture(lambda self, score: score)

    @pytest.fixture
    def measured(self) -> Curve:
        """Provide a measured curve: by itself a press of 4 mm and its release."""
        loading = 0.5 * LINE**1.5
        force = np.concatenate([loading, 0.9 * loading[-2::-1]])
        depth = np.concatenate([LINE, LINE[-2::-1]])
        return Curve(channel="force", abscissa=depth, ordinate=force, std=np.full(force.size, 0.05))

    @pytest.fixture
    def used(self, score: Score, measured: Curve) -> BoolArray:
        """Provide the points that count."""
        return np.asarray(score.weights(measured) > 0.0)

    @pytest.fixture
    def others(self, measured: Curve) -> FloatArray:
        """Provide simulated curves (5, n): softer, stiffer, of another shape, flat and of the other sign."""
        y, ramp = measured.ordinate, np.linspace(0.8, 1.3, measured.ordinate.size)
        return np.stack([0.7 * y, 1.5 * y, ramp * y, 0.0 * y, -y])

    def test_weighs_each_point(self, score: Score, measured: Curve) -> None:
        weights = score.weights(measured)
        assert weights.shape == measured.ordinate.shape, f"weights of shape {weights.shape}"
        assert (np.isfinite(weights) & (weights >= 0.0)).all(), "a weight is negative or not finite"
        assert weights.any(), "no point of the curve counts"

    def test_the_same_curve_has_no_misfit(self, score: Score, measured: Curve, used: BoolArray) -> None:
        residuals = score.residuals(measured, measured.ordinate, used)[used]
        np.testing.assert_array_equal(residuals, 0.0, "the measured curve differs from itself")

    def test_every_curve_has_finite_residuals(
        self, score: Score, measured: Curve, used: BoolArray, others: FloatArray
    ) -> None:
        residuals = score.residuals(measured, others, used)
        assert residuals.shape == others.shape, f"residuals of {others.shape} ordinates: {residuals.shape}"
        assert np.isfinite(residuals[:, used]).all(), "a finite curve has a residual that is not"
        for one, of_all in zip(others, residuals, strict=True):
            message = "residuals of a curve depend on the others that are given with it"
            alone = score.residuals(measured, one, used)
            np.testing.assert_allclose(alone[used], of_all[used], rtol=1e-12, atol=1e-15, err_msg=message)

    def test_a_curve_farther_off_is_worse(self, score: Score, measured: Curve, used: BoolArray) -> None:
        scaled = np.array([0.6, 0.9, 1.0, 1.1, 1.6])[:, None] * measured.ordinate
        misfits = (score.residuals(measured, scaled, used)[:, used] ** 2).sum(axis=1)
        assert misfits[0] > misfits[1] > misfits[2] < misfits[3] < misfits[4], f"misfits {misfits}"

    def test_the_sweep_ranks_by_the_sum_of_squares(
        self, score: Score, measured: Curve, used: BoolArray, others: FloatArray
    ) -> None:
        every = np.ones(used.size, dtype=np.bool_)
        misfits, coverage = score.misfits(measured, every, measured.abscissa, others)
        squares = (score.residuals(measured, others, used)[:, used] ** 2).sum(axis=1)
        np.testing.assert_allclose(misfits, squares, rtol=1e-9, err_msg="misfits() are not Σ r²")
        np.testing.assert_allclose(coverage, 1.0, rtol=1e-12)

    def test_a_weight_is_outside(
        self, score: Score, measured: Curve, used: BoolArray, others: FloatArray
    ) -> None:
        weighted = score.weighted(measured, others, used, 0.25)
        expected = 0.5 * np.where(used, score.residuals(measured, others, used), 0.0)
        np.testing.assert_allclose(weighted, expected, rtol=1e-12, err_msg="a weight w is not √w of r")

    def test_slopes_are_those_of_the_residuals(
        self, score: Score, measured: Curve, used: BoolArray, others: FloatArray
    ) -> None:
        along, step = np.sin(np.arange(used.size)) * np.abs(measured.ordinate).max(), 1e-5
        for curve in others[:3]:
            slopes = score.slopes(measured, curve, used, along)[used]
            ends = [score.residuals(measured, curve + h * along, used)[used] for h in (step, -step)]
            differences, size = (ends[0] - ends[1]) / (2.0 * step), float(np.abs(slopes).max())
            message = "slopes() are not those of residuals()"
            np.testing.assert_allclose(slopes, differences, rtol=1e-4, atol=1e-4 * size, err_msg=message)
        scale = score.slopes(measured, measured.ordinate, used, np.ones(used.size))
        np.testing.assert_allclose(score.scale(measured, used)[used], scale[used], rtol=1e-9)

    def test_it_is_linear_if_it_says_so(
        self, score: Score, measured: Curve, used: BoolArray, others: FloatArray
    ) -> None:
        if score.linear:
            expected = (score.scale(measured, used) * (others - measured.ordinate))[:, used]
            found = score.residuals(measured, others, used)[:, used]
            message = "linear = True, and residuals are not in proportion"
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12, err_msg=message)

    def test_residuals_have_no_unit(
        self, score: Score, measured: Curve, used: BoolArray, others: FloatArray
    ) -> None:
        std = None if measured.std is None else 1000.0 * measured.std
        milli = replace(measured, ordinate=1000.0 * measured.ordinate, std=std)
        here, there = (
            score.residuals(m, k * others, used)[:, used] for m, k in ((measured, 1.0), (milli, 1e3))
        )
        expected = 1000.0 * here if self.has_unit else here
        np.testing.assert_allclose(there, expected, rtol=1e-9, atol=1e-12, err_msg="N and mN differ")
