"""An indenter and channels that only a plugin knows go from synthetic curves to the fit and the report."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

import palpate_jax
from palpate import pipeline
from palpate.plugins.registry import load_file
from palpate.stages.experiment import load_measured
from palpate.testing.studies import StudyRunner

PLUGIN = Path(__file__).parents[1] / "data" / "plugins" / "third_of_each.py"
CHANNELS = ("held_force", "lever")

pytestmark = pytest.mark.usefixtures("one_figure")


def test_channels_of_a_plugin_are_simulated_fitted_and_reported(tmp_path):
    study, plugins = StudyRunner(tmp_path).study(
        load_file(PLUGIN),
        palpate_jax,
        limb={"source": "small_block"},
        solver={"name": "jax", "settings": {"depth_steps": 3, "rotation_step_deg": 5.0}},
        protocol={
            "indenter": {"shape": "bowl", "tip": 7.5},
            "depth": "2 mm",
            "twist": ["-10 deg", "10 deg"],
            "friction": 1.0,
        },
        selection={"scenarios": ["held", "three"], "stiffness_scaling": True},
        fit={"search": "least_squares"},
    )
    measured = load_measured(study, plugins.channels)["p1"]
    assert set(CHANNELS) < set(measured)
    np.testing.assert_allclose(
        measured["lever"].ordinate, measured["torque"].ordinate / measured["held_force"].ordinate
    )
    result = pipeline.run_study(study, tmp_path / "run", plugins)
    fits = result.fit.table
    assert set(fits["message"]) == {"converged"}
    np.testing.assert_allclose(fits["tissue.e"], study.truth["tissue.e"], rtol=1e-4)
    assert fits.filter(scenario="held")["n_runs"][0] <= 4  # exact slopes
    best = result.selected.stiffness_scaling
    assert set(best.filter(pl.col("scenario") == "held")["message"]) == {"as expected"}
    report = tmp_path / "run" / "report"
    page, errors = (report / "index.html").read_text(), (report / "tables" / "fit.csv").read_text()
    latex = (report / "tables" / "paper_table2.tex").read_text()
    for name in CHANNELS:
        assert f"nmse_{name}" in errors
        assert plugins.channels[name].ordinate_label in page
        assert name.replace("_", r"\_") in latex
