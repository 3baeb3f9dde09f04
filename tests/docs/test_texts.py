"""Lines of the guides, and words of the page in the glossary."""

import re
import tomllib
from pathlib import Path

import pytest

from palpate.stages.identifiability import UNCLEAR, WORDS
from palpate_report.next_step import CAUSES

ROOT = Path(__file__).parents[2]
LONGEST = 160
TERMS = tomllib.loads((ROOT / "docs" / "site" / "glossary.toml").read_text(encoding="utf-8"))
ON_THE_PAGE = (
    "95 % interval",
    "Fopt",
    "NMSE",
    "R²",
    "end of range",
    "generalised set",
    "held out",
    "initial shear modulus",
    "known answer",
    "most correlated with",
    "relative width",
    "scenario",
    "unfitted",
    "verdict",
)
"""Words of heads, captions and rows of the page."""


def text_lines(path: Path) -> list[str]:
    """Running text: neither tables, which cannot be broken, nor code."""
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    return [line for line in text.splitlines() if not line.startswith(("|", "    "))]


@pytest.mark.parametrize(
    "path",
    [*sorted((ROOT / "docs").glob("*.md")), *sorted(ROOT.glob("*.md")), ROOT / "plugins" / "README.md"],
    ids=lambda path: path.relative_to(ROOT).as_posix(),
)
def test_lines_of_text_are_short(path: Path) -> None:
    assert [line for line in text_lines(path) if len(line) > LONGEST] == []


def words() -> set[str]:
    """Terms of the glossary and their aliases."""
    return {*TERMS, *(alias for term in TERMS.values() for alias in term.get("aliases", ()))}


def test_words_of_the_page_are_in_the_glossary() -> None:
    plugins = (ROOT / "plugins" / name / "src" for name in ("palpate-report", "palpate-certainty"))
    sources = (file for folder in plugins for file in folder.rglob("*.py"))
    page = " ".join("\n".join(path.read_text(encoding="utf-8") for path in sources).replace("_", " ").split())
    assert [word for word in ON_THE_PAGE if word not in page] == [], "no longer on the page"
    wanted = {*ON_THE_PAGE, *(word for _, word in WORDS), UNCLEAR, *CAUSES.values()}
    assert sorted(wanted - words()) == []


def test_what_the_glossary_names_is_there() -> None:
    for term, entry in TERMS.items():
        for named in entry["see"]:
            if named.startswith("the term "):
                assert named.removeprefix("the term ") in TERMS, term
            elif not named.startswith("palpate "):
                assert (ROOT / named).is_file(), term
