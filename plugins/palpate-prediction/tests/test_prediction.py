"""Predictions: what is measured of the skin, how sure it is, and where it extrapolates."""

import re
from dataclasses import replace
from types import MappingProxyType, SimpleNamespace

import meshio
import numpy as np
import polars as pl
import pytest

from palpate.answer.words import Adequacy
from palpate.domain import (
    Job,
    Limb,
    ParameterSpace,
    RegionMaterial,
    Response,
    Simulation,
    Status,
)
from palpate.errors import StudyError
from palpate.fit.least_squares import LeastSquares
from palpate.fit.parametrisation import StandardParametrisation
from palpate.mesh.specimens import block
from palpate.mesh.spot_frame import contact_edge_mm
from palpate.plugins.interfaces import Solver
from palpate.plugins.provides import Provides
from palpate.progress import SILENT
from palpate.run.directory import RunDirectory
from palpate.stages.pipeline import run_study
from palpate.stages.stage import Run, read_run
from palpate.study.tool import read_tool
from palpate_materials.neo_hookean import NeoHookean
from palpate_prediction import predict
from palpate_prediction.bands import exceedances, values_at
from palpate_prediction.files import notes, write_prediction, write_surface
from palpate_prediction.predict import AS_IS, _Plan, run_prediction
from palpate_prediction.summary import (
    area_above,
    contact_of,
    weighted_quantile,
)

from .skins import skin

pytestmark = pytest.mark.usefixtures("one_figure")

TOOL = """
threshold = "50 kPa"

[protocol]
indenter = { shape = "sphere", radius = "20 mm" }
depth = "5 mm"
friction = 0.5
"""
TRUTH = {"soft_tissue.stiffness": 0.4, "soft_tissue.grip": 20.0}


class Pressed(Solver):
    """Force = stiffness · depth^1.5 over the skin of ``skin``; strains as deep as the press."""

    name, summary = "pressed", "with a skin"
    provides = Provides(body="layers", slopes=True, surface=True)
    answer = None  # of the analytic tissue
    fails = staticmethod(lambda job: False)

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        (theta,) = job.thetas.values()
        if self.fails(job):
            return Simulation(job=job, status=Status.DIVERGED, response=None, message="step too small")
        response, surface, found = type(self).answer(*theta[:2]), None, {}
        if job.slopes:
            given = {
                name: response[name].ordinate / value
                for name, value in zip(("force", "torque"), theta, strict=True)
            }
            zero = {name: 0.0 * values for name, values in given.items()}
            curves = {
                "force": {"soft_tissue.stiffness": given["force"], "soft_tissue.grip": zero["force"]},
                "torque": {"soft_tissue.stiffness": zero["torque"], "soft_tissue.grip": given["torque"]},
            }
            response = Response(
                curves={
                    n: replace(c, slopes=curves[n] | {"friction": 0.0 * c.ordinate})
                    for n, c in response.curves.items()
                }
            )
        if job.surface:
            depth = float(job.protocol.path[:, 0].max())
            depths = np.array([0.5, 1.0]) * depth
            size = 0.1 * theta[0] * (1.1 if job.spot.endswith(AS_IS) else 1.0)
            surface = skin(size * np.ones((2, 4)) * np.array([[0.35], [1.0]]), depths)
            strain = {name: [1.0, 1.0] for name in ("stretch_min", "J_min", "J_max")}
            strain |= {
                "stretch_max": [1.0 + 0.05 * d for d in depths],
                "i1_max": [3.0 + 0.1 * d for d in depths],
            }
            found = {"strain": {"soft_tissue": strain | {"where_mm": [[1.0, 2.0, 3.0]] * 2}}}
        return Simulation(job=job, status=Status.OK, response=response, surface=surface, diagnostics=found)


@pytest.fixture
def fitted(make_study, tissue, run_once, monkeypatch):
    monkeypatch.setattr(Pressed, "answer", staticmethod(tissue.answer))
    study = make_study(solver=Pressed(), n_sets=8, search=LeastSquares(), truth=TRUTH)
    return study, RunDirectory(run_once(study))


def tool_file(tmp_path, text=TOOL):
    path = tmp_path / "ball.toml"
    path.write_text(text)
    return path


