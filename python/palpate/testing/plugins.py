"""Whether palpate takes what a plugin's module provides."""

from types import ModuleType

from palpate.plugin_registry import admitted
from palpate.plugins import Plugins


def plugins_with(module: ModuleType) -> Plugins:
    """Load the core and one plugin, as if nothing else were installed.

    Parameters
    ----------
    module : ModuleType
        With hooks marked ``@palpate.hookimpl``.

    Returns
    -------
    Plugins

    Raises
    ------
    AssertionError
        palpate would list the module as broken; with the reason.
    """
    registry = admitted((), entry_points=False)
    registry.admit(module.__name__, "the module under test", lambda: module)
    registry.collect()
    assert not registry.broken, "; ".join(map(str, registry.broken))
    return Plugins(registry)
