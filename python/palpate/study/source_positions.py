"""Where each key of a TOML file stands, so that a message can name its line.

``tomllib`` reads values and forgets lines. This walks a text that ``tomllib``
has accepted, so it needs to find keys and skip values, not to judge them.
"""

import re
from bisect import bisect_left
from collections.abc import Iterator

Key = tuple[str | int, ...]
"""Path to a value: table names, keys, and positions in arrays (from 0)."""

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SCALAR = re.compile(r"[^,\]\}\n#]*")
_QUOTES = ('"""', "'''", '"', "'")


class KeyLines:
    """Lines of the keys of one TOML text.

    Parameters
    ----------
    text : str
        Valid TOML.
    """

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
    """One pass over the text; ``at`` is the position of the next character."""

    def __init__(self, text: str, lines: dict[Key, int]) -> None:
        self.text = text
        self.lines = lines
        self.ends = [match.start() for match in re.finditer("\n", text)]
        self.at = 0
        self.n_tables: dict[Key, int] = {}

    def document(self) -> None:
        table: Key = ()
        self.skip()
        while self.at < len(self.text):
            table = self.header() if self.text[self.at] == "[" else self.pair(table)
            self.skip()

    def header(self) -> Key:
        array = self.text.startswith("[[", self.at)
        start = self.at
        self.at += 2 if array else 1
        key = self.inside(tuple(self.key()), start, array=array)
        self.skip_to("]")
        self.at += 2 if array else 1
        return key

    def inside(self, names: tuple[str, ...], start: int, *, array: bool) -> Key:
        """Full key of a header: an array of tables on the way means its latest table."""
        key: Key = ()
        for depth, name in enumerate(names, start=1):
            key = (*key, name)
            self.mark(key, start)
            if array and depth == len(names):
                self.n_tables[key] = self.n_tables.get(key, 0) + 1
            if key in self.n_tables:
                key = (*key, self.n_tables[key] - 1)
                self.mark(key, start)
        return key

    def pair(self, table: Key) -> Key:
        start = self.at
        key = table
        for name in self.key():
            key = (*key, name)
            self.mark(key, start)
        self.skip_to("=")
        self.at += 1
        self.value(key)
        return table

    def key(self) -> Iterator[str]:
        """Names of a dotted key; ends before what follows it."""
        while True:
            self.skip()
            if self.text[self.at] in "\"'":
                yield self.string()
            else:
                match = _BARE.match(self.text, self.at)
                assert match is not None, f"no key at {self.at}"
                self.at = match.end()
                yield match.group()
            self.skip()
            if self.text[self.at] != ".":
                return
            self.at += 1

    def value(self, key: Key) -> None:
        self.skip()
        self.mark(key, self.at)
        match self.text[self.at]:
            case "[":
                self.items(key)
            case "{":
                self.inline_table(key)
            case '"' | "'":
                self.string()
            case _:
                self.at = self.end(_SCALAR)

    def items(self, key: Key) -> None:
        self.at += 1
        n_items = 0
        while self.next_item("]"):
            self.value((*key, n_items))
            n_items += 1

    def inline_table(self, key: Key) -> None:
        self.at += 1
        while self.next_item("}"):
            self.pair(key)

    def next_item(self, closing: str) -> bool:
        """Step to the next item of an array or inline table, or past its end."""
        self.skip()
        if self.text[self.at] == ",":
            self.at += 1
            self.skip()
        if self.text[self.at] == closing:
            self.at += 1
            return False
        return True

    def string(self) -> str:
        quote = next(q for q in _QUOTES if self.text.startswith(q, self.at))
        start = self.at = self.at + len(quote)
        while not self.text.startswith(quote, self.at):
            self.at += 2 if quote[0] == '"' and self.text[self.at] == "\\" else 1
        content = self.text[start : self.at]
        self.at += len(quote)
        while len(quote) == 3 and self.text.startswith(quote[0], self.at):
            self.at += 1  # a long string may end in one or two quotes of its own
        return content

    def skip(self) -> None:
        self.at = self.end(_BLANK)

    def skip_to(self, mark: str) -> None:
        self.at = self.text.index(mark, self.at)

    def end(self, pattern: re.Pattern[str]) -> int:
        match = pattern.match(self.text, self.at)
        return match.end() if match else self.at

    def mark(self, key: Key, at: int) -> None:
        self.lines.setdefault(key, bisect_left(self.ends, at) + 1)
