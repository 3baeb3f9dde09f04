"""Whether palpate takes what a plugin's module provides."""

from palpate.plugins.catalogue import Plugins


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
    loaded = Plugins.load(entry_points=False, modules=plugins)
    assert not loaded.broken, "; ".join(map(str, loaded.broken))
    return loaded
