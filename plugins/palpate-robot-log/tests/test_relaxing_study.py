"""The ready study of a tissue that relaxes: its logs are read, and a fit finds how far it relaxes."""

from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from palpate.cli.app import main
from palpate.experiment.measured import load_measured
from palpate.plugins.catalogue import Plugins
from palpate.study.reading import read_study

ENDS_S = {"p1": 31.0, "p2": 11.0}
"""End of the rest, since first contact."""


@cache
def plugins():
    return Plugins.load()


def folder():
    return Path(plugins().studies["forearm-relaxing"].directory)


def test_its_logs_have_the_press_the_rest_and_the_twist():
    study = read_study(folder(), plugins())
    measured = load_measured(study, plugins().channels)
    for spot, end_s in ENDS_S.items():
        over_time, torque = (measured[spot][name] for name in ("force_over_time", "torque"))
        assert over_time.abscissa[-1] == pytest.approx(end_s, abs=0.1)
        assert np.ptp(torque.abscissa) == pytest.approx(20.0, abs=0.1)
    held = {spot: measured[spot]["force_over_time"].ordinate for spot in ENDS_S}
    lost = {spot: 1.0 - values[-1] / values.max() for spot, values in held.items()}
    assert lost["p1"] > 3.0 * lost["p2"] > 0.03  # 30 s at the faster press
    assert all(map(study.models_relaxation, study.scenarios))
    assert (study.data, study.truth["soft_tissue.relaxed_10s"]) == ("simulated", 0.1)


def test_it_is_small_and_marked_as_simulated():
    assert (
        "**The experiment is simulated, robot and sensor included.**" in (folder() / "README.md").read_text()
    )
    assert "(simulated)" in plugins().studies["forearm-relaxing"].summary
    assert sum(file.stat().st_size for file in folder().rglob("*") if file.is_file()) < 1_000_000


@pytest.mark.slow
def test_a_fit_of_one_spot_finds_how_far_it_relaxes(tmp_path):
    """On the demo's mesh and by long steps, with the shape of Yeoh's law as it is."""
    text = (folder() / "study.toml").read_text()
    demo = Path(plugins().studies["forearm-demo"].directory) / "meshes" / "p1.vtu"
    first, second = text.index('[[spot]]\nname = "p2"'), text.index("[experiment]")
    text = text[:first] + text[second:]
    for old, new in {
        '"logs/simulated_p1.parquet"': f'"{(folder() / "logs" / "simulated_p1.parquet").as_posix()}"',
        '"meshes/p1.vtu"': f'"{demo.as_posix()}"',
        "[fit.searched]": '[fit]\nfine_edge = "0 mm"\n[fit.searched]',
        'c2 = { lower = "-2 kPa", upper = "-0.4 kPa" }': 'c2 = "-1.1 kPa"',
        'c3 = { lower = "0.03 kPa", upper = "0.25 kPa" }': 'c3 = "0.105 kPa"',
        "rotation_step_deg = 2.0": "rotation_step_deg = 5.0, depth_steps = 6",
    }.items():
        assert old in text, old
        text = text.replace(old, new)
    (tmp_path / "study.toml").write_text(text[: text.index("\n[truth")])
    assert main(["run", str(tmp_path), "--out", str(tmp_path / "run")]) == 0
    (row,) = pl.read_parquet(tmp_path / "run" / "fit.parquet").to_dicts()
    assert row["soft_tissue.c1"] == pytest.approx(0.0141, rel=0.05)
    assert row["soft_tissue.relaxed_1s"] == pytest.approx(0.15, abs=0.03)
    assert row["soft_tissue.relaxed_10s"] == pytest.approx(0.1, abs=0.03)
