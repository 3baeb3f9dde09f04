"""The public names, and what they are called with, are those of the snapshot: a change of them is meant.

``python tests/unit/test_public_names.py`` writes the snapshot again.
"""

import importlib
import inspect
import pkgutil
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest

from palpate import api
from palpate.lazy_imports import deferred

SNAPSHOT = Path(__file__).parents[1] / "data" / "public_names.txt"


def public() -> Iterator[str]:
    """A line for each name, with its parameters where it is called."""
    rooms = sorted(room.name for room in pkgutil.iter_modules(api.__path__))
    for module in ("palpate", "palpate.api", *(f"palpate.api.{room}" for room in rooms), "palpate.testing"):
        found = importlib.import_module(module)
        for name in sorted(found.__all__ if hasattr(found, "__all__") else dir(found)):
            value = getattr(found, name)
            try:
                called = f"({', '.join(inspect.signature(value).parameters)})" if callable(value) else ""
            except (TypeError, ValueError):
                called = "(…)"
            yield f"{module}.{name}{called}"


def test_names_and_parameters_are_those_of_the_snapshot() -> None:
    known, found = SNAPSHOT.read_text(encoding="utf-8").splitlines(), list(public())
    gone, new = sorted(set(known) - set(found)), sorted(set(found) - set(known))
    assert found == known, f"gone: {gone}; new: {new}; if that is meant, run {Path(__file__).name}"


def test_a_name_that_moved_is_found_with_a_warning() -> None:
    get = deferred("palpate.api", moved={"CurveWriter": "palpate.api.files"})
    with pytest.warns(
        DeprecationWarning, match=r"palpate\.api\.CurveWriter is palpate\.api\.files\.CurveWriter now"
    ):
        assert get("CurveWriter") is api.files.CurveWriter
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert get("Curve") is api.Curve


if __name__ == "__main__":
    SNAPSHOT.write_text("\n".join(public()) + "\n", encoding="utf-8")
