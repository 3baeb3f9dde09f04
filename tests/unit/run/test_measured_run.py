"""What a run directory keeps of the measured curves: how they came about, and pictures of it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import Curve, Indentation, PointWeighting, Relaxation, Response
from palpate.domain.indenter import Sphere
from palpate.errors import CurveError, PluginError, StudyError
from palpate.fit.least_squares import LeastSquares
from palpate.plugins.score import Nmse, NmseSettings, ScoringRules
from palpate.run.atomic_files import write_atomically
from palpate.run.directory import RunDirectory
from palpate.run.keys import job_key
from palpate.run.ownership import claim, keep_only
from palpate.simulation.jobs import jobs
from palpate.stages import pipeline
from palpate.stages.stage import stages_of
from palpate_report.figures.drawings import draw_presses

SMALL = Indentation(
    indenter=Sphere(radius_mm=5.0), path=[(0, 0), (10, 0), (10, -22.5), (10, 22.5), (10, 0)], friction=0.5
)


def pressed_thrice(study):
    """Make a study whose first spot has two more presses, 5 % softer and stiffer, in another folder."""
    spot = study.spots[0]
    (path,) = spot.measured[None]
    rows = [row.split(",") for row in path.read_text().splitlines()]
    files = [path]
    for k, factor in enumerate((0.95, 1.05)):
        copy = path.parent / f"again{k}" / path.name
        copy.parent.mkdir()
        copy.write_text("".join(f"{c},{x},{float(y) * factor!r}\n" for c, x, y in rows))
        files.append(copy)
    return replace(study, spots=(replace(spot, measured={None: tuple(files)}), *study.spots[1:]))


@pytest.fixture
def telling(tissue):
    """Make a loader that records its processing, and draws one picture of it."""

    class Telling(tissue.Table):
        def load(self, path, channel=None):
            response = super().load(path, channel)
            return Response(curves=response.curves, record={"bias_N": np.float64(0.25), "steps": ("tare",)})

        def draw(self, path, folder, channel=None):
            (folder / "raw.svg").write_text(path.name)
            return (folder / "raw.svg",)

    return Telling


def manifest(folder):
    return json.loads((folder / "manifest.json").read_text())


def test_the_manifest_records_how_each_file_became_a_curve(make_study, plugins, tmp_path, telling):
    study, out = pressed_thrice(make_study(loader=telling())), tmp_path / "run"
    pipeline.measure(study, out, plugins)
    reported = manifest(out)["measured"]
    assert reported["p1"]["files"]["again1/p1.csv"] == {"bias_N": 0.25, "steps": ["tare"]}
    assert list(reported["p1"]["files"]) == ["p1.csv", "again0/p1.csv", "again1/p1.csv"]
    assert reported["p1"]["averages"]["torque"]["n_presses"] == 3
    assert "averages" not in reported["p2"]
    assert manifest(out)["spots"]["p1"] == {"measured": {"": ["p1.csv", "again0/p1.csv", "again1/p1.csv"]}}
    assert "again0/p1.csv" in manifest(out)["inputs"]


def test_later_stages_keep_what_the_first_has_reported(make_study, plugins, tmp_path, telling):
    study, out = pressed_thrice(make_study(loader=telling())), tmp_path / "run"
    measured = pipeline.measure(study, out, plugins)
    reported = manifest(out)["measured"]
    pipeline.run_stage("sample", study, out, plugins)
    assert manifest(out)["measured"] == reported
    found = RunDirectory(out).measured(("p1",))["p1"]
    np.testing.assert_array_equal(found["force"].std, measured["p1"]["force"].std)
    assert found.record == reported["p1"]


def test_what_relaxed_in_any_press_is_kept_with_the_mean(make_study, plugins, tmp_path, telling):
    fell = Relaxation(
        channel="force", phase="dwell_1", duration_s=1.0, start_value=8.0, fall=0.5, fall_std=0.1
    )

    class Relaxing(telling):
        def load(self, path, channel=None):
            return replace(super().load(path, channel), relaxations=[fell])

    study, out = pressed_thrice(make_study(loader=Relaxing())), tmp_path / "run"
    measured = pipeline.measure(study, out, plugins)
    assert measured["p1"].relaxations == (fell, fell, fell)
    assert RunDirectory(out).measured(("p1",))["p1"].relaxations == measured["p1"].relaxations
    (first, *_) = manifest(out)["measured"]["p1"]["relaxations"]
    assert first["phase"] == "dwell_1"
    assert first["time_constant_s"] is None
    assert "relaxations" not in RunDirectory(out).measured(("p1",))["p1"].record


def test_a_check_of_the_study_warns_of_a_tissue_that_relaxed(make_study, plugins, telling):
    class Relaxing(telling):
        def load(self, path, channel=None):
            response = super().load(path, channel)
            peak = float(response["force"].ordinate.max())
            rest = Relaxation(
                channel="force",
                phase="dwell",
                duration_s=2.0,
                start_value=peak,
                fall=0.3 * peak,
                fall_std=0.0,
            )
            return replace(response, relaxations=[rest])

    found = pipeline.check_study(make_study(loader=Relaxing()), plugins).warnings
    assert sum("relaxed by 30 % in 2 s; these are apparent moduli of this rate. The" in w for w in found) == 1
    assert not any("relaxed" in w for w in pipeline.check_study(make_study(), plugins).warnings)


@pytest.mark.slow
def test_pictures_of_every_file_and_of_the_mean(make_study, plugins, tmp_path, telling):
    study, out = pressed_thrice(make_study(loader=telling())), tmp_path / "run"
    plots = out / "measured" / "plots"
    claim(out)
    stale = plots / "p1" / "of an earlier run" / "log.svg"
    write_atomically(stale, b"")
    keep_only(plots / "p1", [stale])
    pipeline.measure(study, out, plugins, plots=True)
    found = sorted(str(file.relative_to(plots)) for file in plots.rglob("*.*g"))
    assert found == [
        "p1/curves.png", "p1/curves.svg", "p1/p1/raw.svg", "p1/p1~2/raw.svg", "p1/p1~3/raw.svg",
        "p2/curves.png", "p2/curves.svg", "p2/p2/raw.svg",
    ]  # fmt: skip
    assert not (plots / "p1" / "of an earlier run").exists()
    text = (plots / "p1" / "curves.svg").read_text()
    assert "mean of 3 presses" in text
    assert "± one standard deviation" in text
    assert "simulated data, not a measurement" in text
    assert "one standard deviation" not in (plots / "p2" / "curves.svg").read_text()


@pytest.mark.parametrize("name", ["draw_presses", "draw_experiment"])
def test_a_stage_draws_with_one_method_alone(make_study, plugins, tmp_path, monkeypatch, name):
    drawn = []
    drawer = type("Drawer", (), {name: lambda _, *given: drawn.append(given[0])})()
    monkeypatch.setattr(pipeline, "stages_of", lambda *given: {**stages_of(*given), "drawer": drawer})
    study = make_study()
    pipeline.measure(study, tmp_path / "run", plugins, plots=True)
    assert drawn == (["p1", "p2"] if name == "draw_presses" else [study.name])


def test_a_file_that_is_refused_leaves_the_pictures_that_show_why(make_study, plugins, tmp_path, telling):
    class Refusing(telling):
        def draw(self, path, folder, channel=None):
            super().draw(path, folder, channel)
            raise CurveError(f"{path}: no contact")

    out = tmp_path / "run"
    with pytest.raises(CurveError, match=r"p1\.csv: no contact"):
        pipeline.measure(make_study(loader=Refusing()), out, plugins, plots=True)
    assert (out / "measured" / "plots" / "p1" / "p1" / "raw.svg").exists()
    assert not (out / "manifest.json").exists()


def test_a_loader_draws_only_in_its_folder(make_study, plugins, tmp_path, telling):
    class Stray(telling):
        def draw(self, path, folder, channel=None):
            return (folder.parent / "raw.svg",)

    with pytest.raises(PluginError, match=r"drawing .*p1\.csv: .*raw\.svg outside the folder"):
        pipeline.measure(make_study(loader=Stray()), tmp_path / "run", plugins, plots=True)


def test_plots_need_a_folder(make_study, plugins, tmp_path):
    (tmp_path / "run").write_text("a file")
    with pytest.raises(StudyError, match="name another folder"):
        pipeline.measure(make_study(), tmp_path / "run", plugins, plots=True)


@pytest.mark.slow
@pytest.mark.usefixtures("one_figure")
def test_one_study_of_two_indenters_and_three_presses_runs_to_its_end(make_study, plugins, tmp_path):
    study = pressed_thrice(make_study(search=LeastSquares()))
    one, two = study.spots
    study = replace(study, spots=(one, replace(two, protocol=SMALL)))
    result = pipeline.run_study(study, tmp_path / "run", plugins)
    assert {s.status.value for s in result.simulations} == {"ok"}
    radii = {s.job.spot: s.job.protocol.indenter.radius_mm for s in result.simulations}
    assert radii == {"p1": 7.5, "p2": 5.0}
    reported = manifest(tmp_path / "run")
    assert reported["protocol"]["indenter"] == {"name": "sphere", "settings": {"radius": 7.5}}
    assert reported["spots"]["p2"]["protocol"]["indenter"]["settings"] == {"radius": 5.0}
    assert "protocol" not in reported["spots"]["p1"]
    # The mean of 0.95, 1 and 1.05 times the answer is the answer.
    found = result.fit.of_spots()["p1", "I"]
    assert found["soft_tissue.stiffness"] == pytest.approx(0.4, rel=1e-4)


def test_another_indenter_is_another_simulation(make_study):
    study = make_study()
    one, two = study.spots
    small = replace(study, spots=(one, replace(two, protocol=SMALL)))
    from palpate.sampling.drawing import draw_design

    design = draw_design(study.space, study.sampler, study.n_sets, study.seed)
    usual, other = (
        {j.spot: job_key(j, None, s.solver) for j in jobs(s, design, {}) if j.set_id == 0}
        for s in (study, small)
    )
    assert usual["p1"] == usual["p2"] == other["p1"] != other["p2"]


def test_a_study_that_weighs_by_std_needs_it_everywhere(make_study, plugins):
    study = pressed_thrice(
        make_study(scoring=ScoringRules(score=Nmse(NmseSettings(point_weighting=PointWeighting.STD))))
    )
    with pytest.raises(Exception, match="spot 'p2', channel 'force': no point has a standard deviation"):
        pipeline.check_study(study, plugins)
    assert (
        pipeline.check_study(replace(study, spots=study.spots[:1]), plugins).measured["p1"]["force"].std.all()
    )


def test_a_single_channel_can_be_drawn(plugins, tmp_path):
    curve = Curve(channel="force", abscissa=[0.0, 1.0], ordinate=[0.0, 1.0], std=[0.1, 0.1])
    response = Response(curves={"force": curve})
    files = draw_presses("p1", {"f.csv": response}, response, plugins.channels, "", tmp_path)
    assert [file.name for file in files] == ["curves.svg", "curves.pdf", "curves.png"]
    assert "± one standard deviation" in files[0].read_text()
