"""State of the whole process that a plugin must leave as it was."""

import contextlib
import locale
import os
import random
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from types import MappingProxyType
from typing import Any


def _environment() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}


def _set_environment(variables: Mapping[str, str]) -> None:
    for name in _environment().keys() - variables.keys():
        del os.environ[name]
    os.environ.update(variables)


def _numpy_random() -> tuple[Any, ...]:
    kind, keys, *rest = sys.modules["numpy"].random.get_state()
    return (kind, tuple(keys), *rest)


STATES: Mapping[str, tuple[str, Callable[[], Any], Callable[[Any], Any]]] = MappingProxyType(
    {
        "working directory": ("os", os.getcwd, os.chdir),
        "locale": (
            "locale",
            lambda: locale.setlocale(locale.LC_ALL),
            lambda name: locale.setlocale(locale.LC_ALL, name),
        ),
        "numpy's error state": (
            "numpy",
            lambda: sys.modules["numpy"].geterr(),
            lambda state: sys.modules["numpy"].seterr(**state),
        ),
        "environment": ("os", _environment, _set_environment),
        "state of `random`": ("random", random.getstate, random.setstate),
        "state of `numpy.random`": (
            "numpy.random",
            _numpy_random,
            lambda state: sys.modules["numpy"].random.set_state(state),
        ),
        "matplotlib's style": (
            "matplotlib",
            lambda: dict.copy(sys.modules["matplotlib"].rcParams),
            lambda style: dict.update(sys.modules["matplotlib"].rcParams, style),
        ),
    }
)
"""Module, how to read and how to set it, by its name; a module that is not imported yet has no state."""

ALWAYS = ("working directory", "locale", "numpy's error state")
"""What is restored after each call of a plugin; the rest may be how it sets up a library."""


@contextlib.contextmanager
def restored(names: Collection[str] = ALWAYS) -> Iterator[list[str]]:
    """Restore what changes meanwhile; the names of what has changed are in the list at the end."""
    before: dict[str, Any] = {}
    changed: list[str] = []
    for name in names:
        module, read, _ = STATES[name]
        if module in sys.modules:
            with contextlib.suppress(FileNotFoundError):  # a working directory that was removed
                before[name] = read()
    try:
        yield changed
    finally:
        for name, state in before.items():
            _, read, write = STATES[name]
            with contextlib.suppress(FileNotFoundError):
                if read() != state:
                    changed.append(name)
                    write(state)
