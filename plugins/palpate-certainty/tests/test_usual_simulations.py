"""Simulations that the intervals need, as a forecast of the run has them."""

import pytest

from palpate import Plugins
from palpate.stages.pipeline import check_study, parts_of
from palpate.study.reading import read_study


@pytest.mark.parametrize(("name", "n_run"), [("first-press", 7), ("forearm-demo", 56)])
def test_a_run_on_meshes_simulates_the_reported_values_with_the_surface(name, n_run):
    """Searches may end earlier, and nothing else does."""
    plugins = Plugins.load()
    study = read_study(plugins.studies[name].directory, plugins)
    parts = {part.stage: part for part in parts_of(study, check_study(study, plugins), plugins)}
    n_spots = len(study.spots)
    assert parts["intervals"].n == 0, "every cause has a slope"
    assert parts["surface"].n == n_spots
    assert sum(part.n for part in parts.values()) == n_run
