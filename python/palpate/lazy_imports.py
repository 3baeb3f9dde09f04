"""Names of a package that are imported when they are first used, so that finding it costs nothing."""

import importlib
from collections.abc import Callable, Mapping


def deferred(package: str, homes: Mapping[str, str]) -> Callable[[str], object]:
    """Make the ``__getattr__`` of a package.

    Parameters
    ----------
    package : str
        Its ``__name__``.
    homes : mapping of name to module
        Where in the package each name lives.

    Returns
    -------
    callable
        Imports a name; raises AttributeError for any other.
    """

    def get(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        value: object = getattr(importlib.import_module(f"{package}.{homes[name]}"), name)
        return value

    return get