@pytest.mark.slow
def test_a_tool_is_predicted_with_its_band_and_what_extrapolates(fitted, plugins, tmp_path):
    study, run = fitted
    tool = read_tool(tool_file(tmp_path), study, plugins)
    found = run_prediction(study, run, tool, plugins, SILENT, n_solved=5)
    rows = {(row["spot"], row["quantity"]): row for row in found.summary.to_dicts()}
    peak = rows["p1", "peak pressure"]
    assert (peak["unit"], peak["value"]) == ("kPa", pytest.approx(40.0, rel=1e-4))
    assert peak["linear_lower"] <= peak["value"] <= peak["linear_upper"]
    assert peak["solved_upper"] == pytest.approx(peak["linear_upper"], rel=0.1)
    assert rows["p2", "peak pressure"]["value"] == pytest.approx(50.0, rel=1e-4)
    (i1,) = found.strains.filter(spot="p1", strain="i1_max").to_dicts()
    assert (i1["experiment"], i1["prediction"], i1["beyond"]) == (4.0, 3.5, False)
    files = write_prediction(found, plugins.channels, "", tmp_path / "out")
    assert {path.suffix for path in files} >= {".parquet", ".csv", ".vtu", ".html", ".svg"}
    assert all(path.exists() for path in files)
    assert pl.read_parquet(tmp_path / "out" / "summary.parquet").equals(found.summary)
    page = (tmp_path / "out" / "index.html").read_text()
    assert "largest I₁" in page
    assert "90 % band of simulated draws" in page
    # Names of code are for CSV and JSON.
    assert not re.search("i1_max|stretch_min|linear_lower|linear lower|radius=", page)
    again = run_prediction(study, run, tool, plugins, SILENT, n_solved=5)
    assert again.summary.equals(found.summary)
    assert found.fitted.source == "fit"
    texts = notes(found, "simulated data")
    assert texts[0] == "Simulated data."
    assert any("p2 has the values of the fit of p2 alone" in text for text in texts)
    assert any("describes the curves of the experiment within its error budget" in text for text in texts)
    assert "Solved bands at p2 hold 5 draws, each simulated." in texts
    assert any("at p1: normal force 3 %, peak pressure 3 %" in text for text in texts)
    assert any(text.endswith("no mesh was refined under the tool.") for text in texts)


@pytest.mark.slow
def test_a_refined_mesh_shows_its_error_by_the_mesh_as_it_is(fitted, plugins, tmp_path, monkeypatch):
    study, run = fitted
    coarse, fine = ({spot: block("hex8", n_across=n, n_down=2) for spot in study.spot_names} for n in (6, 12))
    as_is = {f"{spot}{AS_IS}": limb for spot, limb in coarse.items()}
    monkeypatch.setattr(predict, "refined_limbs", lambda study, tool: fine | as_is)
    tool = read_tool(tool_file(tmp_path, 'fine_edge = "3 mm"\n' + TOOL), study, plugins)
    found = run_prediction(study, run, tool, plugins, SILENT, n_solved=5)
    for spot in found.spots.values():
        assert spot.mesh["peak_MPa"] == pytest.approx(0.1 / 3.0, rel=1e-5)
    row = found.summary.filter(spot="p1", quantity="peak pressure").row(0, named=True)
    assert row["linear_upper"] > row["value"] * (1.0 + 0.9 * 1.645 * 0.1 / 3.0)
    assert "peak pressure 3.3 %" in " ".join(notes(found, ""))
    assert not any("[budget]" in text for text in notes(found, ""))
    # Draws are pressed on the mesh as it is, where this tissue is stiffer by a tenth.
    assert row["solved_lower"] <= row["value"] <= row["solved_upper"] < 1.05 * row["value"]
    assert any(
        "5 draws, each simulated on the mesh as it is and changed" in text for text in notes(found, "")
    )
    nearly = {spot: block("hex8", n_across=20, n_down=2) for spot in study.spot_names}
    coarse = {f"{spot}{AS_IS}": block("hex8", n_across=19, n_down=2) for spot in study.spot_names}
    monkeypatch.setattr(predict, "refined_limbs", lambda study, tool: nearly | coarse)
    found = run_prediction(study, run, tool, plugins, SILENT)
    (said,) = [text for text in notes(found, "") if text.startswith("warning: at p2 these errors come from")]
    assert said.endswith("its mesh is hardly refined under the tool; set a shorter fine_edge.")


