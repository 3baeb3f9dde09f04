"""The guide to benchmarks is short and names every script, target and section that exists."""

import ast
import re
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "benchmarks"
README = (FOLDER / "README.md").read_text(encoding="utf-8")
MOST_LINES = 400
GUIDES = [*sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "plugins").glob("**/README.md"))]


def anchors(text: str) -> set[str]:
    """Targets of links to the headings of a Markdown text."""
    headings = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_the_guide_is_short() -> None:
    assert len(README.splitlines()) <= MOST_LINES


def test_the_guide_names_every_script_and_no_other() -> None:
    named = set(re.findall(r"\b(\w+\.py)\b", README))
    assert named == {path.name for path in FOLDER.glob("*.py")}


def test_every_target_of_make_that_the_guide_names_exists() -> None:
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert set(re.findall(r"`make ([\w-]+)`", README)) <= set(targets)


def test_every_script_that_make_runs_exists() -> None:
    run = re.findall(r"benchmarks/(\w+\.py)", (ROOT / "Makefile").read_text(encoding="utf-8"))
    assert [name for name in run if not (FOLDER / name).is_file()] == []


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\(([^)]+)\)", README))))
def test_a_section_that_the_guide_links_exists(target: str) -> None:
    path, _, anchor = target.partition("#")
    linked = FOLDER / path if path else FOLDER / "README.md"
    assert linked.is_file()
    assert not anchor or anchor in anchors(linked.read_text(encoding="utf-8"))


def test_sections_that_sources_name_exist() -> None:
    sources = [*(ROOT / "python").rglob("*.py"), *(ROOT / "plugins").glob("*/src/**/*.py")]
    named = {
        section: path.name
        for path in sources
        for section in re.findall(r"benchmarks/README\.md#([\w-]+)", path.read_text(encoding="utf-8"))
    }
    assert named
    assert named.keys() <= anchors(README), named


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_benchmarks_that_other_guides_name_exist(guide: Path) -> None:
    text = guide.read_text(encoding="utf-8")
    assert set(re.findall(r"benchmarks/README\.md#([\w-]+)", text)) <= anchors(README)
    scripts = re.findall(r"benchmarks/(\w+\.py)", text)
    assert [name for name in scripts if not (FOLDER / name).is_file()] == []


@pytest.mark.parametrize("script", sorted(FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_a_script_takes_only_what_palpate_has(script: Path) -> None:
    tree = ast.parse(script.read_text(encoding="utf-8"))
    taken = (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom))
    missing = [
        f"{node.module}.{each.name}"
        for node in taken
        if (node.module or "").startswith("palpate")
        for each in node.names
        if not hasattr(import_module(str(node.module)), each.name)
        and find_spec(f"{node.module}.{each.name}") is None
    ]
    assert missing == []
