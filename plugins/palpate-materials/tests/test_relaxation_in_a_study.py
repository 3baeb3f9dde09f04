"""A study of a tissue that relaxes: from its press and its rest to the moduli at once, and how they fall."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

import palpate_certainty
import palpate_materials
from palpate import hookimpl
from palpate.api import relaxing as made_to_relax
from palpate.domain import ParameterSpace, Response, Scenario
from palpate.errors import StudyError
from palpate.progress import SILENT
from palpate.run.directory import RunDirectory
from palpate.run.ledger import Ledger
from palpate.stages import pipeline
from palpate.stages.stage import read_run
from palpate.testing import StageContract, StudyRunner
from palpate_indentation.motions import Moves
from palpate_materials.relaxation import (
    Relaxed,
    Relaxing,
    RelaxingSettings,
    loss_tangent,
    reduced_relaxation,
)
from palpate_materials.relaxation_over_time import RelaxationOverTime

pytestmark = pytest.mark.slow

TIMES_S, SHARES = np.array([1.0, 10.0]), np.array([0.2, 0.15])
WEIGHTS = {"force": 1.0, "force_over_time": 1.0}
REST_S = 40.0
TABLES = {
    "protocol": {
        "indenter": {"shape": "sphere", "radius": "7.5 mm"},
        "motion": "moves",
        "moves": [{"depth": "2 mm", "duration": "1 s"}, {"duration": f"{REST_S:g} s"}],
        "friction": 1.0,
    },
    "selection": {"scenarios": ["pressed"]},
    "fit": {
        "search": "least_squares",
        "parametrisation": "relaxing",
        "searched": {"relaxation_times": ["1 s", "10 s"]},
    },
}


class Pressed:
    @hookimpl
    def palpate_motions(self):
        return [Moves]

    @hookimpl
    def palpate_scenarios(self):
        return [Scenario(name="pressed", weights=WEIGHTS)]


@pytest.fixture(scope="module")
def relaxing(tmp_path_factory):
    """A run of a study whose measured tissue relaxes: folder, study, plugins."""
    folder = tmp_path_factory.mktemp("relaxing")
    plugins = (palpate_materials, palpate_certainty, Pressed())
    study, loaded = StudyRunner(folder).study(*plugins, **TABLES)
    file = folder / "p1.txt"
    elastic, random = study.loader.load(file), np.random.default_rng(1)
    timed = {
        "force": replace(elastic["force"], time_s=elastic["force"].abscissa / 2.0),
        "force_over_time": replace(elastic["force_over_time"], time_s=elastic["force_over_time"].abscissa),
    }
    found = Relaxed(TIMES_S, SHARES)(Response(curves=timed))
    noisy = {
        name: replace(curve, ordinate=curve.ordinate + random.normal(0.0, 2e-3, curve.ordinate.size))
        for name, curve in found.curves.items()
    }
    study.loader.save(file, Response(curves=noisy))
    pipeline.run_study(study, folder / "run", loaded)
    return folder / "run", study, loaded


@pytest.fixture
def run(relaxing):
    folder, study, plugins = relaxing
    return read_run(study, RunDirectory(folder), plugins, is_copy=False)


def test_the_truth_is_inside_of_the_intervals(run):
    truth = {**run.study.truth, "relaxed.1s": SHARES[0], "relaxed.10s": SHARES[1]}
    rows = run.table("intervals").to_dicts()
    assert {row["parameter"] for row in rows} == truth.keys()
    for row in rows:
        assert row["lower"] <= truth[row["parameter"]] <= row["upper"], row


def test_the_band_holds_the_modulus_that_is_left(run):
    table = run.table("relaxation")
    left = reduced_relaxation(table["time_s"].to_numpy(), TIMES_S, SHARES)
    assert (table["lower"].to_numpy() <= left).all()
    assert (left <= table["upper"].to_numpy()).all()
    assert table["time_s"][-1] == pytest.approx(1.0 + REST_S)
    losses = loss_tangent(1.0 / table["time_s"].to_numpy(), TIMES_S, SHARES)
    assert (table["loss_lower"].to_numpy() <= losses).all()
    assert (losses <= table["loss_upper"].to_numpy()).all()


def test_intervals_hold_the_moduli_at_once_and_later(run):
    table = run.table("relaxing_moduli").filter(fit="p1", scenario="pressed")
    assert table["shear_modulus"].to_list() == ["at once", "after 41 s", "long-term"]
    at_once_MPa = 0.5 * run.study.truth["tissue.e"]  # of the energy e/2 Σ (λ − 1)²
    left = reduced_relaxation(np.array([0.0, 1.0 + REST_S, np.inf]), TIMES_S, SHARES)
    for row, share in zip(table.to_dicts(), left, strict=True):
        assert row["lower"] <= at_once_MPa * share <= row["upper"], row
        assert row["unit"] == "MPa"


def test_the_terminal_says_what_is_left_and_what_a_record_does_not_tell(run, monkeypatch):
    left, shear, loss = run.stages["relaxation"].summarise(run).lines
    assert "of the moduli at once are left after 41 s" in left
    assert shear.startswith("Shear modulus ")
    assert "at once (" in shear
    assert "after 41 s (" in shear
    assert loss.endswith("at 1 rad/s, the rate of a press in 1 s.")
    found = run.fitted()
    monkeypatch.setattr(type(run), "fitted", lambda self: found)
    longer = replace(run.study, parametrisation=Relaxing(RelaxingSettings(relaxation_times=("1 s", "100 s"))))
    _, untold, *_ = run.stages["relaxation"].summarise(replace(run, study=longer)).lines
    assert untold == "A record of 41 s does not tell 100 s."


def test_the_page_draws_the_band(run):
    (figure,) = run.stages["relaxation"].summarise(run).figures
    lower, upper, left = (np.array(trace["y"]) for trace in figure.traces)
    assert (lower <= left).all()
    assert (left <= upper).all()


def test_shares_of_a_regions_stress_are_shown_as_those_of_all_moduli(run, relaxing, monkeypatch):
    """The same draws under the names of the shares that the solver relaxes by."""
    (region,) = run.study.space.regions
    material = made_to_relax(region.material, TIMES_S)
    shares = material.parameters[-2:]
    own = {"relaxed.1s": "tissue.relaxed_1s", "relaxed.10s": "tissue.relaxed_10s"}
    in_solver = replace(
        run.study,
        space=ParameterSpace(
            regions=(replace(region, material=material, searched=(*region.searched, *shares)),)
        ),
        parametrisation=relaxing[2].parametrisations["standard"](),
    )
    stage = RelaxationOverTime()
    assert stage.is_in_run(in_solver)
    expected = stage.run(run, SILENT)
    reported = run.fitted()
    named = {
        "draws": run.table("draws").rename(own),
        "intervals": run.table("intervals").with_columns(pl.col("parameter").replace(own)),
    }
    monkeypatch.setattr(type(run), "table", lambda self, name, stage="": named[name])
    monkeypatch.setattr(type(run), "fitted", lambda self: reported)
    found = stage.run(replace(run, study=in_solver, fresh=run.inputs), SILENT)
    assert found["relaxation"]["region"].unique().to_list() == ["tissue"]
    for name, table in expected.items():
        assert_frame_equal(found[name].drop("region"), table.drop("region"))
    monkeypatch.setattr(type(run), "table", lambda self, name, stage="": found[name])
    left, *_, loss = stage.summarise(replace(run, study=in_solver)).lines
    assert "of the moduli at once are left after 41 s" in left
    assert loss.startswith("Loss tangent ")


def test_no_simulation_is_for_a_share(run):
    """Slopes in the shares are free: the solver has none, so each other parameter costs two simulations."""
    with Ledger(run.directory.folder) as ledger:
        jobs = ledger.frame()
    assert jobs.height < 60
    assert jobs["state"].unique().to_list() == ["ok"]


class TestRelaxationOverTime(StageContract):
    @pytest.fixture
    def run(self, run):
        return run

    @pytest.fixture
    def stage(self, run):
        return run.stages["relaxation"]


def test_an_elastic_study_has_no_relaxation(relaxing):
    _, study, plugins = relaxing
    elastic = replace(study, parametrisation=plugins.parametrisations["standard"]())
    assert not RelaxationOverTime().is_in_run(elastic)
    with pytest.raises(StudyError, match='parametrisation = "relaxing"'):
        RelaxationOverTime().run(type("Inputs", (), {"study": elastic})(), None)
