"""From logs to curves in one study: its keys, its repeats, its pictures, and what inspection proposes."""

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from palpate.cli.app import main
from palpate.domain import Response
from palpate.errors import CurveError
from palpate.experiment.measured import load_measured, measured_warnings
from palpate.limb.loading import load_limbs
from palpate.plugins.catalogue import Plugins
from palpate.study.reading import Study, read_study
from palpate_robot_log.processing.settings import Gravity

DATA = Path(__file__).parent / "data" / "robot_logs"
SPOTS = ("p1", "p2", "p3", "p4")


@cache
def plugins() -> Plugins:
    return Plugins.load()


def folder() -> Path:
    return Path(plugins().studies["robot-log"].directory)


@cache
def study() -> Study:
    return read_study(folder(), plugins())


@cache
def measured() -> dict[str, Response]:
    return load_measured(study(), plugins().channels)


def nmse(found, true):
    return np.mean((found - true) ** 2) / np.mean(np.abs(true)) ** 2


@pytest.mark.parametrize("spot", SPOTS)
def test_the_curves_are_those_that_made_the_logs(spot):
    clean = np.genfromtxt(DATA / f"clean_{spot}.csv", delimiter=",", names=True)
    twist = int(np.flatnonzero(clean["angle_deg"])[0]) - 1
    force = measured()[spot]["force"]
    depth = clean["depth_mm"][: twist + 1]
    found = np.interp(depth, force.abscissa, force.ordinate)
    # 1e-5 to 4e-4 measured.
    assert nmse(found, clean["force_N"][: twist + 1]) < 1e-3
    torque, angle = measured()[spot]["torque"], clean["angle_deg"][twist:]
    turns = [0, int(angle.argmin()), int(angle.argmax()), angle.size - 1]
    for (start, stop), low, high in zip(torque.branches, turns[:-1], turns[1:], strict=True):
        up = np.argsort(torque.abscissa[start:stop])
        rows = slice(low, high + 1)
        x, y = torque.abscissa[start:stop][up], torque.ordinate[start:stop][up]
        difference = np.interp(angle[rows], x, y) - clean["torque_Nmm"][twist:][rows]
        assert np.abs(difference).max() < 0.02 * np.abs(clean["torque_Nmm"]).max()


def test_every_point_has_a_std_and_every_step_a_record():
    for response in measured().values():
        for curve in response.curves.values():
            assert curve.std is not None
            assert 0.0 < curve.std.min() <= curve.std.max() < 0.02 * np.abs(curve.ordinate).max()
    (record,) = measured()["p1"].record["files"].values()
    steps = {step["step"]: step["found"] for step in record["steps"]}
    assert steps["gravity"]["weight_N"] == pytest.approx(0.88)
    assert list(measured()["p1"].record["files"]) == ["logs/simulated_p1.parquet"]


@pytest.mark.slow
def test_a_weight_that_is_left_in_is_a_warning():
    one = replace(study(), spots=study().spots[3:])
    off = type(one.loader)(one.loader.settings.model_copy(update={"gravity": Gravity()}))
    (warning,) = measured_warnings(load_measured(replace(one, loader=off), plugins().channels))
    assert "the force in free air is 1.6 N (13% of the peak) and the tool tilts by 11 degrees" in warning
    assert warning.endswith("up to 0.29 N of it stay in the curves; give gravity.method")
    assert measured_warnings(measured()) == ()


def test_a_twist_of_the_other_sign_is_refused():
    (spot,) = study().spots[:1]
    turned = replace(study().protocol, path=study().protocol.path * [1.0, -1.0])
    with pytest.raises(CurveError, match=r"goes to -22\.4\d* degrees first where the protocol goes to 22\.5"):
        load_measured(replace(study(), spots=(spot,), protocol=turned), plugins().channels)


