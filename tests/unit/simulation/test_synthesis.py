"""The curves that a truth would give: simulated, written, read back, and never over something."""

import itertools
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from palpate import ExperimentLoader
from palpate.domain import Curve, Response, Spot
from palpate.errors import CurveError, PalpateError, StudyError
from palpate.plugins.catalogue import Plugins
from palpate.plugins.provides import Provides
from palpate.simulation.synthesis import NOTE, synthesise
from palpate.stages.pipeline import run_study
from palpate.study.reading import Study, StudySpot, read_study
from palpate.testing.bench import HalfSpace
from palpate_indentation import CsvLoader

ANSWER = (0.4, 20.0)
TRUTH = {"soft_tissue.stiffness": ANSWER[0], "soft_tissue.grip": ANSWER[1]}
TOY = Path(__file__).parents[2] / "data" / "toy"

Planned = Callable[..., Study]


class Pairs(ExperimentLoader):
    """Rows of channel, abscissa and ordinate, that are read and written."""

    name, summary = "pairs", "channel,abscissa,ordinate"

    def load(self, path: Path, channel: str | None = None) -> Response:
        rows = [line.split(",") for line in path.read_text().splitlines()]
        found = {name: np.array([row[1:] for row in rows if row[0] == name], float) for name, *_ in rows}
        curves = {n: Curve(channel=n, abscissa=xy[:, 0], ordinate=xy[:, 1]) for n, xy in found.items()}
        return Response(curves=curves)

    def save(self, path: Path, response: Response, channel: str | None = None) -> None:
        curves = response.curves.values() if channel is None else [response[channel]]
        rows = (
            f"{curve.channel},{float(x)!r},{float(y)!r}\n"
            for curve in curves
            for x, y in zip(curve.abscissa, curve.ordinate, strict=True)
        )
        path.write_text("".join(rows))


@pytest.fixture
def planned(make_study: Callable[..., Study], tmp_path: Path) -> Planned:
    """Make a study with a truth whose measured files do not exist yet."""

    def make(**changes: Any) -> Study:
        spots = tuple(
            StudySpot(
                spot=Spot(name=name), measured={None: (tmp_path / "planned" / f"{name}.csv",)}, mesh=None
            )
            for name in ("p1", "p2")
        )
        return make_study(**{"spots": spots, "truth": TRUTH, "loader": Pairs(), **changes})

    return make


def assert_same(found: Response, expected: Response) -> None:
    assert set(found) == set(expected)
    for name in expected:
        assert np.array_equal(found[name].abscissa, expected[name].abscissa)
        assert np.array_equal(found[name].ordinate, expected[name].ordinate)


# ------------------------------------------------------------------ what is written


def test_the_loader_reads_what_the_solver_gave_to_the_last_bit(
    planned: Planned, tissue: ModuleType, plugins: Plugins, tmp_path: Path
) -> None:
    study = planned()
    responses, files = synthesise(study, plugins.channels)
    assert [file.name for file in files] == ["p1.csv", "p2.csv", NOTE]
    for spot in study.spots:
        assert_same(study.loader.load(spot.measured[None][0]), tissue.answer(*ANSWER))
        assert_same(responses[spot.spot.name], tissue.answer(*ANSWER))


@pytest.mark.usefixtures("one_figure")
def test_a_run_over_the_curves_finds_the_set_nearest_to_the_truth(
    planned: Planned, tissue: ModuleType, plugins: Plugins, tmp_path: Path
) -> None:
    """Each curve is proportional to its parameter, so NMSE = (relative error)² · mean(y²)/mean(|y|)²."""
    study = planned(n_sets=40)
    synthesise(study, plugins.channels)
    result = run_study(study, tmp_path / "run", plugins)
    curves = [tissue.answer(*ANSWER)[name].ordinate for name in ("force", "torque")]
    shares = [np.mean(y**2) / np.mean(np.abs(y)) ** 2 for y in curves]
    fopt = ((result.design.values / ANSWER - 1.0) ** 2) @ shares
    for row in result.selected.selection.filter(scenario="I").iter_rows(named=True):
        assert row["set_id"] == fopt.argmin()
        assert row["fopt"] == pytest.approx(fopt.min(), rel=1e-9)


