"""Names of a module that are imported when they are first used, so that finding it costs nothing.

A module lists them as explicit re-exports for type checkers, and nowhere else::

    if TYPE_CHECKING:
        from palpate.domain import Curve as Curve

    else:
        __getattr__ = deferred(__name__)
"""

import functools
import importlib
import sys
import warnings
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any


@functools.cache
def _homes(module: str) -> dict[str, str]:
    """Modules of the names that a module imports for type checkers as themselves, by name."""
    import ast

    loader: Any = getattr(sys.modules[module].__spec__, "loader", None)
    source = loader.get_source(module) or ""
    return {
        alias.name: str(imported.module)
        for block in ast.parse(source).body
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"
        for imported in block.body
        if isinstance(imported, ast.ImportFrom)
        for alias in imported.names
        if alias.asname == alias.name
    }


def deferred(module: str, moved: Mapping[str, str] = MappingProxyType({})) -> Callable[[str], object]:
    """Make the ``__getattr__`` of a module; it has a ``__dir__`` that lists the names too.

    Parameters
    ----------
    module : str
        Its ``__name__``. What it imports as itself (``Curve as Curve``) under ``if TYPE_CHECKING:``
        are its names, its ``__all__``. Type checkers do not see ``__getattr__``, and so find misspelt names.
    moved : mapping of name to module
        Names that it had in an earlier version, and where they are now: found with a DeprecationWarning.

    Returns
    -------
    callable
        Imports a name; raises AttributeError for any other.
    """

    def get(name: str) -> object:
        if name == "__all__":
            return sorted(_homes(module))
        if name == "__dir__":
            return lambda: sorted({*vars(sys.modules[module]), *_homes(module)})
        if name in moved:
            place = f"{moved[name]}.{name}"
            warnings.warn(f"{module}.{name} is {place} now; import it from there", DeprecationWarning, 3)
            return getattr(importlib.import_module(moved[name]), name)
        if name.startswith("__") or name not in _homes(module):
            raise AttributeError(f"module '{module}' has no attribute '{name}'")
        return getattr(importlib.import_module(_homes(module)[name]), name)

    return get
