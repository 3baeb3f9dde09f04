"""Limits of verdicts are in one table, and each is described there."""

import ast
import re
from dataclasses import FrozenInstanceError, fields
from pathlib import Path

import pytest

from palpate.domain.thresholds import THRESHOLDS, Thresholds

ROOT = Path(__file__).parents[3]
OF_VERDICTS = (
    "python/palpate/answer/words.py",
    "python/palpate/answer/table.py",
    "python/palpate/experiment/relaxation.py",
    "plugins/palpate-certainty/src/palpate_certainty/adequacy.py",
    "plugins/palpate-certainty/src/palpate_certainty/assessment.py",
    "plugins/palpate-certainty/src/palpate_certainty/held_out.py",
    "plugins/palpate-certainty/src/palpate_certainty/linear_problem.py",
    *(
        f"plugins/palpate-report/src/palpate_report/answer/{name}.py"
        for name in ("model_verdict", "next_step")
    ),
    "plugins/palpate-report/src/palpate_report/answer/result.py",
)


def limits(file):
    """Numbers that a module compares something with, besides ends of a range and counts."""
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    compared = (node for node in ast.walk(tree) if isinstance(node, ast.Compare))
    sides = (side for node in compared for side in (node.left, *node.comparators))
    parts = (part for side in sides if not isinstance(side, ast.Call) for part in ast.walk(side))
    numbers = (part.value for part in parts if isinstance(part, ast.Constant))
    return [each for each in numbers if isinstance(each, float) and each not in (0.0, 1.0)]


@pytest.mark.parametrize("file", OF_VERDICTS)
def test_a_module_of_verdicts_has_no_limit_of_its_own(file):
    assert limits(file) == []


def test_every_limit_is_described_and_none_can_be_changed():
    described = {
        name
        for names in re.findall(r"^    ([\w, ]+) : float$", Thresholds.__doc__, flags=re.MULTILINE)
        for name in names.split(", ")
    }
    assert described == {each.name for each in fields(Thresholds)}
    with pytest.raises(FrozenInstanceError):
        THRESHOLDS.spots = 0.5
