"""State of the whole process that a plugin must leave as it was."""

import contextlib
import locale
import os
import random
import signal
import sys
import threading
import warnings
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


def _is_of_all(entry: tuple[Any, ...]) -> bool:
    return entry[1:] == (None, Warning, None, 0)


def _filters_of_all() -> list[tuple[Any, int]]:
    """Each filter of all warnings, and how many of single warnings come after it.

    A library that is imported meanwhile may keep its filters of single warnings, which come first.
    """
    found, n_after = [], 0
    for entry in reversed(warnings.filters):
        if _is_of_all(entry):
            found.append((entry, n_after))
        else:
            n_after += 1
    return found[::-1]


def _set_filters_of_all(filters: list[tuple[Any, int]]) -> None:
    waiting = list(filters)
    single = [entry for entry in warnings.filters if not _is_of_all(entry)]
    kept: list[Any] = []
    for n_after, entry in zip(range(len(single), 0, -1), single, strict=True):
        while waiting and waiting[0][1] >= n_after:
            kept.append(waiting.pop(0)[0])
        kept.append(entry)
    warnings.filters[:] = [*kept, *(entry for entry, _ in waiting)]  # type: ignore[index]


def _set_interrupt(handler: Any) -> None:  # noqa: ANN401 - what signal.getsignal returns
    if handler is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, handler)


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
        "filter of all warnings": ("warnings", _filters_of_all, _set_filters_of_all),
        "handler of Ctrl-C": ("signal", lambda: signal.getsignal(signal.SIGINT), _set_interrupt),
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

ALWAYS = (
    "working directory",
    "locale",
    "numpy's error state",
    "filter of all warnings",
    "handler of Ctrl-C",
)
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