@pytest.mark.parametrize(("kind", "fine_edge", "finer"), [
    ("tet10", "", True), ("hex8", "", False), ("tet10", 'fine_edge = "0 mm"\n', False),
])  # fmt: skip
def test_meshes_are_refined_under_a_tool_where_nothing_else_is_said(
    make_study, plugins, tmp_path, monkeypatch, kind, fine_edge, finer
):
    study, as_is = make_study(), block(kind, n_across=4, n_down=2)
    monkeypatch.setattr(predict, "load_limbs", lambda study: {"p1": as_is})
    tool = read_tool(tool_file(tmp_path, fine_edge + TOOL), study, plugins)
    limbs = predict.refined_limbs(tool.study(study), tool)
    assert limbs.keys() == ({"p1", f"p1{AS_IS}"} if finer else {"p1"})
    if finer:
        edges_mm = [contact_edge_mm(limb, tool.protocol.reach_mm) for limb in limbs.values()]
        assert edges_mm[0] < tool.protocol.reach_mm / 3.0 < edges_mm[1]


@pytest.mark.slow
def test_bands_of_a_law_that_approximates_hold_the_true_curves(
    make_study, tissue, plugins, tmp_path, monkeypatch
):
    """Force over depth has another power than the law has."""
    true = {spot: tissue.answer(k, 20.0) for spot, k in (("p1", 0.4), ("p2", 0.41))}
    for spot, response in true.items():
        force = response["force"]
        force = replace(force, ordinate=force.ordinate * (force.abscissa / 5.0) ** 0.25)
        true[spot] = Response(curves={**response.curves, "force": force})
        rows = [f"{n},{x!r},{y!r}\n" for n, c in true[spot].curves.items()
                for x, y in zip(c.abscissa.tolist(), c.ordinate.tolist(), strict=True)]  # fmt: skip
        (tmp_path / f"{spot}.csv").write_text("".join(rows))
    monkeypatch.setattr(Pressed, "answer", staticmethod(tissue.answer))
    study = make_study(solver=Pressed(), n_sets=0, search=LeastSquares())
    study = replace(study, scenarios=study.scenarios[:1])
    run_study(study, tmp_path / "run", plugins)
    tool = read_tool(tool_file(tmp_path), study, plugins)

    def inside():
        found = run_prediction(study, RunDirectory(tmp_path / "run"), tool, plugins, SILENT)
        assert found.verdict is Adequacy.APPROXIMATES
        rows = found.curves.filter(channel="force").sort("spot", "point")
        ordinates = np.concatenate([response["force"].ordinate for response in true.values()])
        held = (rows["lower"].to_numpy() <= ordinates) & (ordinates <= rows["upper"].to_numpy())
        return held[ordinates > 0.05 * ordinates.max()].mean(), notes(found, "")

    share, texts = inside()
    assert any(
        re.match(r"Model error \(standard deviation over the peak\): force [\d.]+ %", t) for t in texts
    )
    monkeypatch.setattr(predict, "with_model_error", lambda lines, *_: lines)
    alone, _ = inside()
    assert alone < 0.85 < 0.9 <= share


@pytest.mark.slow
def test_draws_that_fail_are_counted_and_reported(fitted, plugins, tmp_path, monkeypatch):
    study, run = fitted
    tool = read_tool(tool_file(tmp_path), study, plugins)
    known = read_run(study, run, plugins)
    best = values_at("p1", known.fitted(), known.current).values["soft_tissue.stiffness"]

    def soft(job):
        is_draw = job.surface and not job.slopes and job.protocol.path[:, 0].max() == 5.0
        return is_draw and job.thetas["soft_tissue"][0] < best

    monkeypatch.setattr(Pressed, "fails", staticmethod(soft))
    found = run_prediction(study, run, tool, plugins, SILENT, n_solved=6)
    n_ended = found.spots["p1"].n_ended
    assert 0 < n_ended < found.spots["p1"].n_asked == 6
    assert (
        f"Solved bands at p1 hold {n_ended} draws, each simulated; {6 - n_ended} of 6 failed and are "
        "not in them." in notes(found, "")
    )


