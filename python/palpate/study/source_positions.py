"""Line of each key of a TOML file, so that a message can name it.

``tomllib`` reads values and forgets lines. This walks a text that ``tomllib``
has accepted, so it needs to find keys and skip values, not to check them.
"""

import re
from collections.abc import Mapping

Key = tuple[str | int, ...]
"""Path to a value: table names, keys, and positions in arrays (from 0)."""

_TOKEN = re.compile(
    r'"""(?:[^\\]|\\.)*?"{3,5}(?!")'
    r"|'''.*?'{3,5}(?!')"  # may end in one or two quotes of its own
    r'|"(?:[^"\\]|\\.)*"'
    r"|'[^']*'"
    r"|(?P<comment>#[^\n]*)"
    r"|[\[\]{}=,.\n]"
    r"""|[^\s\[\]{}=,."'#]+""",
    re.DOTALL,
)
_END_OF_SCALAR = frozenset({",", "]", "}", "\n", ""})


class KeyLines:
    """Lines of the keys of one text, which is valid TOML."""

    def __init__(self, text: str) -> None:
        self._lines: dict[Key, int] = {(): 1}
        _Walk(text, self._lines).document()

    def line(self, key: Key) -> int:
        """Line (from 1) of ``key``, or of the nearest table or array around it that is written."""
        while key not in self._lines:
            key = key[:-1]
        return self._lines[key]


def dotted(key: Key) -> str:
    """``("spot", 0, "mesh")`` as ``spot[0].mesh``."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in key)
    return text.removeprefix(".")


class _Walk:
    """One pass over the tokens; ``at`` is the number of the next."""

    def __init__(self, text: str, lines: dict[Key, int]) -> None:
        self.lines = lines
        self.tokens: list[str] = []
        self.token_lines: list[int] = []
        self.at = 0
        self.n_tables: dict[Key, int] = {}
        line = 1
        for match in _TOKEN.finditer(text):
            if not match["comment"]:
                self.tokens.append(match[0])
                self.token_lines.append(line)
            line += match[0].count("\n")
        self.tokens.append("")

    def document(self) -> None:
        table: Key = ()
        while token := self.next():
            if token == "[":
                table = self.header()
            else:
                self.pair(table)

    def next(self) -> str:
        """Return the next token that is no end of a line, without passing it; empty at the end."""
        while self.tokens[self.at] == "\n":
            self.at += 1
        return self.tokens[self.at]

    def header(self) -> Key:
        """Read the header of a table; an array of tables on the way means its latest table."""
        line = self.token_lines[self.at]
        is_array = self.tokens[self.at + 1] == "["
        self.at += 1 + is_array
        names = self.key("]")
        self.at += is_array
        key: Key = ()
        for depth, name in enumerate(names, start=1):
            key = (*key, name)
            self.lines.setdefault(key, line)
            if is_array and depth == len(names):
                self.n_tables[key] = self.n_tables.get(key, 0) + 1
            if key in self.n_tables:
                key = (*key, self.n_tables[key] - 1)
                self.lines.setdefault(key, line)
        return key

    def key(self, end: str) -> list[str]:
        """Names of a dotted key, and past the token that ends it."""
        first, self.at = self.at, self.tokens.index(end, self.at) + 1
        names = [token for token in self.tokens[first : self.at - 1] if token != "."]
        return [name[1:-1] if name[0] in "\"'" else name for name in names]

    def pair(self, key: Key) -> None:
        line = self.token_lines[self.at]
        for name in self.key("="):
            key = (*key, name)
            self.lines.setdefault(key, line)
        self.value(key)

    def value(self, key: Key) -> None:
        token = self.next()
        self.lines.setdefault(key, self.token_lines[self.at])
        if token == "[":
            n_items = 0
            while self.has_item("]"):
                self.value((*key, n_items))
                n_items += 1
        elif token == "{":
            while self.has_item("}"):
                self.pair(key)
        else:
            while self.tokens[self.at] not in _END_OF_SCALAR:
                self.at += 1

    def has_item(self, closing: str) -> bool:
        """Step into an array or inline table, to its next item, or past its end."""
        if self.next() != closing:
            self.at += 1
        is_over = self.next() == closing
        self.at += is_over
        return not is_over


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
        if isinstance(each, Mapping):
            waiting += [((*key, str(name)), inner) for name, inner in each.items()]
        elif isinstance(each, list):
            waiting += [((*key, place), inner) for place, inner in enumerate(each)]


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
