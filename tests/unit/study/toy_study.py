"""The toy study as a text, read with mistakes in it."""

from pathlib import Path

import pytest

from palpate.errors import StudyError
from palpate.plugins.catalogue import Plugins
from palpate.study.reading import Study, read_study

TOY = Path(__file__).parents[2] / "data" / "toy"
TEXT = (TOY / "study.toml").read_text()


def read_text(folder: Path, plugins: Plugins, text: str) -> Study:
    for name in ("s1.txt", "s2.txt"):
        (folder / name).write_bytes((TOY / name).read_bytes())
    (folder / "study.toml").write_text(text)
    return read_study(folder / "study.toml", plugins)


def messages(folder: Path, plugins: Plugins, text: str) -> list[str]:
    with pytest.raises(StudyError) as caught:
        read_text(folder, plugins, text)
    return [line.removeprefix(f"{folder / 'study.toml'}:") for line in str(caught.value).splitlines()]


def line_of(text: str, part: str) -> int:
    return text[: text.index(part)].count("\n") + 1
