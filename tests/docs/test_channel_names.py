"""No file outside the domain asks for the name of a channel: its properties are fields of ``Channel``."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = [
    path
    for folder in ("python/palpate", "plugins", "examples")
    for path in sorted((ROOT / folder).rglob("*.py"))
    if not {"tests", "domain"} & {*path.relative_to(ROOT).parts}
]
NAMES = {"force", "torque", "lateral_force", "tilt_moment", "force_over_time", "torque_over_time"}


def asks(source: str) -> list[str]:
    """Comparisons of a channel, or of its name, with a name."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Compare):
            continue
        sides = [node.left, *node.comparators]
        named = [each for each in sides if isinstance(each, ast.Constant) and each.value in NAMES]
        others = " ".join(ast.unparse(each) for each in sides if each not in named)
        if named and ("channel" in others or others in {"name", "self.name"}):
            found.append(f"line {node.lineno}: {ast.unparse(node)}")
    return found


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_channel_is_asked_for_its_name(path):
    assert not asks(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    "asked",
    ['ORDER[channel == "force"]', 'name != "torque"', '"force" in channels', 'item.channel == "force"'],
)
def test_a_question_for_a_name_is_found(asked):
    assert asks(asked)
