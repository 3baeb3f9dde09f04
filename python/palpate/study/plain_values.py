"""Limits on the plain values of a file that people write: how many, how deep, how long.

Whatever is within them is handled in moments, fits a file name or a double, and
can be printed and written again.
"""

import re
from collections.abc import Iterator, Mapping

from palpate.study.source_positions import Key, dotted

MOST_BYTES = 1_000_000
MOST_VALUES = 50_000
DEEPEST = 16
LONGEST_TEXT = 10_000
LONGEST_KEY = 200
LARGEST_INTEGER = 2**63 - 1
MOST_SETS = 100_000
MOST_NAMED = 100
"""Spots, regions or scenarios."""
MOST_FILES = 1_000
MOST_SIMULATIONS = 1_000_000


_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")
"""A character that breaks file names, terminals or UTF-8."""


def check_plain(value: object) -> None:
    """Refuse values that are too many, too deep, too long, or that no terminal and no file takes.

    They are tables, lists, texts and numbers, as read from TOML or JSON. A ValueError names place and limit.
    """
    n_values = 0
    waiting: list[tuple[Key, object]] = [((), value)]
    while waiting:
        key, each = waiting.pop()
        n_values += 1
        if n_values > MOST_VALUES:
            raise ValueError(
                f"more than {MOST_VALUES} values; keep what is not a setting in files of its own"
            )
        if len(key) > DEEPEST:
            raise ValueError(f"{dotted(key[:2])} is nested more than {DEEPEST} deep; make it flatter")
        if problem := _problem(key, each):
            raise ValueError(problem)
        waiting.extend(_inside(key, each))


def _problem(key: Key, value: object) -> str:
    name = str(key[-1]) if key else ""
    if len(name) > LONGEST_KEY:
        return f"the key '{name[:40]}…' has more than {LONGEST_KEY} characters; shorten it"
    for text in (name, value):
        if isinstance(text, str) and (found := _CONTROL.search(text)):
            code = f"U+{ord(found[0]):04X}"
            return f"{dotted(key)!r}: the control character {code} in {text[:40]!r}; remove it"
    if isinstance(value, str) and len(value) > LONGEST_TEXT:
        return f"{dotted(key)}: a text of more than {LONGEST_TEXT} characters; shorten it"
    if isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        return f"{dotted(key)}: a whole number beyond ±{LARGEST_INTEGER}; write a smaller one"
    return ""


def _inside(key: Key, value: object) -> Iterator[tuple[Key, object]]:
    if isinstance(value, Mapping):
        yield from (((*key, str(name)), each) for name, each in value.items())
    elif isinstance(value, list):
        yield from (((*key, place), each) for place, each in enumerate(value))
