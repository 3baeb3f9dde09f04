"""Fits of a tissue whose curves are known in closed form."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from palpate.domain import Design
from palpate.fit.stage import FitStage
from palpate.plugins.registry import load_file

PRESSED = Path(__file__).parents[2] / "data" / "plugins" / "pressed_tissue.py"


@pytest.fixture(scope="session")
def pressed():
    return load_file(PRESSED)


@pytest.fixture(scope="session")
def stage_of(pressed):
    """Make the fit of a study, without a sweep, from the middle of the ranges."""

    def made(study, measured, limbs=None):
        return FitStage(
            study=study,
            design=Design(
                parameters=study.space.parameters,
                values=np.zeros((0, len(study.space.parameters))),
                seed=1,
                n_drawn=0,
            ),
            measured=measured if isinstance(measured, dict) else dict.fromkeys(study.spot_names, measured),
            scores=pl.DataFrame(),
            simulations=pressed.Here(study.solver, limbs or {}),
            abscissae={"force": "depth_mm", "torque": "rotation_deg"},
        )

    return made
