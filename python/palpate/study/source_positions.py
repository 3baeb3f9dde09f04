"""Line of each key of a TOML file, so that a message can name it.

``tomllib`` reads values and forgets lines. This walks a text that ``tomllib``
has accepted, so it needs to find keys and skip values, not to check them.
"""

import re

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
