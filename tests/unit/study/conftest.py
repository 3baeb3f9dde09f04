"""The plugins of the toy study."""

import pytest

from palpate.plugins.catalogue import Plugins

from .toy_study import TOY


@pytest.fixture(scope="module")
def plugins() -> Plugins:
    return Plugins.load([TOY / "toy_plugin.py"], entry_points=False)
