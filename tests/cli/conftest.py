"""One way to call the command line in a test."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from palpate.cli.app import main

TOY = Path(__file__).parents[1] / "data" / "toy"
PLUGIN = str(TOY / "toy_plugin.py")


@dataclass(frozen=True)
class Outcome:
    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


Call = Callable[..., Outcome]


@pytest.fixture
def call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Call palpate with the toy plugin, in an empty working folder."""
    monkeypatch.chdir(tmp_path)

    def call_palpate(*arguments: object, plugin: str | None = PLUGIN) -> Outcome:
        given = [*(["--plugin", plugin] if plugin else []), *map(str, arguments)]
        capsys.readouterr()
        code = main(given)
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err)

    return call_palpate


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """Copy of the toy study, to be spoilt."""
    folder = tmp_path / "study"
    folder.mkdir()
    for name in ("study.toml", "s1.txt", "s2.txt"):
        (folder / name).write_bytes((TOY / name).read_bytes())
    return folder
