"""A run that verifies its selected sets, with a stand-in for FEBio."""

import numpy as np
import polars as pl
import pytest

from palpate.mesh.specimens import block

STUDY = """
[study]
name = "block"
data = "simulated"
[[spot]]
name = "p1"
measured = "p1.csv"
mesh = "p1.feb"
[experiment]
loader = "csv"
[limb]
source = "febio_deck"
[limb.settings]
contact = "skin_surface"
regions = { soft_tissue = "1_soft_tissue" }
[protocol]
indenter = { shape = "sphere", radius = "7.5 mm" }
depth = "2 mm"
twist = ["-20 deg", "20 deg", "0 deg"]
friction = 1.0
[region.soft_tissue]
material = "ogden"
[sampling]
n_sets = 3
seed = 1
[solver]
name = "febio"
[solver.settings]
depth_steps = 4
rotation_step_deg = 5.0
facet_mm = 1.5
[selection]
scenarios = ["I"]
generalise_by = "I"
[fit]
search = "sweep"
"""


@pytest.fixture
def study(tmp_path, fake_febio):
    """A study on a block whose solver is the stand-in for FEBio, with simulated curves."""
    from palpate_febio.deck import Problem, write_deck
    from palpate_febio.settings import FebioSettings
    from palpate_febio.spelling import written
    from palpate_febio.steps import Steps
    from palpate_materials import Ogden

    limb = block(n_across=2, n_down=1)
    problem = Problem(
        mesh=limb.mesh,
        materials={"soft_tissue": written(Ogden(), np.array([0.06, 3.0, 1.0]), "textbook")},
        radius_mm=7.5,
        friction=1.0,
        steps=Steps(np.array([0.0, 1.0]), np.zeros(2)),
        settings=FebioSettings(facet_mm=1.5),
    )
    folder = tmp_path / "block"
    folder.mkdir()
    (folder / "p1.feb").write_bytes(write_deck(problem))
    (folder / "study.toml").write_text(STUDY)
    depth = np.concatenate([np.linspace(0, 2, 5), np.full(16, 2.0)])
    turn = np.concatenate([np.zeros(5), np.linspace(-5, -20, 4), np.linspace(-15, 20, 8), [15, 10, 5, 0]])
    rows = {"depth_mm": depth, "angle_deg": turn, "force_N": depth**1.5, "torque_Nmm": turn / 30}
    pl.DataFrame(rows).write_csv(folder / "p1.csv")
    return folder


@pytest.mark.slow
def test_a_run_verifies_its_sets_once(call, study, tmp_path):
    ran = call("run", study, "--json", plugin=None)
    assert ran.code == 0, ran.err
    (row,) = ran.json["verification"]
    assert (row["spot"], row["passed"]) == ("p1", True)
    assert abs(row["halving"]) < 1e-6
    assert (tmp_path / "count").read_text().count("run") == 4  # three sets, and one verification
    again = call("verify", study, plugin=None)
    assert "torque verified" in again.out
    assert (tmp_path / "count").read_text().count("run") == 4
