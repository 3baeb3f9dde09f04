"""Words of the guides: short sentences, the thing named again, the field's words.

``python tests/docs/test_texts.py`` prints the counts of each guide.
"""

import ast
import re
import shlex
import tomllib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from palpate.answer.words import UNCLEAR, WORDS
from palpate.cli.app import build_app
from palpate.cli.stages import add_stage
from palpate.plugins.registry import add_commands
from palpate_report.answer.next_step import CAUSES
from palpate_report.answer.warnings import kinds

ROOT = Path(__file__).parents[2]
GUIDES = sorted((ROOT / "docs").glob("*.md"))
TERMS = tomllib.loads((ROOT / "docs" / "site" / "glossary.toml").read_text(encoding="utf-8"))
LONGEST_LINE = 160
LONGEST_SENTENCE = 30
MOST_WORDS = 1500
MOST_WORDS_OF_ALL = 23_500
MOST_PRONOUNS = 10
MOST_WHAT_CLAUSES = 5
LEAST_PICTURES = 30
UNNAMED = r"\b(?:that|those) of\b|\bwhat\b(?! to (?:do|try))"
"""Words in place of a noun."""
ON_THE_PAGE = (
    "95 % interval",
    "Fopt",
    "NMSE",
    "R²",
    "end of range",
    "generalised set",
    "held out",
    "initial shear modulus",
    "true value",
    "most correlated with",
    "relative width",
    "scenario",
    "unfitted",
    "verdict",
)
"""Words of heads, captions and rows of the page."""


def prose(path: Path) -> str:
    """Text without blocks of code and comments."""
    text = re.sub(r"```.*?```|<!--.*?-->", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    return "\n".join(line for line in text.splitlines() if not line.startswith("    "))


def sentences(path: Path) -> Iterator[str]:
    """Sentences of text, lists and cells; code and links are one word each."""
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", prose(path))
    text = re.sub(r"`[^`\n]+`", "code", text)
    text = re.sub(r"\n(?=\s*(?:[-*#>|]|\d+\.)\s?)", "\n\n", text)
    for block in re.split(r"\n\s*\n|\|", text):
        for sentence in re.split(
            r"(?<=[.?!])[*”\"]*\s+(?=[A-Z*`\[“(]|code|palpate)", " ".join(block.split())
        ):
            if re.search(r"\w", sentence):
                yield sentence


def count(path: Path) -> dict[str, int]:
    """Numbers that the rules limit."""
    found = list(sentences(path))
    return {
        "words": len(re.findall(r"\S*\w\S*", path.read_text(encoding="utf-8"))),
        "that/those of": sum(
            len(re.findall(r"\b(?:that|those) of\b", each, re.IGNORECASE)) for each in found
        ),
        "what-clauses": sum(
            len(re.findall(r"\bwhat\b(?! to do)", each, re.IGNORECASE)) for each in found if "?" not in each
        ),
        "long sentences": len(too_long(path)),
        "retired words": len(retired(path)),
        "pictures": len(re.findall(r"!\[[^\]]+\]\([^)]+\)", path.read_text(encoding="utf-8"))),
    }


def too_long(path: Path) -> list[str]:
    return [
        each
        for each in sentences(path)
        if len(re.findall(r"[\w°%]+(?:[.,'’/·−-]\w+)*", each)) > LONGEST_SENTENCE
    ]


def retired(path: Path) -> list[str]:
    avoided = [word for term in TERMS.values() for word in term.get("avoid", ())]
    found = re.findall(
        rf"\b(?:{'|'.join(map(re.escape, avoided))})\b", " ".join(sentences(path)), re.IGNORECASE
    )
    return sorted(set(found))


def text_lines(path: Path) -> list[str]:
    """Running text: neither tables, which cannot be broken, nor code."""
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    return [line for line in text.splitlines() if not line.startswith(("|", "    "))]


@pytest.mark.parametrize(
    "path",
    [*GUIDES, *sorted(ROOT.glob("*.md")), ROOT / "plugins" / "README.md"],
    ids=lambda path: path.relative_to(ROOT).as_posix(),
)
def test_lines_of_text_are_short(path: Path) -> None:
    assert [line for line in text_lines(path) if len(line) > LONGEST_LINE] == []


@pytest.mark.parametrize("path", GUIDES, ids=lambda path: path.stem)
def test_a_guide_is_short_and_has_a_picture(path: Path) -> None:
    assert too_long(path) == []
    assert retired(path) == []
    found = count(path)
    assert found["words"] <= MOST_WORDS
    assert found["that/those of"] <= 1
    assert found["what-clauses"] <= 1
    assert found["pictures"] >= 1


@pytest.mark.parametrize("name", ["README.md", "plugins/README.md"])
def test_a_first_page_has_short_sentences(name: str) -> None:
    found = count(ROOT / name)
    assert too_long(ROOT / name) == []
    assert (found["that/those of"], found["what-clauses"], found["retired words"]) == (0, 0, 0)


def test_the_guides_together_keep_the_limits() -> None:
    found = [count(path) for path in GUIDES]
    assert sum(each["that/those of"] for each in found) <= MOST_PRONOUNS
    assert sum(each["what-clauses"] for each in found) <= MOST_WHAT_CLAUSES
    assert sum(each["words"] for each in found) <= MOST_WORDS_OF_ALL
    assert sum(each["pictures"] for each in found) >= LEAST_PICTURES


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("The error is that of the mesh.", {"that/those of": 1}),
        ("State what is wrong. What is wrong?", {"what-clauses": 1}),
        ("word " * 31 + ".", {"long sentences": 1}),
        ("word " * 20 + ".\n- " + "word " * 20, {"long sentences": 0}),
        ("A proof of it.", {"retired words": 1}),
        (
            "```\nthat of what\n```\n\n    what of that\n\n![a picture](x.png)",
            {"pictures": 1, "what-clauses": 0},
        ),
    ],
)
def test_the_counts_are_right(tmp_path: Path, text: str, expected: dict[str, int]) -> None:
    path = tmp_path / "guide.md"
    path.write_text(text, encoding="utf-8")
    found = count(path)
    assert {key: found[key] for key in expected} == expected


