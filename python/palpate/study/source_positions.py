"""Line of each key of a TOML file, which ``tomllib`` forgets, and values that no file or terminal takes."""

import re
from collections import Counter
from collections.abc import Mapping

Key = tuple[str | int, ...]
"""Path to a value: table names, keys, and positions in arrays (from 0)."""

_LONG_TEXT = re.compile(r'"""(?:[^\\]|\\.)*?"{3,5}(?!")' + r"|'''.*?'{3,5}(?!')", re.DOTALL)
_NAME = r"""(?:[\w-]+|"[^"]*"|'[^']*')"""
_NAMES = rf"\s*(?P<names>{_NAME}(?:\s*\.\s*{_NAME})*)\s*"
_HEADER = re.compile(rf"\s*\[(?P<array>\[?){_NAMES}\]\]?\s*(?:#.*)?")
_PAIR = re.compile(rf"{_NAMES}=")


class KeyLines:
    """Lines of the keys of one text, which is valid TOML."""

    def __init__(self, text: str) -> None:
        self._lines: dict[Key, int] = {(): 1}
        self._n_tables: Counter[Key] = Counter()
        table: Key = ()
        plain = _LONG_TEXT.sub(lambda found: "\n" * found[0].count("\n"), text)
        for number, line in enumerate(plain.splitlines(), start=1):
            if header := _HEADER.fullmatch(line):
                table = self._note((), header["names"], number, is_array=bool(header["array"]))
            elif pair := _PAIR.match(line):
                self._note(table, pair["names"], number)

    def _note(self, key: Key, names: str, number: int, *, is_array: bool = False) -> Key:
        """Note where a dotted key is; an array of tables on the way means its latest table."""
        parts = [name.strip("\"'") for name in re.findall(_NAME, names)]
        for depth, name in enumerate(parts, start=1):
            key = (*key, name)
            self._lines.setdefault(key, number)
            self._n_tables[key] += is_array and depth == len(parts)
            if self._n_tables[key]:
                key = (*key, self._n_tables[key] - 1)
                self._lines.setdefault(key, number)
        return key

    def line(self, key: Key) -> int:
        """Line (from 1) of ``key``, or of the nearest table or key around it that begins a line."""
        while key not in self._lines:
            key = key[:-1]
        return self._lines[key]


def dotted(key: Key) -> str:
    """``("spot", 0, "mesh")`` as ``spot[0].mesh``."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in key)
    return text.removeprefix(".")


LARGEST_INTEGER = 2**63 - 1
MOST_SETS = 100_000
MOST_SIMULATIONS = 1_000_000

_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")
"""A character that breaks file names, terminals or UTF-8."""


def check_plain(value: object, key: Key = ()) -> None:
    """Refuse control characters and huge integers in tables and lists, as read from TOML or JSON.

    A ValueError names the place.
    """
    if isinstance(value, str) and (found := _CONTROL.search(value)):
        code = f"U+{ord(found[0]):04X}"
        raise ValueError(f"{dotted(key)!r}: the control character {code} in {value[:40]!r}; remove it")
    if isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        raise ValueError(f"{dotted(key)}: a whole number beyond ±{LARGEST_INTEGER}; write a smaller one")
    if isinstance(value, Mapping):
        for name, inner in value.items():
            check_plain(str(name), key)
            check_plain(inner, (*key, str(name)))
    elif isinstance(value, list):
        for place, inner in enumerate(value):
            check_plain(inner, (*key, place))