@pytest.mark.slow
def test_a_spot_that_the_joint_fit_leaves_out_has_the_shared_values_alone(
    fitted, plugins, tmp_path, monkeypatch
):
    study, run = fitted
    tool = read_tool(
        tool_file(tmp_path, TOOL.replace("threshold", 'spots = ["p2"]\nthreshold')), study, plugins
    )
    whole = read_run(study, run, plugins).fitted()
    alone = replace(whole, spots=("p1",))
    monkeypatch.setattr(Run, "fitted", lambda self: alone)
    found = run_prediction(study, run, tool, plugins, SILENT)
    assert found.summary["value"][0] > 0.0
    alone = replace(alone, values={f"{name}@p1": value for name, value in whole.values.items()})
    with pytest.raises(
        StudyError, match=r"spot 'p2': .*grip was fitted for each spot by itself, and not for"
    ):
        run_prediction(study, run, tool, plugins, SILENT)


class AllRelax(StandardParametrisation):
    """All moduli relax, by shares that a fit has searched."""

    name, summary = "all_relax", "all moduli relax"
    relaxing = frozenset({"force"})
    times_s = MappingProxyType({"relaxed.1s": 1.0, "relaxed.10s": 10.0})


def held_for(tool, rest_s):
    """The tool pressed in a second, then held."""
    held = tool.protocol
    path = np.vstack([held.path[:2], held.path[1]])
    return replace(tool, protocol=replace(held, path=path, time_s=np.array([0.0, 1.0, 1.0 + rest_s])))


@pytest.mark.slow
def test_what_a_fit_has_found_to_relax_is_pressed_by_a_solver_that_relaxes_it(
    fitted, plugins, tmp_path, monkeypatch
):
    study, run = fitted
    tool = held_for(read_tool(tool_file(tmp_path), study, plugins), 30.0)
    whole, jobs = read_run(study, run, plugins).fitted(), []
    shares = {"relaxed.1s": 0.2, "relaxed.10s": 0.1}
    found = replace(whole, values=dict(whole.values) | shares)
    monkeypatch.setattr(Run, "fitted", lambda self: found)
    current = Run.current

    def of_equal_spots(run, name):
        table = current(run, name)
        return table.clear() if name == "spot_draws" else table

    monkeypatch.setattr(Run, "current", of_equal_spots)
    monkeypatch.setattr(StandardParametrisation, "times_s", AllRelax.times_s)
    with pytest.raises(StudyError, match="solver 'pressed' does not provide materials that relax"):
        run_prediction(study, run, tool, plugins, SILENT)
    monkeypatch.setattr(Pressed, "provides", replace(Pressed.provides, relaxation=True, slopes=False))
    monkeypatch.setattr(Pressed, "fails", staticmethod(lambda job: jobs.append(job)))
    made = run_prediction(study, run, tool, plugins, SILENT, n_solved=2)
    pressed = [job for job in jobs if job.surface and job.protocol.time_s is not None]
    assert len(pressed) == 3  # without meshes both spots have the same jobs
    for job in pressed:
        assert job.materials["soft_tissue"].relaxation_times_s == (1.0, 10.0)
        assert job.thetas["soft_tissue"][-2:].tolist() == [0.2, 0.1]
        assert job.protocol.time_s[-1] == 31.0
    assert not any(
        "relaxes" in text for text in notes(made, "")
    )  # nothing is known of the experiment's times
    said = notes(replace(made, record_s=40.0), "")
    assert "The tissue relaxes in the 31 s of the tool's motion." in said
    said = notes(replace(made, record_s=6.0), "")
    assert (
        "warning: The tissue relaxes in the 31 s of the tool's motion. The experiment tells 6 s of it: later "
        "forces are an extrapolation." in said
    )


def test_a_tool_without_times_is_refused_where_the_tissue_relaxes(make_study, plugins, tmp_path):
    study = make_study(parametrisation=AllRelax())
    with pytest.raises(
        StudyError, match=r"ball\.toml:\d+: protocol\.motion: the tissue relaxes, which needs the"
    ):
        read_tool(tool_file(tmp_path), study, plugins)