def words() -> set[str]:
    """Terms of the glossary and their aliases."""
    return {*TERMS, *(alias for term in TERMS.values() for alias in term.get("aliases", ()))}


def test_words_of_the_page_are_in_the_glossary() -> None:
    plugins = (ROOT / "plugins" / name / "src" for name in ("palpate-report", "palpate-certainty"))
    folders = (*plugins, ROOT / "python" / "palpate" / "answer")
    sources = (file for folder in folders for file in folder.rglob("*.py"))
    page = " ".join("\n".join(path.read_text(encoding="utf-8") for path in sources).replace("_", " ").split())
    assert [word for word in ON_THE_PAGE if word not in page] == [], "no longer on the page"
    wanted = {*ON_THE_PAGE, *(word for _, word in WORDS), UNCLEAR, *CAUSES.values()}
    assert sorted(wanted - words()) == []


def messages(source: str) -> Iterator[str]:
    """Strings of a program that are no docstrings; a value in one is …."""
    nodes = list(ast.walk(ast.parse(source)))
    joined = [node for node in nodes if isinstance(node, ast.JoinedStr)]
    seen = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    seen |= {id(part) for node in joined for part in node.values}
    for node in joined:
        yield "".join(str(part.value) if isinstance(part, ast.Constant) else "…" for part in node.values)
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in seen:
            yield node.value


def test_messages_name_the_thing_again() -> None:
    files = (file for of in ("python/palpate", "plugins/*/src") for file in ROOT.glob(f"{of}/**/*.py"))
    found = [
        f"{file.relative_to(ROOT)}: {text}"
        for file in files
        if "testing" not in file.parts and file.stem != "testing"
        for text in messages(file.read_text(encoding="utf-8"))
        if " " in text and "?" not in text and re.search(UNNAMED, text, re.IGNORECASE)
    ]
    assert found == []


def help_texts(command: Any, path: str = "palpate") -> Iterator[str]:
    """Help of a command, of its options and of its own commands."""
    for text in (command.help, command.epilog, *(getattr(each, "help", "") for each in command.params)):
        yield f"{path}: {text or ''}"
    for name, below in getattr(command, "commands", {}).items():
        yield from help_texts(below, f"{path} {name}")