def test_the_study_is_marked_as_simulated_and_is_small():
    readme = (folder() / "README.md").read_text()
    assert "**The experiment is simulated, robot and sensor included.**" in readme
    assert study().data == "simulated"
    assert "(simulated)" in plugins().studies["robot-log"].summary
    assert all("simulated" in file.name for spot in study().spots for file in spot.files)
    assert sum(file.stat().st_size for file in folder().rglob("*") if file.is_file()) < 2_000_000
    with np.load(DATA / "robot_p3.npz") as stored:
        decimals = dict(zip([n for n in stored.files if n != "decimals"], stored["decimals"], strict=True))
        moment = np.cumsum(stored["tz_Nm"], dtype=np.int64) / 10.0 ** decimals["tz_Nm"]
    log = pl.read_parquet(folder() / "logs" / "simulated_p3.parquet")
    np.testing.assert_allclose(log["tz_Nm"], moment[::2], rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_the_sphere_may_touch_every_mesh_at_its_spot():
    for limb in load_limbs(study()).values():
        points = limb.mesh.points_mm
        nearest = int(np.linalg.norm(points, axis=1).argmin())
        assert np.abs(points[nearest]).max() < 1.0
        assert abs(points[nearest, 2]) < 0.05
        assert nearest in limb.mesh.node_sets["contact"]


def write_study(target: Path, measured_toml: str, experiment_toml: str) -> None:
    """Write the ready study with one spot of these files, read by these tables."""
    text = (folder() / "study.toml").read_text()
    head, rest = text.split("[[spot]]", 1)
    tail = rest[rest.index("[limb]") :]
    mesh = (folder() / "meshes" / "p1.vtu").as_posix()
    spot = f'[[spot]]\nname = "p1"\nmeasured = {measured_toml}\nmesh = "{mesh}"\n\n'
    target.write_text(head + spot + experiment_toml + "\n\n" + tail)


def pressed_again(path: Path, factor: float) -> None:
    """Write a second press: every force and moment of the limb times a factor, the bias as it was."""
    log = pl.read_parquet(folder() / "logs" / "simulated_p1.parquet")
    wrench = [name for name in log.columns if name.endswith(("_N", "_Nm"))]
    bias = log[:40].select(pl.col(wrench).mean())
    log.with_columns((pl.col(c) - bias[c][0]) * factor + bias[c][0] for c in wrench).write_parquet(path)


@pytest.mark.slow
def test_what_inspection_proposes_reads_two_presses_and_draws_them(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one.parquet").write_bytes((folder() / "logs" / "simulated_p1.parquet").read_bytes())
    pressed_again(tmp_path / "two.parquet", 1.1)
    assert main(["experiment", "inspect", "one.parquet"]) == 0
    shown = capsys.readouterr().out
    write_study(
        tmp_path / "study.toml", '["one.parquet", "two.parquet"]', shown[shown.index("[experiment]") :]
    )
    assert main(["experiment", ".", "--out", "run", "--plots", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["channel"], row["n_presses"]) for row in rows] == [("force", 2), ("torque", 2)]
    # Two presses that differ by 10 % have a standard deviation of 7 %.
    assert rows[0]["largest_std"] == pytest.approx(0.1 * 12.8 / np.sqrt(2.0), rel=0.05)
    plots = tmp_path / "run" / "measured" / "plots" / "p1"
    drawn = {file.relative_to(plots).as_posix() for file in plots.rglob("*.png")}
    steps = ("1_as_read", "2_tared", "3_phases", "4_onset", "5_curves")
    assert drawn == {"curves.png", *(f"{log}/{step}.png" for log in ("one", "two") for step in steps)}
    page = (tmp_path / "run" / "measured" / "curves.html").read_text()
    assert re.findall("<h2[^>]*>Curves over ([a-z ]+)", page) == [
        "time of the log ",
        "indentation depth ",
        "rotation ",
    ]
    assert {f"p1, {name}" for name in ("one", "two", "one.parquet", "two.parquet")} <= set(
        re.findall('<th scope="row">([^<]+)', page)
    )
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    reported = manifest["measured"]["p1"]
    assert list(reported["files"]) == ["one.parquet", "two.parquet"]
    assert [phase["name"] for phase in reported["files"]["two.parquet"]["phases"]][:3] == [
        "approach", "press", "dwell_1",
    ]  # fmt: skip


@pytest.mark.slow
def test_the_cycles_of_a_log_are_shown_drawn_and_recorded(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    pressed_again(tmp_path / "softer.parquet", 0.9)
    first, second = (
        pl.read_parquet(p) for p in (folder() / "logs" / "simulated_p1.parquet", "softer.parquet")
    )
    later = second.with_columns(pl.col("time_s") + first["time_s"][-1] + first["time_s"][1])
    pl.concat([first, later]).write_parquet("cycles.parquet")
    assert main(["experiment", "inspect", "cycles.parquet"]) == 0
    shown = capsys.readouterr().out
    assert re.search(
        r"2 presses, of 1\d\.\d N, 1\d\.\d N \(-\d+\.\d %\): the last counts", " ".join(shown.split())
    )
    experiment = shown[shown.index("[experiment]") :]
    experiment = experiment.replace('loader = "robot_log"', 'loader = "robot_log"\nsettings.cycle = "all"')
    write_study(tmp_path / "study.toml", '"cycles.parquet"', experiment)
    assert main(["experiment", ".", "--out", "run", "--plots"]) == 0
    shown = capsys.readouterr()
    assert "Cycles of cycles.parquet, cycle_2" in shown.out
    assert "-10.0 %" in shown.out
    assert "torque changes by -10 % from the cycle before to cycle 2 of 2" in " ".join(shown.err.split())
    plots = tmp_path / "run" / "measured" / "plots" / "p1"
    drawn = {file.relative_to(plots).as_posix() for file in plots.rglob("*.png")}
    assert {"cycles/1_as_read.png", "cycles/6_cycles.png", "cycles/cycle_2/3_phases.png"} < drawn
    first, second = json.loads((tmp_path / "run" / "manifest.json").read_text())["measured"]["p1"][
        "files"
    ].values()
    assert "cycles" not in first
    assert [row["cycle"] for row in second["cycles"]] == [1, 2]


@pytest.mark.slow
def test_a_log_that_stops_half_way_ends_with_2_and_leaves_its_picture(tmp_path, capsys):
    log = pl.read_parquet(folder() / "logs" / "simulated_p1.parquet")
    log[:1500].write_parquet(tmp_path / "half.parquet")
    text = (folder() / "study.toml").read_text()
    experiment = text[text.index("[experiment]") : text.index("[limb]")]
    write_study(tmp_path / "study.toml", '"half.parquet"', experiment)
    assert main(["experiment", str(tmp_path), "--out", str(tmp_path / "run"), "--plots"]) == 2
    assert re.search(r"half\.parquet.*stops half-way", capsys.readouterr().err)
    drawn = [file.name for file in (tmp_path / "run").rglob("*.png")]
    assert drawn == ["1_as_read.png"]
    assert not (tmp_path / "run" / "manifest.json").exists()