def test_files_of_one_channel_each(
    planned: Planned, tissue: ModuleType, plugins: Plugins, tmp_path: Path
) -> None:
    files: dict[str | None, Path] = {"force": tmp_path / "f.csv", "torque": tmp_path / "t.csv"}
    study = planned(
        spots=(StudySpot(spot=Spot(name="p1"), measured={c: (f,) for c, f in files.items()}, mesh=None),)
    )
    synthesise(study, plugins.channels)
    for name, path in files.items():
        expected = Response(curves={str(name): tissue.answer(*ANSWER)[str(name)]})
        assert_same(study.loader.load(path, name), expected)


def test_each_repeat_gets_different_noise(planned: Planned, plugins: Plugins, tmp_path: Path) -> None:
    files = tuple(tmp_path / "planned" / f"{name}.csv" for name in "abc")
    spot = StudySpot(spot=Spot(name="p1"), measured={None: files}, mesh=None)
    responses, written = synthesise(planned(spots=(spot,)), plugins.channels, noise=0.01)
    assert written[:-1] == files
    forces = [planned().loader.load(file)["force"].ordinate for file in files]
    np.testing.assert_array_equal(forces[0], responses["p1"]["force"].ordinate)
    assert all((a != b).all() for a, b in itertools.combinations(forces, 2))


def test_out_takes_the_place_of_the_study_folder(planned: Planned, plugins: Plugins, tmp_path: Path) -> None:
    out = tmp_path / "elsewhere"
    _, files = synthesise(planned(), plugins.channels, out)
    assert list(files) == [out / "planned" / name for name in ("p1.csv", "p2.csv", NOTE)]
    assert not (tmp_path / "planned").exists()


def test_a_file_outside_the_study_folder_stays_inside_out(
    planned: Planned, plugins: Plugins, tmp_path: Path
) -> None:
    spot = StudySpot(spot=Spot(name="p1"), measured={None: (tmp_path / ".." / "p1.csv",)}, mesh=None)
    _, files = synthesise(planned(spots=(spot,)), plugins.channels, tmp_path / "out")
    assert files == (tmp_path / "out" / "p1.csv", tmp_path / "out" / NOTE)


def test_the_note_records_what_made_the_curves(planned: Planned, plugins: Plugins, tmp_path: Path) -> None:
    _, files = synthesise(planned(), plugins.channels, noise=0.01, seed=7)
    note = json.loads(files[-1].read_text())
    assert "simulated" in note["origin"]
    assert note["truth"]["soft_tissue"]["values"] == {"stiffness": 0.4, "grip": 20.0}
    assert note["solver"]["name"] == "analytic"
    assert note["solver"]["settings"] == {"offset": 0.0, "log": ""}
    assert {"palpate", "solver analytic"} <= set(note["versions"])
    assert (note["noise"], note["seed"]) == (0.01, 7)


# --------------------------------------------------------------------------- truth


def test_the_truth_may_depart_from_what_the_fit_takes_as_fixed(
    planned: Planned, tissue: ModuleType, plugins: Plugins
) -> None:
    study = planned()
    region = study.space.regions[0]
    fixed = replace(region, searched=region.searched[:1], fixed={"grip": 30.0})
    space = replace(study.space, regions=(fixed,))
    given = synthesise(replace(study, space=space), plugins.channels)[0]["p1"]
    assert_same(given, tissue.answer(*ANSWER))


def test_a_fixed_value_is_part_of_the_truth(planned: Planned, tissue: ModuleType, plugins: Plugins) -> None:
    study = planned(truth={"soft_tissue.stiffness": 0.4})
    region = study.space.regions[0]
    fixed = replace(region, searched=region.searched[:1], fixed={"grip": 30.0})
    space = replace(study.space, regions=(fixed,))
    given = synthesise(replace(study, space=space), plugins.channels)[0]["p1"]
    assert_same(given, tissue.answer(0.4, 30.0))


# --------------------------------------------------------------------------- noise