@pytest.mark.slow
def test_a_band_by_slopes_needs_a_solver_that_gives_them(fitted, plugins, tmp_path):
    study, run = fitted
    tool = read_tool(tool_file(tmp_path), study, plugins)
    plain = Pressed()
    plain.provides = replace(Pressed.provides, slopes=False)
    study = replace(study, solver=plain)
    with pytest.raises(StudyError, match=r"'pressed' gives no slopes, so that .* add --draws 20"):
        run_prediction(study, run, tool, plugins, SILENT)
    found = run_prediction(study, run, tool, plugins, SILENT, n_solved=3)
    assert found.summary["linear_lower"].null_count() == found.summary.height
    assert not any("Linear bands" in text or "no intervals" in text for text in notes(found, ""))


def test_a_prediction_beyond_the_experiment_says_where_and_from_which_depth():
    def strain(i1):
        return {"r": {"stretch_min": [0.9, 0.8], "stretch_max": [1.1, 1.2], "i1_max": i1, "J_min": [1, 1],
                      "J_max": [1, 1], "where_mm": [[0, 0, 0], [1.0, 2.0, 3.0]]}}  # fmt: skip

    simulation = Simulation(
        job=None, status=Status.OK, response=None, diagnostics={"strain": strain([3.1, 3.9])},
        surface=skin(np.ones((2, 4)), depths=(1.0, 2.0)),
    )  # fmt: skip
    table = exceedances({"p1": strain([3.1, 3.4]), "p2": strain([3.0, 3.6])}, {"q": simulation})
    assert table.filter(pl.col("beyond"))["strain"].to_list() == ["i1_max"]
    row = table.row(2, named=True)
    assert (row["experiment"], row["prediction"]) == (3.6, 3.9)
    assert (row["from_depth_mm"], row["where_mm"]) == (2.0, "1.0, 2.0, 3.0")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('"50 kPa"', "50"), r"ball\.toml:2: threshold: .*has no unit"),
        (('"50 kPa"', '"50 mm"'), r"ball\.toml:2: threshold"),
        (('"sphere"', '"spoon"'), r"no indenter 'spoon'"),
        (("threshold", 'spots = ["p9"]\nthreshold'), r"the run has no spot 'p9' \(it has p1, p2\)"),
        (("threshold", "thresholt"), r"unknown key.*threshold"),
        (("friction = 0.5", ""), r"friction: missing"),
        (("friction = 0.5", "friction = 0.5\n" + 2 * '[[spot]]\nname = "p1"\n'), r"'p1' is listed twice"),
    ],
)
def test_a_tool_file_that_is_wrong_is_refused_with_line_and_key(
    make_study, plugins, tmp_path, change, message
):
    with pytest.raises(StudyError, match=message):
        read_tool(tool_file(tmp_path, TOOL.replace(*change)), make_study(), plugins)


def test_a_motion_that_the_solver_of_the_run_lacks_is_refused(make_study, plugins, tmp_path):
    class Turning(Pressed):
        provides = replace(Pressed.provides, motions=("rotation",))

    with pytest.raises(
        StudyError, match=r"protocol\.motion: solver 'pressed' simulates no motion with depth"
    ):
        read_tool(tool_file(tmp_path), make_study(solver=Turning()), plugins)


def test_area_pressure_and_quantiles_of_a_contact():
    contact = contact_of(skin([[0.0, 0.1, 0.2, 0.1]]), threshold_MPa=0.1)
    assert contact.area_mm2[0] == pytest.approx(4.0, rel=1e-6)
    assert contact.peak_MPa[0] == pytest.approx(0.2)
    assert contact.mean_MPa[0] == pytest.approx(0.1)
    assert contact.shear_peak_MPa[0] == pytest.approx(0.06)
    assert contact.above_mm2[0] == pytest.approx(2.0, rel=1e-5)  # the half beyond the diagonal
    for threshold, wanted in (
        (0.05, 4.0 * (1 - 0.5 * 0.25)),
        (0.15, 4.0 * 0.5 * 0.25),
        (0.3, 0.0),
        (1e-9, 4.0),
    ):
        found = area_above(skin([[0.0, 0.1, 0.2, 0.1]]), threshold)[0]
        assert found == pytest.approx(wanted, rel=1e-4, abs=1e-9)


