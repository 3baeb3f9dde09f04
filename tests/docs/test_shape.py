"""Shape of the sources: each count may only fall, and whoever lowers one lowers its limit here.

``python tests/docs/test_shape.py`` prints the counts, and what is over.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from palpate.plugins.catalogue import Plugins
from palpate.run.tables import ASSESSED

ROOT = Path(__file__).parents[2]
LONGEST_FILE = 500
LONGEST_FUNCTION = 45
MOST = {
    "lines": 78_356,
    "lines of the core": 33_397,
    "classes": 650,
    "constants": 689,
    "long files": 0,
    "long functions": 6,
    "docstrings without a noun first": 0,
    "docstrings with that of or those of": 0,
}
Definition = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


@cache
def sources() -> dict[Path, str]:
    """Text of each module of palpate and its plugins."""
    folders = [ROOT / "python" / "palpate", *sorted((ROOT / "plugins").glob("*/src"))]
    files = (file for folder in folders for file in sorted(folder.rglob("*.py")))
    return {file.relative_to(ROOT): file.read_text(encoding="utf-8") for file in files}


def definitions(tree: ast.Module) -> Iterator[ast.Module | Definition]:
    return (node for node in ast.walk(tree) if isinstance(node, ast.Module | Definition))


def constants(tree: ast.Module) -> Iterator[str]:
    """Names in capitals that a module binds."""
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for target in targets:
            if isinstance(target, ast.Name) and re.fullmatch(r"_?[A-Z][A-Z0-9_]*", target.id):
                yield target.id


def found_in(text: str) -> dict[str, list[str]]:
    """Things of a module that are counted, in words."""
    tree, lines = ast.parse(text), text.splitlines()
    nodes = list(definitions(tree))
    docs = [(getattr(node, "name", "module"), ast.get_docstring(node) or "") for node in nodes]
    functions = [node for node in nodes if not isinstance(node, ast.Module | ast.ClassDef)]
    lengths = [(node.name, (node.end_lineno or 0) - node.lineno + 1) for node in functions]
    return {
        "lines": lines,
        "classes": [node.name for node in nodes if isinstance(node, ast.ClassDef)],
        "constants": list(constants(tree)),
        "long functions": [f"{name} {n}" for name, n in lengths if n > LONGEST_FUNCTION],
        "docstrings without a noun first": [
            f"{name}: {doc.splitlines()[0]}"
            for name, doc in docs
            if re.match(r"(?:Of|By|As|What|That|Those)\b", doc)
        ],
        "docstrings with that of or those of": [
            f"{name}: {sentence.strip()}"
            for name, doc in docs
            for sentence in re.split(r"(?<=[.;])\s", doc)
            for _ in re.findall(r"\b(?:that|those)\s+of\b", sentence, re.IGNORECASE)
        ],
    }


def lengths() -> dict[Path, int]:
    """Lines of each file, of tests too."""
    tests = (file for of in ("tests", "plugins/*/tests") for file in ROOT.glob(f"{of}/**/*.py"))
    texts = sources() | {file.relative_to(ROOT): file.read_text(encoding="utf-8") for file in tests}
    return {file: len(text.splitlines()) for file, text in texts.items()}


@cache
def counted() -> dict[str, list[str]]:
    """Everything that is counted, each with its file."""
    every: dict[str, list[str]] = {name: [] for name in MOST}
    for file, text in sources().items():
        for what, found in found_in(text).items():
            every[what] += (f"{file}: {each}" for each in found)
    every["long files"] = [f"{file}: {n}" for file, n in lengths().items() if n > LONGEST_FILE]
    every["lines of the core"] = [line for line in every["lines"] if line.startswith("python/palpate/")]
    return every


@pytest.mark.parametrize("what", MOST)
def test_a_count_does_not_rise(what: str) -> None:
    found = counted()[what]
    assert len(found) <= MOST[what], f"{len(found)} {what}; {MOST[what]} are allowed"


ALSO_OF_THE_CORE = {
    "budget": "table of a study",
    "certainty": "distribution that is released with the core",
    "relaxation": "check of a model",
    "report": "folder of a run, and the command that is named last",
}
"""Words of the core that are names of plugins' stages or tables too."""


def test_the_core_names_no_stage_or_table_of_a_plugin() -> None:
    every = Plugins.load().stages
    stages = {name: kind for name, kind in every.items() if not kind.__module__.startswith("palpate.")}
    assert {"intervals", "report"} <= stages.keys()
    names = {*stages, *(table for kind in stages.values() for table in kind.tables)} - ASSESSED.keys()
    found = {
        node.value
        for file, text in sources().items()
        if file.is_relative_to("python/palpate")
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    assert names & found <= ALSO_OF_THE_CORE.keys()


def test_the_counts_are_right() -> None:
    long = "def long():\n" + "    pass\n" * LONGEST_FUNCTION
    names = "MOST = 1\nLEAST: int = 2\nsome = 3\n"
    text = f'"""Of a module."""\n{names}class A:\n    """Error, that of B."""\n{long}'
    found = found_in(text)
    assert found["constants"] == ["MOST", "LEAST"]
    assert found["classes"] == ["A"]
    assert found["long functions"] == [f"long {LONGEST_FUNCTION + 1}"]
    assert found["docstrings without a noun first"] == ["module: Of a module."]
    assert found["docstrings with that of or those of"] == ["A: Error, that of B."]


if __name__ == "__main__":
    for name, each in counted().items():
        shown = [] if "lines" in name or name in ("classes", "constants") else sorted(each)
        print(f"{len(each):6} {name}", *shown, sep="\n         ")  # noqa: T201