def test_help_names_the_thing_again() -> None:
    app = build_app()
    add_commands(app, add_stage=partial(add_stage, app, "Stages"))
    found = list(help_texts(get_command(app)))
    assert len(found) > 100
    assert [text for text in found if "?" not in text and re.search(UNNAMED, text, re.IGNORECASE)] == []


def commands_of_messages() -> Iterator[tuple[str, str]]:
    """File and command of each message that names one, and of each next step; a value is …."""
    files = [file for of in ("python/palpate", "plugins/*/src") for file in ROOT.glob(f"{of}/**/*.py")]
    texts = [(code, " ".join(entry.values())) for code, entry in kinds().items()]
    for file in files:
        source = file.read_text(encoding="utf-8")
        texts += [(file.stem, text) for text in messages(source)]
        for call in ast.walk(ast.parse(source)):
            if isinstance(call, ast.Call) and ast.unparse(call.func).endswith("session.next"):
                texts += [(file.stem, f"`palpate {text}`") for text in messages(ast.unparse(call.args[0]))]
    for where, text in texts:
        yield from ((where, command) for command in re.findall(r"`palpate ([\w…{][^`]*)`", text))


def parsed(group: Any, words: list[str]) -> None:
    """Parse a command as palpate does; the error of the parser where it cannot."""
    parent, command, name, rest = None, group, "palpate", words
    while hasattr(command, "commands"):
        parent = command.make_context(name, list(rest), parent=parent, resilient_parsing=True)
        name, command, rest = command.resolve_command(parent, [*parent._protected_args, *parent.args])
    command.make_context(name, list(rest), parent=parent)


def test_every_command_of_a_message_is_one_that_palpate_understands() -> None:
    app = build_app()
    add_commands(app, add_stage=partial(add_stage, app, "Stages"))
    group, refused = get_command(app), []
    commands = {*getattr(group, "commands", {}), "arm", "COMMAND", "--help"}
    found = dict.fromkeys(commands_of_messages())
    assert len(found) > 50
    for where, text in found:
        text = re.sub(r"…+|\{\{?\w+\}?\}", "arm", text.removeprefix("{plugins}"))
        text = text.replace("SCAN", "scan.ply").replace("MESH", "limb.inp")
        name, *rest = shlex.split(text)
        if not rest and name in commands:  # a command may be named without its folder
            continue
        try:  # the name of a stage may be a value
            parsed(group, ["fit" if name in ("arm", "NAME", "COMMAND") else name, *rest])
        except Exception as error:  # of whichever click typer carries
            refused.append(f"{where}: palpate {text}: {error}")
    assert not refused, "\n".join(refused)


def values_in_commands(source: str) -> Iterator[str]:
    """Values, as their code, that an f-string puts into a command."""
    for node in ast.walk(ast.parse(source)):
        text = ""
        for part in node.values if isinstance(node, ast.JoinedStr) else ():
            if isinstance(part, ast.FormattedValue) and re.search(r"[`:] ?palpate [^`]*$", text):
                yield ast.unparse(part.value)
            text += str(part.value) if isinstance(part, ast.Constant) else "…"


def test_a_path_in_a_command_of_a_message_can_be_pasted() -> None:
    files = [file for of in ("python/palpate", "plugins/*/src") for file in ROOT.glob(f"{of}/**/*.py")]
    found = [(file.name, value) for file in files for value in values_in_commands(file.read_text())]
    assert sum(value.startswith("typed(") for _, value in found) > 10
    path = re.compile(r"(?:.*\.)?(?:folder|file|path|run|now)(?:\.name)?")
    assert [(name, value) for name, value in found if path.fullmatch(value)] == []


def test_no_word_is_both_a_term_and_retired() -> None:
    assert {word for term in TERMS.values() for word in term.get("avoid", ())} & words() == set()


def test_what_the_glossary_names_is_there() -> None:
    for term, entry in TERMS.items():
        for named in entry["see"]:
            if named.startswith("the term "):
                assert named.removeprefix("the term ") in TERMS, term
            elif not named.startswith("palpate "):
                assert (ROOT / named).is_file(), term


if __name__ == "__main__":
    rows = {path.stem: count(path) for path in GUIDES}
    rows["all"] = {key: sum(row[key] for row in rows.values()) for key in next(iter(rows.values()))}
    for name, row in rows.items():
        print(f"{name:16}", *(f"{value:6} {key}" for key, value in row.items()))  # noqa: T201
