"""The tools of the demo can be pressed on its limbs."""

from pathlib import Path

import numpy as np
import pytest

from palpate.plugins.catalogue import Plugins
from palpate.simulation.jobs import job_for
from palpate.study.reading import read_study
from palpate.study.tool import read_tool
from palpate_prediction.predict import refined_limbs


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plate", "cuff"])
def test_a_tool_of_the_demo_fits_on_its_limb(name):
    plugins = Plugins.load()
    folder = Path(str(plugins.studies["forearm-demo"].directory))
    study = read_study(folder, plugins)
    tool = read_tool(folder / f"{name}.toml", study, plugins)
    pressed = tool.study(study)
    limb = refined_limbs(pressed, tool)["p1"]
    assert limb.mesh.n_nodes == 10258
    row = [0.0141, -0.0011, 1.05e-4]
    pressed.solver.check(job_for(pressed, "p1", 0, np.array(row), {}), limb)
