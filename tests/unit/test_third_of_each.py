"""An indenter, a motion and channels of a plugin go from synthetic curves to the fit and the report."""

from pathlib import Path

import numpy as np
import pytest

import palpate_certainty
import palpate_jax
import palpate_report
from palpate.experiment.measured import load_measured
from palpate.plugins.registry import load_file
from palpate.stages import pipeline
from palpate.testing.studies import StudyRunner

PLUGIN = Path(__file__).parents[1] / "data" / "plugins" / "third_of_each.py"
CHANNELS = ("lateral_force", "wiped_force", "grip")

pytestmark = pytest.mark.usefixtures("one_figure")


@pytest.mark.slow
def test_channels_of_a_plugin_are_simulated_fitted_and_reported(tmp_path):
    study, plugins = StudyRunner(tmp_path).study(
        load_file(PLUGIN),
        palpate_jax,
        palpate_certainty,
        palpate_report,
        limb={"source": "small_block"},
        solver={"name": "jax", "settings": {"depth_steps": 4}},
        protocol={
            "indenter": {"shape": "bowl", "tip": 7.5},
            "motion": "wipe",
            "depth": 2.0,
            "reach": 1.0,
            "friction": 0.5,
        },
        selection={"scenarios": ["wiped", "slid"]},
        fit={"search": "least_squares"},
    )
    measured = load_measured(study, plugins.channels)["p1"]
    assert set(measured) == {"force", *CHANNELS}
    np.testing.assert_allclose(measured["grip"].abscissa[[0, -1]], [0.0, -1.0])
    lateral, wiped = (measured[name].ordinate for name in ("lateral_force", "wiped_force"))
    # Exact at the states; between them a cubic of the ratio is nearly the ratio of cubics.
    np.testing.assert_allclose(measured["grip"].ordinate, lateral / wiped, rtol=2e-3)
    grip = measured["grip"]
    assert grip.ordinate[grip.branches[0][1] - 1] > 0.0 > grip.ordinate[-1]  # against each stroke
    result = pipeline.run_study(study, tmp_path / "run", plugins)
    fits = result.fit.table
    assert set(fits["message"]) <= {"converged", "no step gains any more"}
    np.testing.assert_allclose(fits["tissue.e"], study.truth["tissue.e"], rtol=1e-4)
    assert fits.filter(scenario="wiped")["n_runs"][0] <= 4  # exact slopes
    report = tmp_path / "run" / "report"
    page, errors = (report / "index.html").read_text(), (report / "tables" / "fit.csv").read_text()
    latex = (report / "tables" / "paper_table2.tex").read_text()
    for name in CHANNELS:
        assert f"nmse_{name}" in errors
        assert plugins.channels[name].ordinate_label in page
        assert name.replace("_", " ") in latex
