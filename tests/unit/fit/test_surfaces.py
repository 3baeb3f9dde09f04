"""States of the skin in a run: simulated once, kept in files, and lost with nothing else."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.domain import Job, Limb, Simulation, Status, SurfaceStates
from palpate.domain.component import Settings
from palpate.errors import MeshError, StudyError
from palpate.executors import InProcess
from palpate.fit.fitted import Fitted
from palpate.fit.least_squares import LeastSquares
from palpate.fit.parametrisation import StandardParametrisation
from palpate.fit.surfaces import _job as fitted_job
from palpate.plugins.catalogue import Plugins
from palpate.plugins.interfaces import Solver
from palpate.plugins.provides import Provides
from palpate.progress import Progress
from palpate.run.directory import RunDirectory
from palpate.stages import pipeline
from palpate.stages.stage import read_run

pytestmark = pytest.mark.usefixtures("one_figure")

K, N = 3, 4
STATES = SurfaceStates(
    points_mm=np.arange(3.0 * N).reshape(N, 3) / 7.0,
    triangles=[[0, 1, 2], [0, 2, 3]],
    depth_mm=np.arange(K),
    rotation_deg=np.zeros(K),
    positions_mm=np.zeros((K, 3)),
    rotations=np.tile(np.eye(3), (K, 1, 1)),
    displacements_mm=np.full((K, N, 3), 1.0 / 3.0),
    areas_mm2=np.ones((K, N)),
    touching=np.ones((K, N)),
    pressures_MPa=np.full((K, N), 0.1),
    shears_MPa=np.zeros((K, N, 3)),
    tractions_MPa=np.full((K, N, 3), [0.0, 0.0, -0.1]),
)


class Recorded(Progress):
    """Keeps what is noted."""

    def __init__(self):
        self.notes = []

    def note(self, text):
        self.notes.append(text)


class LogSettings(Settings):
    log: str = ""


class Skinned(Solver[LogSettings]):
    """The analytic tissue with a skin that never changes."""

    name, summary = "skinned", "with a skin"
    provides = Provides(body="layers", surface=True)
    answer, fails = None, False  # of the analytic tissue

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        with Path(self.settings.log).open("a") as file:
            file.write(f"{job.spot} {job.surface}\n")
        if self.fails and job.surface:
            return Simulation(job=job, status=Status.DIVERGED, response=None, message="it slips")
        (theta,) = job.thetas.values()
        response = type(self).answer(*theta)
        return Simulation(job=job, status=Status.OK, response=response, surface=STATES)


@pytest.fixture
def skinned(make_study, tissue, tmp_path, monkeypatch):
    monkeypatch.setattr(Skinned, "answer", staticmethod(tissue.answer))
    log = tmp_path / "log.txt"

    def made(**changes):
        solver = Skinned(LogSettings(log=str(log)))
        return make_study(**({"solver": solver, "n_sets": 8, "executor": InProcess()} | changes))

    def simulated():
        lines = log.read_text().split("\n") if log.exists() else []
        return [line for line in lines if line.endswith("True")]

    return made, simulated


def same(one, other):
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in one.__dataclass_fields__)


def surfaces(study, folder):
    return read_run(
        study, RunDirectory(folder), Plugins.load(study.plugin_files, entry_points=False), is_copy=False
    ).surfaces()


@pytest.mark.slow
@pytest.mark.parametrize("search", [None, LeastSquares()])
def test_the_skin_is_simulated_once_for_each_spot_and_read_back(skinned, plugins, tmp_path, search):
    made, simulated = skinned
    study, run = made(**({} if search is None else {"search": search})), tmp_path / "run"
    pipeline.run_study(study, run, plugins)
    assert sorted(simulated()) == ["p1 True"]  # both spots have the same press
    table = pipeline.run_stage("surface", study, run, plugins).table("surface")
    assert table["source"][0].startswith("set" if search is None else "fit")
    found = surfaces(study, run)
    assert list(found) == ["p1", "p2"]
    assert all(same(states, STATES) for states in found.values())
    assert len(simulated()) == 1


def test_a_run_goes_on_without_a_skin(skinned, plugins, tmp_path, monkeypatch):
    made, _ = skinned
    monkeypatch.setattr(Skinned, "fails", True)
    progress = Recorded()
    result = pipeline.run_study(made(), tmp_path / "run", plugins, progress)
    assert result.selected.selection.height
    assert surfaces(made(), tmp_path / "run") == {}
    (note,) = (text for text in progress.notes if "palpate surface" in text)
    assert note.startswith("warning: no results of `palpate surface`: ")
    assert note.endswith("it slips")


@pytest.mark.slow
def test_the_cache_shares_the_skin_too(skinned, plugins, tmp_path):
    made, simulated = skinned
    study = replace(made(), cache=tmp_path / "cache")
    for name in ("one", "two"):
        pipeline.run_study(study, tmp_path / name, plugins)
        pipeline.run_stage("surface", study, tmp_path / name, plugins)
    assert len(simulated()) == 1
    assert same(surfaces(study, tmp_path / "two")["p1"], STATES)


def test_a_solver_without_skin_is_refused(make_study, plugins, tmp_path):
    study, run = make_study(n_sets=4), tmp_path / "run"
    pipeline.run_study(study, run, plugins)
    with pytest.raises(StudyError, match="solver 'analytic' does not give the states of the skin; use 'jax'"):
        pipeline.run_stage("surface", study, run, plugins)


@pytest.mark.slow
def test_another_selection_has_no_skin_yet(skinned, plugins, tmp_path):
    made, _ = skinned
    study, run = made(), tmp_path / "run"
    pipeline.run_study(study, run, plugins)
    assert surfaces(study, run)
    other = replace(study, search=LeastSquares())
    pipeline.run_stage("fit", other, run, plugins)
    assert surfaces(other, run) == {}


@pytest.mark.parametrize("relaxation", [True, False])
def test_the_skin_relaxes_where_the_solver_can(skinned, monkeypatch, relaxation):
    monkeypatch.setattr(Skinned, "provides", replace(Skinned.provides, relaxation=relaxation))
    monkeypatch.setattr(StandardParametrisation, "times_s", {"relaxed.10s": 10.0})
    study = skinned[0]()
    values = dict.fromkeys(study.space.names, 0.4) | {"relaxed.10s": 0.2}
    found = Fitted(source="fit", fit="all spots", scenario="both", values=values, spots=("p1", "p2"))
    job = fitted_job(study, "p2", found, {})
    assert job.thetas["soft_tissue"].tolist() == ([0.4, 0.4, 0.2] if relaxation else [0.4, 0.4])
    assert job.materials["soft_tissue"].relaxation_times_s == ((10.0,) if relaxation else ())


@pytest.mark.parametrize("is_fit", [True, False])
def test_no_name_of_a_source_decides_whether_values_are_fitted(is_fit):
    found = Fitted(source="fit", fit="p1", scenario="both", values={}, spots=("p1",), is_fit=is_fit)
    assert replace(found, source="set by hand").is_fit is is_fit
    assert found.is_fit is is_fit


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"pressures_MPa": np.zeros((K, N + 1))}, r"'pressures_MPa' has shape \(3, 5\) with 4 points and 3"),
        ({"areas_mm2": np.full((K, N), np.nan)}, "'areas_mm2' has values that are not finite"),
        ({"triangles": [[0, 1, N]]}, "a triangle names a point beyond the 4"),
    ],
)
def test_states_that_do_not_fit_together_are_refused(changes, expected):
    with pytest.raises(MeshError, match=expected):
        replace(STATES, **changes)


def test_resultants_are_of_area_times_traction():
    force, moment = STATES.resultants(np.zeros(3))
    np.testing.assert_allclose(force, np.tile([0.0, 0.0, -0.4], (K, 1)), rtol=1e-6)
    arms = (STATES.points_mm + STATES.displacements_mm[0]).sum(axis=0)
    np.testing.assert_allclose(moment[0], np.cross(arms, [0.0, 0.0, -0.1]), rtol=1e-6)
