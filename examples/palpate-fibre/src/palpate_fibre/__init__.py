"""A fibre-reinforced material and a loader of strip tests."""

from collections.abc import Iterable

from palpate.api import ExperimentLoader, Material, hookimpl
from palpate_fibre.reinforced import Reinforced, ReinforcedSettings
from palpate_fibre.strip import Strip

__all__ = ["Reinforced", "ReinforcedSettings", "Strip"]


@hookimpl
def palpate_materials() -> Iterable[type[Material]]:
    """Provide the material."""
    return [Reinforced]


@hookimpl
def palpate_experiment_loaders() -> Iterable[type[ExperimentLoader]]:
    """Provide the loader."""
    return [Strip]
