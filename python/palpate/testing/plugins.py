"""Whether palpate takes what a plugin's module provides."""

import functools

from palpate.plugins.catalogue import Plugins
from palpate.plugins.registry import registered


def plugins_with(*plugins: object) -> Plugins:
    """Load the core and these plugins, as if nothing else were installed.

    Parameters
    ----------
    plugins : module or object
        With hooks marked ``@palpate.hookimpl``.

    Returns
    -------
    Plugins

    Raises
    ------
    AssertionError
        palpate would leave one of them out; with the reason.
    """
    registry = registered((), entry_points=False)
    for plugin in plugins:
        name = getattr(plugin, "__name__", type(plugin).__name__)
        registry.register(name, "under test", functools.partial(_itself, plugin))
    registry.collect()
    assert not registry.broken, "; ".join(map(str, registry.broken))
    return Plugins(registry)


def _itself(plugin: object) -> object:
    return plugin