def test_noise_has_the_requested_share_and_depends_on_the_seed(
    planned: Planned, plugins: Plugins, tmp_path: Path
) -> None:
    study = planned()
    exact, _ = synthesise(study, plugins.channels, tmp_path / "exact")
    noisy, _ = synthesise(study, plugins.channels, tmp_path / "a", noise=0.05, seed=3)
    again, _ = synthesise(study, plugins.channels, tmp_path / "b", noise=0.05, seed=3)
    other, _ = synthesise(study, plugins.channels, tmp_path / "c", noise=0.05, seed=4)
    added = {
        (spot, name): (noisy[spot][name].ordinate - exact[spot][name].ordinate)
        / np.abs(exact[spot][name].ordinate).max()
        for spot in exact
        for name in exact[spot]
    }
    assert np.concatenate(list(added.values())).std() == pytest.approx(0.05, rel=0.2)
    assert not np.array_equal(added["p1", "force"], added["p2", "force"])
    assert_same(again["p2"], noisy["p2"])
    assert not np.array_equal(other["p1"]["force"].ordinate, noisy["p1"]["force"].ordinate)
    assert np.array_equal(noisy["p1"]["force"].abscissa, exact["p1"]["force"].abscissa)


@pytest.mark.parametrize("noise", [-0.1, float("nan"), float("inf")])
def test_noise_that_is_no_share_is_refused(planned: Planned, plugins: Plugins, noise: float) -> None:
    with pytest.raises(StudyError, match=r"noise .*such as"):
        synthesise(planned(), plugins.channels, noise=noise)


# ------------------------------------------------------------------------ refusals