def test_a_node_that_is_touched_in_part_counts_with_its_part():
    touching = np.array([[1.0, 0.5, 0.0, 0.5]])
    contact = contact_of(skin([[0.1, 0.05, 0.0, 0.05]], touching=touching), threshold_MPa=1e-9)
    assert contact.area_mm2[0] == pytest.approx(2.0, rel=1e-6)
    assert contact.mean_MPa[0] == pytest.approx((0.1 * 4 / 3 + 0.05 * 4 / 3) / 2.0, rel=1e-6)
    assert contact.above_mm2[0] <= contact.area_mm2[0] * (1.0 + 1e-6)


def test_a_quantile_counts_areas():
    values, weights = np.arange(1000.0), np.ones(1000)
    assert weighted_quantile(values, weights, 0.95) == pytest.approx(949.5, abs=0.6)
    weights[:500] = 0.0
    assert weighted_quantile(values, weights, 0.5) == pytest.approx(749.5, abs=0.6)
    assert weighted_quantile(values, np.zeros(1000), 0.95) == 0.0


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.5, 0.95, 1.0])
def test_a_quantile_of_equal_areas_is_hazens(share):
    values = np.array([7.0, 1.0, 4.0, 2.0])
    expected = np.quantile(values, share, method="hazen")
    assert weighted_quantile(values, np.full(4, 0.3), share) == pytest.approx(expected)


def test_the_skin_is_a_file_that_others_read(tmp_path):
    write_surface(tmp_path / "skin.vtu", skin([[0.0, 0.1, 0.2, 0.1]]), 0)
    read = meshio.read(tmp_path / "skin.vtu")
    np.testing.assert_allclose(read.point_data["contact_pressure_MPa"], [0, 0.1, 0.2, 0.1], rtol=1e-6)
    np.testing.assert_array_equal(read.cells_dict["triangle"], [[0, 1, 2], [0, 2, 3]])


def test_a_tool_file_may_refine_the_mesh_and_move_a_spot(make_study, plugins, tmp_path):
    (tmp_path / "other.vtu").touch()
    more = 'fine_edge = "3 mm"\nfine_reach = "20 mm"\n'
    place = '\n[[spot]]\nname = "wrist"\nmesh = "other.vtu"\nposition = ["1 cm", "0 mm", "0 mm"]\n'
    tool = read_tool(tool_file(tmp_path, more + TOOL + place), make_study(), plugins)
    assert (tool.fine_edge_mm, tool.fine_reach_mm, tool.threshold_MPa) == (3.0, 20.0, pytest.approx(0.05))
    assert (tool.refined_mm, tool.contact_mm(5.0)) == (20.0, 10.0)
    assert replace(tool, fine_reach_mm=0.0).refined_mm == pytest.approx(11.0), "1.1 √(R d)"
    assert replace(tool, fine_reach_mm=4.0).contact_mm(5.0) == 4.0
    (spot,) = tool.spots
    assert (spot.spot.name, spot.mesh) == ("wrist", tmp_path / "other.vtu")
    assert spot.spot.position_mm.tolist() == [10.0, 0.0, 0.0]
    missing = place.replace("other.vtu", "gone.vtu")
    with pytest.raises(StudyError, match=r"spot 'wrist', mesh: no such file: .*gone\.vtu"):
        read_tool(tool_file(tmp_path, TOOL + missing), make_study(), plugins)


def test_a_spot_that_the_fit_leaves_out_has_the_values_of_its_state():
    material = NeoHookean()
    region = RegionMaterial(region="muscle", material=material, searched=material.parameters[:1],
                            fixed={material.parameters[1].name: 0.45})  # fmt: skip
    space = ParameterSpace(regions=(region,), states={"p1": "rest", "p2": "tense", "p3": "tense"})
    (name,) = space.names
    stored = SimpleNamespace(study=SimpleNamespace(space=space, parametrisation=StandardParametrisation()))
    found = SimpleNamespace(spots=("p1", "p2"))
    plan = _Plan(
        stored=stored, pressed=None, tool=None, found=found, spot="p3", channels=(), model_errors=None
    )
    thetas = plan.thetas({f"{name}@rest": 0.01, f"{name}@tense": 0.03})
    assert thetas["muscle"][0] == pytest.approx(space.thetas(np.array([0.03]))["muscle"][0])
    with pytest.raises(StudyError, match=r"first state's times stiffness.muscle@tense"):
        plan.thetas({name: 0.01, "stiffness.muscle@tense": 3.0})
