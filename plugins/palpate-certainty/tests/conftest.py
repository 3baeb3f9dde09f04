"""A fit of curves of an Ogden tissue, with the stage that made it."""

import pytest

from palpate_materials import Ogden

from .ogden_fit import TRUTH


@pytest.fixture
def ended(pressed, stage_of):
    """Fit curves of an Ogden tissue; returns the study, its measured curves, its case and its stage."""

    def made(material=None, searched=("c1", "m1"), truth=TRUTH, spots=("p1",), **changes):
        study = pressed.study_of(material or Ogden(), searched, spots=spots, **changes)
        source = pressed.study_of(Ogden(), ("c1", "m1"))
        measured = {
            spot: pressed.measured_at(source, truth, 0.004, seed) for seed, spot in enumerate(spots, 1)
        }
        stage = stage_of(study, measured)
        return study, measured, stage.run()[0], stage

    return made
