"""A study of a tissue that relaxes: from its press and its rest to the moduli at once, and how they fall."""

from dataclasses import replace

import numpy as np
import pytest

import palpate_certainty
import palpate_materials
from palpate import hookimpl
from palpate.domain import Response, Scenario
from palpate.errors import StudyError
from palpate.run.directory import RunDirectory
from palpate.run.ledger import Ledger
from palpate.stages import pipeline
from palpate.stages.stage import read_run
from palpate.testing import StageContract, StudyRunner
from palpate_indentation.motions import Moves
from palpate_materials.relaxation import (
    RelaxationOverTime,
    Relaxed,
    Relaxing,
    RelaxingSettings,
    reduced_relaxation,
)

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


def test_the_terminal_says_what_is_left_and_what_a_record_does_not_tell(run):
    (line,) = run.stages["relaxation"].summarise(run).lines
    assert "of the moduli at once are left after 41 s" in line
    longer = replace(run.study, parametrisation=Relaxing(RelaxingSettings(relaxation_times=("1 s", "100 s"))))
    (line,) = run.stages["relaxation"].summarise(replace(run, study=longer)).lines
    assert line.endswith("a record of 41 s does not tell 100 s.")


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
