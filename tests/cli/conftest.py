"""The toy study, as files that a test may change."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

TOY = Path(__file__).parents[1] / "data" / "toy"
PLUGIN = str(TOY / "toy_plugin.py")
Call = Callable[..., Any]


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """Copy of the toy study."""
    folder = tmp_path / "study"
    folder.mkdir()
    for name in ("study.toml", "s1.txt", "s2.txt"):
        (folder / name).write_bytes((TOY / name).read_bytes())
    return folder