def test_an_existing_file_is_not_overwritten(planned: Planned, plugins: Plugins, tmp_path: Path) -> None:
    study = planned()
    folder = tmp_path / "planned"
    for name in ("p2.csv", NOTE):
        folder.mkdir()
        (folder / name).write_text("precious")
        with pytest.raises(StudyError, match=rf"{name}: exists and is not overwritten"):
            synthesise(study, plugins.channels)
        assert [path.name for path in folder.iterdir()] == [name]
        assert (folder / name).read_text() == "precious"
        (folder / name).unlink()
        folder.rmdir()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"truth": {}}, r"study.toml: \[truth\] gives no value for soft_tissue.stiffness, soft_tissue.grip"),
        ({"truth": {"soft_tissue.stiffness": 0.4}}, "no value for soft_tissue.grip; give"),
        ({"data": "measured"}, 'has data = "measured".*copy of the study'),
        ({"truth": {**TRUTH, "soft_tissue.stiffness": -1.0}}, "physical range"),
        ({"solver": "Hopeless"}, r"spot 'p1'.*ended diverged \(step too small\).*narrow"),
    ],
)
def test_what_cannot_be_simulated_is_refused_and_nothing_is_written(
    planned: Planned, plugins: Plugins, tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(PalpateError, match=message):
        synthesise(planned(**changes), plugins.channels)
    assert not (tmp_path / "planned").exists()


def test_a_loader_that_cannot_write_is_reported_before_the_simulation(
    planned: Planned, tissue: ModuleType, plugins: Plugins, tmp_path: Path
) -> None:
    log = tmp_path / "log"
    solver = tissue.Analytic(tissue.AnalyticSettings(log=str(log)))
    with pytest.raises(
        CurveError, match="loader 'table' reads curves and cannot write them; use loader 'csv'"
    ):
        synthesise(planned(loader=tissue.Table(), solver=solver), plugins.channels)
    assert not log.exists()


class Forgetful(Pairs):
    """Reads other numbers than it wrote, of curves in a folder that is named."""

    folder = "planned"

    def save(self, path: Path, response: Response, channel: str | None = None) -> None:
        super().save(path, response, channel)
        if self.folder in ("", path.parent.name):
            path.write_text(path.read_text().replace("-22.5", "-22.4"))


def test_a_file_that_is_not_read_back_is_removed_with_those_before_it(
    planned: Planned, plugins: Plugins, tmp_path: Path
) -> None:
    with pytest.raises(CurveError, match=r"p1.csv: loader 'pairs' does not read its own file"):
        synthesise(planned(loader=Forgetful()), plugins.channels)
    assert list((tmp_path / "planned").iterdir()) == []


class Always(Forgetful):
    """Reads other numbers than it wrote."""

    folder = ""


def csv(**channels: tuple[str, ...]) -> ExperimentLoader:
    """CSV files with these columns of each channel: abscissa, ordinate, and time where there is one."""
    fields = ("abscissa", "ordinate", "time")
    named = {name: dict(zip(fields, columns, strict=False)) for name, columns in channels.items()}
    return CsvLoader(CsvLoader.Settings.model_validate({"channels": named}))


@pytest.mark.parametrize(
    ("loader", "message"),
    [
        (csv(force=("x", "y"), torque=("x", "z")), r"planned/p1.csv: two curves need one column \(x, "),
        (csv(force=("x", "y", "t"), torque=("a", "b")), r"p1.csv: channel 'force' has no time; remove"),
        (csv(force=("x", "y")), r"p1.csv: the curves are force, torque, .* name columns for force"),
        (Always(), r"planned/p1.csv: loader 'pairs' does not read its own file"),
    ],
)
def test_files_that_cannot_be_written_are_refused_before_the_simulation(
    planned: Planned, tissue: ModuleType, plugins: Plugins, tmp_path: Path,
    loader: ExperimentLoader, message: str,
) -> None:  # fmt: skip
    log = tmp_path / "log"
    solver = tissue.Analytic(tissue.AnalyticSettings(log=str(log)))
    with pytest.raises(CurveError, match=message):
        synthesise(planned(loader=loader, solver=solver), plugins.channels)
    assert not log.exists()
    assert not (tmp_path / "planned").exists()


def test_noise_leaves_the_times_of_a_curve(planned: Planned, plugins: Plugins, tmp_path: Path) -> None:
    study = planned(loader=csv(force=("x", "y", "t"), torque=("a", "b", "t")))
    timed = replace(study.protocol, time_s=10.0 * np.arange(len(study.protocol.path)))
    study = replace(study, protocol=timed, solver=HalfSpace(HalfSpace.Settings()))
    responses, _ = synthesise(study, plugins.channels, noise=0.01)
    assert all(curve.time_s is not None for curve in responses["p1"].curves.values())


def test_two_spots_in_one_file_are_refused(planned: Planned, plugins: Plugins, tmp_path: Path) -> None:
    spots = tuple(
        StudySpot(spot=Spot(name=name), measured={None: (tmp_path / "both.csv",)}, mesh=None)
        for name in ("p1", "p2")
    )
    with pytest.raises(StudyError, match=r"both\.csv: is named for two curves"):
        synthesise(planned(spots=spots), plugins.channels)


def test_a_channel_that_the_simulation_does_not_give_is_refused(
    planned: Planned, plugins: Plugins, tmp_path: Path
) -> None:
    spot = StudySpot(spot=Spot(name="p1"), measured={"warmth": (tmp_path / "w.csv",)}, mesh=None)
    with pytest.raises(CurveError, match="gives force, torque and nothing for the file of warmth"):
        synthesise(planned(spots=(spot,)), plugins.channels)


# ------------------------------------------------------------------ homogeneous tests


def test_homogeneous_tests_run_along_the_abscissae_of_the_files(
    make_study: Callable[..., Study], plugins: Plugins, tmp_path: Path
) -> None:
    (tmp_path / "f.csv").write_text("force,0,0\nforce,1,0\nforce,2,0\n")
    spot = StudySpot(spot=Spot(name="p1"), measured={"force": (tmp_path / "f.csv",)}, mesh=None)
    scenario = next(s for s in make_study().scenarios if s.name == "III")
    study = make_study(protocol=None, spots=(spot,), truth=TRUTH, loader=Pairs(), scenarios=(scenario,))
    study.solver.provides = Provides(body="specimen")
    made = synthesise(study, plugins.channels, tmp_path / "out")[0]["p1"]["force"]
    assert made.abscissa.tolist() == [0.0, 1.0, 2.0]
    assert made.ordinate == pytest.approx([0.0, 20.4, 80.8])
    (tmp_path / "f.csv").unlink()
    with pytest.raises(StudyError, match=r"f.csv: no such file, and the study has no \[protocol\]"):
        synthesise(study, plugins.channels, tmp_path / "again")


# ------------------------------------------------------------------------ read_study


def test_a_study_is_read_before_its_curves_exist(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_bytes((TOY / "study.toml").read_bytes())
    toy = Plugins.load([TOY / "toy_plugin.py"], entry_points=False)
    with pytest.raises(StudyError, match=r"'s1.txt': no such file"):
        read_study(tmp_path, toy)
    study = read_study(tmp_path, toy, need_measured=False)
    assert study.spots[1].measured == {"pull": (tmp_path.resolve() / "s2.txt",)}
    (tmp_path / "s1.txt").mkdir()
    with pytest.raises(StudyError, match=r"'s1.txt': is a folder"):
        read_study(tmp_path, toy, need_measured=False)
