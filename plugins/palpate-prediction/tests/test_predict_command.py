"""``palpate predict`` to its end, with a half-space whose skin is a square under the sphere."""

import json

import jsonschema
import pytest

import palpate_certainty
from palpate.plugins.registry import load_file
from palpate.stages import pipeline
from palpate.testing.studies import StudyRunner

PLUGIN = '''
from dataclasses import replace

import numpy as np

from palpate import Response, Status, hookimpl
from palpate.api import SurfaceStates
from palpate.testing.bench import HalfSpace

SQUARE = np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)])


class Skinned(HalfSpace):
    name, summary = "skinned", "a half-space with a skin"
    provides = replace(HalfSpace.provides, slopes=True, surface=True, motions=("depth", "rotation", "load"))

    def simulate(self, job, limb):
        found = super().simulate(job, limb)
        ((region, theta),) = job.thetas.items()
        curves = {
            name: replace(c, slopes={f"{region}.e": c.ordinate / theta[0], "friction": 0.0 * c.ordinate})
            for name, c in found.response.curves.items()
        }
        surface = skin(curves) if job.surface else None
        found = replace(found, response=Response(curves=curves), surface=surface)
        loads, force = job.protocol.loads, curves["force"].ordinate.max()
        if loads is not None and (most := np.nanmax(loads[:, 0])) > force:
            why = f"force of {most:g} N is not reached: the largest is {force:.4g} N"
            return replace(found, status=Status.DIVERGED, message=why)
        return found


def skin(curves):
    """The square of 4 mm² under an even pressure that carries the force."""
    depth, force = curves["force"].abscissa, curves["force"].ordinate
    k, down = len(depth), np.array([0.0, 0.0, -1.0])
    pressures = np.repeat(force[:, None] / 4.0, 4, axis=1)
    return SurfaceStates(
        points_mm=SQUARE, triangles=[(0, 1, 2), (0, 2, 3)], depth_mm=depth, rotation_deg=np.zeros(k),
        positions_mm=np.outer(depth, down), rotations=np.tile(np.eye(3), (k, 1, 1)),
        displacements_mm=np.repeat(np.outer(depth, down)[:, None], 4, axis=1), areas_mm2=np.ones((k, 4)),
        touching=np.ones((k, 4)), pressures_MPa=pressures, shears_MPa=np.zeros((k, 4, 3)),
        tractions_MPa=pressures[..., None] * down,
    )


@hookimpl
def palpate_solvers():
    return [Skinned]

'''

TOOL = """
threshold = "50 kPa"

[protocol]
indenter = { shape = "sphere", radius = "15 mm" }
friction = 0.5
depth = "3 mm"
"""
MOVES = 'motion = "moves"\ndepth_limit = "3 mm"\nmoves = [{ force = "FORCE" }]'
FORCED = TOOL.replace('depth = "3 mm"', MOVES)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Run a study once, for every tool."""
    folder = tmp_path_factory.mktemp("predict")
    (folder / "skinned.py").write_text(PLUGIN)
    runner, module = StudyRunner(folder), load_file(folder / "skinned.py")
    study, plugins = runner.study(
        module, palpate_certainty, solver={"name": "skinned"}, sampling={"n_sets": 0}
    )
    pipeline.run_study(study, folder / "run", plugins)
    return runner, module


@pytest.fixture
def predict(made, capsys):
    """Predict a tool from the command line: code, printed JSON and messages."""
    runner, module = made

    def call(tool, *more):
        (runner.folder / "tool.toml").write_text(tool)
        words = ("predict", runner.folder / "run", "--tool", runner.folder / "tool.toml", "--trust-plugins")
        code = runner.command(module, *words, "--json", *more)
        shown = capsys.readouterr()
        return code, json.loads(shown.out) if code == 0 else {}, shown.err

    return call


@pytest.mark.slow
def test_a_tool_is_predicted_from_the_command_line(predict, made):
    code, found, _ = predict(TOOL, "--draws", "2")
    assert code == 0
    rows = {row["quantity"]: row for row in found["summary"]}
    force, peak = rows["normal force"], rows["peak pressure"]
    assert peak["unit"] == "kPa"  # as the threshold is written
    assert peak["value"] == pytest.approx(1000.0 * force["value"] / 4.0, rel=1e-5)
    assert force["linear_lower"] <= force["value"] <= force["linear_upper"]
    assert force["linear_lower"] <= force["solved_lower"] < force["solved_upper"] <= force["linear_upper"]
    assert rows["area above the threshold"]["value"] == pytest.approx(4.0)
    assert {file.rsplit(".")[-1] for file in found["files"]} >= {"csv", "parquet", "vtu", "svg", "html"}
    assert (made[0].folder / "run" / "predictions" / "tool" / "index.html").is_file()
    assert not any(text.startswith("Not pressed to the end") for text in found["notes"])


@pytest.mark.slow
def test_what_it_prints_is_as_the_schema_says(predict, call):
    _, found, _ = predict(TOOL)
    jsonschema.validate(found, call("schema", "predict").json)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**found, "more": 1}, call("schema", "predict").json)


def test_a_threshold_without_its_unit_is_refused(predict):
    code, _, messages = predict(TOOL.replace('"50 kPa"', '"50"'))
    assert code == 2
    assert "tool.toml:2: threshold: " in messages
    assert 'write "50 MPa"' in messages


@pytest.mark.slow
def test_a_force_that_is_not_reached_is_reported_and_has_a_band(predict):
    code, found, _ = predict(FORCED.replace("FORCE", "1 kN"))
    assert code == 0
    (text,) = [text for text in found["notes"] if text.startswith("Not pressed to the end")]
    rows = {row["quantity"]: row for row in found["summary"]}
    force = rows["normal force"]
    largest = force["value"]
    assert text == (
        f"Not pressed to the end: p1 (force of 1000 N is not reached: the largest is {largest:.4g} N)."
    )
    assert "depth" not in rows, "that of the limit"
    assert force["linear_upper"] - force["linear_lower"] > 0.02 * largest
    assert not any(text.startswith("By force") for text in found["notes"])
    code, found, _ = predict(FORCED.replace("FORCE", f"{0.999 * largest} N"))
    assert code == 0
    assert not any(text.startswith("Not pressed to the end") for text in found["notes"])
    rows = {row["quantity"]: row for row in found["summary"]}
    assert rows["normal force"]["linear_upper"] == pytest.approx(rows["normal force"]["linear_lower"])
    assert rows["depth"]["linear_lower"] < rows["depth"]["linear_upper"]
    (errors,) = [text for text in found["notes"] if text.startswith("Mesh error")]
    assert "depth 3 %" in errors
    assert "normal force" not in errors


def test_a_force_on_the_way_to_a_depth_leaves_the_largest_force_unknown(predict):
    moves = '[{ force = "1 N" }, { depth = "3 mm" }]'
    code, found, _ = predict(FORCED.replace('[{ force = "FORCE" }]', moves))
    assert code == 0
    rows = {row["quantity"]: row for row in found["summary"]}
    force = rows["normal force"]
    assert force["value"] > 2.0
    assert "depth" not in rows
    assert force["linear_upper"] - force["linear_lower"] > 0.02 * force["value"]
