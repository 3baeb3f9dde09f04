"""Skin over soft tissue, both searched at once, with the embedded solver from truth to selection."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from palpate.domain import (
    FloatArray,
    Indentation,
    Limb,
    Parameter,
    ParameterSpace,
    RegionMaterial,
    Scenario,
    Spot,
)
from palpate.domain.indenter import Sphere
from palpate.executors import InProcess
from palpate.fit.parametrisation import StandardParametrisation
from palpate.fit.searches import BestSet
from palpate.mesh.specimens import block
from palpate.plugins.catalogue import Plugins
from palpate.plugins.interfaces import LimbSource, Sampler
from palpate.simulation.synthesis import synthesise
from palpate.stages import pipeline
from palpate.study.reading import Study, StudySpot
from palpate_indentation import CsvLoader
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.neo_hookean import NeoHookean

SETS = np.array([[0.8, 0.5], [0.5, 0.8], [0.8, 0.4], [0.5, 0.5], [0.5, 0.2], [0.35, 0.55]])
"""Skin and soft tissue in shares of their ranges: the truth, one off, and one off against the other."""
TRUE_SET = 3
TRUTH = {"skin.E": 0.15, "soft_tissue.E": 0.04}


class Given(Sampler):
    name, summary = "given", "the sets of this test"

    def draw(self, n_sets: int, n_parameters: int, seed: int) -> FloatArray:
        return SETS


class TwoLayers(LimbSource):
    name, summary = "two_layers", "a block of two layers"

    def load(self, path: Path, spot: Spot) -> Limb:
        return block(n_across=4, n_down=3, width_mm=24.0, height_mm=9.0, layers_mm={"skin": 3.0})


def region(name: str, upper: float) -> RegionMaterial:
    young = Parameter(name="E", unit="MPa", lower=0.0, upper=upper, kind="modulus", description="stiffness")
    return RegionMaterial(region=name, material=NeoHookean(), searched=(young,), fixed={"nu": 0.45})


def layered_study(folder: Path) -> Study:
    (folder / "mesh").touch()
    return Study(
        name="layered",
        description="two layers",
        file=folder / "study.toml",
        data="simulated",
        spots=(StudySpot(spot=Spot(name="s"), measured={None: (folder / "s.csv",)}, mesh=folder / "mesh"),),
        loader=CsvLoader(),
        limb_source=TwoLayers(),
        protocol=Indentation(
            indenter=Sphere(radius_mm=7.5),
            path=np.array([(0.0, 0.0), (2.0, 0.0), (2.0, -8.0), (2.0, 0.0)]),
            friction=0.6,
        ),
        space=ParameterSpace(regions=(region("skin", 0.3), region("soft_tissue", 0.08))),
        sampler=Given(),
        n_sets=len(SETS),
        seed=1,
        filters=(),
        solver=JaxSolver(JaxSettings(depth_steps=2, rotation_step_deg=4.0)),
        scenarios=(Scenario(name="I", weights={"force": 1.0, "torque": 1.0}),),
        generalise_by="I",
        search=BestSet(),
        parametrisation=StandardParametrisation(),
        truth=TRUTH,
        n_workers=1,
        time_limit_s=60.0,
        plugin_files=(),
        executor=InProcess(),
    )


@pytest.fixture(scope="module")
def fopt(tmp_path_factory: pytest.TempPathFactory) -> pl.DataFrame:
    """Synthesise, sweep and score: one row per set with its Fopt."""
    folder = tmp_path_factory.mktemp("layered")
    study, plugins = layered_study(folder), Plugins.load()
    synthesise(study, plugins.channels)
    pipeline.measure(study, folder / "run", plugins)
    for stage in ("sample", "simulate", "score"):
        pipeline.run_stage(stage, study, folder / "run", plugins)
    (chosen,) = pipeline.run_stage("select", study, folder / "run", plugins).table("selection").to_dicts()
    scores = pl.read_parquet(folder / "run" / "scores.parquet")
    frame = scores.group_by("set_id").agg(fopt=pl.col("nmse").sum()).sort("set_id")
    return frame.with_columns(
        chosen=pl.col("set_id") == chosen["set_id"], **{k: pl.lit(chosen[k]) for k in TRUTH}
    )


@pytest.mark.slow
def test_both_materials_are_found_among_the_sets(fopt: pl.DataFrame) -> None:
    best = fopt.row(by_predicate=pl.col("chosen"), named=True)
    assert best["set_id"] == TRUE_SET
    assert {name: best[name] for name in TRUTH} == pytest.approx(TRUTH)
    assert best["fopt"] < 1e-9


def test_a_wrong_skin_or_a_wrong_tissue_is_seen_and_so_is_one_against_the_other(fopt: pl.DataFrame) -> None:
    others = fopt.filter(~pl.col("chosen"))
    assert others.height == len(SETS) - 1
    assert others["fopt"].min() > 0.02
