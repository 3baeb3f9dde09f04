"""Codes of warnings: each is explained, used, and shown."""

import ast
from pathlib import Path

import pytest

import palpate_report
from palpate_report.answer.result import make_conclusion
from palpate_report.answer.warnings import kinds, warn

SOURCES = Path(palpate_report.__file__).parent / "answer"
CALLS = {"warn": 0, "_listed": 0, "_by_scenario": 1}
"""Place of the code among the arguments of what makes warnings."""


def codes_in_use():
    for file in SOURCES.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in CALLS:
                code = node.args[CALLS[node.func.id]]
                if isinstance(code, ast.Constant):
                    yield code.value


def test_every_code_is_explained_and_used():
    assert set(codes_in_use()) == set(kinds())
    for kind in kinds().values():
        assert list(kind) == ["when", "why", "remedy"]
        assert all(len(text.split()) <= 25 and text.endswith(".") for text in kind.values())


def test_a_warning_without_an_explanation_is_a_bug():
    with pytest.raises(AssertionError, match="no warning has the code 'new'"):
        warn("new", "Something", "It matters.")


def test_a_run_shows_the_code_of_each_warning(content):
    found = make_conclusion(content(), {})
    assert found.warnings
    assert all(warning.code in kinds() for warning in (*found.warnings, *found.notes))
    shown = found.lines(content().study)["Warnings"]
    assert all(f"{each.what} [{each.code}]" in shown for each in found.warnings)
