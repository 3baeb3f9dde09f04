"""The verdict on a value in words, and the mark that goes with it."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from palpate.api.fit import UNCLEAR

REFUSED, AT_END, TIED, NOT = "refused", "end of range", "tied", "not identified"
"""Words of a verdict besides those of :data:`palpate.stages.identifiability.WORDS`."""

MARKS: Mapping[str, tuple[tuple[str, ...], str]] = MappingProxyType(
    {
        "†": (
            ("poorly", NOT, UNCLEAR, REFUSED),
            "poorly or not identified, unclear, or refused: not a result",
        ),
        "‡": ((AT_END,), "at an end of the range that was searched"),
    }
)
"""The words that each mark is put at, and what it means."""


def verdict_of(word: str, *, at_bound: bool = False, is_refused: bool = False) -> str:
    """What may be read of a value whose identifiability has this word."""
    words = (REFUSED if is_refused else NOT if word == "not" else word, AT_END if at_bound else "")
    return ", ".join(each for each in words if each)


def mark_of(verdict: str) -> str:
    """Marks of a value with this verdict; empty where it is a result."""
    words = verdict.split(", ")
    return "".join(mark for mark, (at, _) in MARKS.items() if any(word in at for word in words))


def explained(marks: Iterable[str]) -> str:
    """Sentence on the marks that occur; empty where none does."""
    seen = set("".join(marks))
    texts = [f"{mark} {meaning}" for mark, (_, meaning) in MARKS.items() if mark in seen]
    return f"{'; '.join(texts)}." if texts else ""
