"""The method's terms, explained."""

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files

from palpate.errors import PalpateError
from palpate.plugins.registry import suggestion


class UnknownTermError(PalpateError, KeyError):
    """The glossary has no such term."""

    __str__ = Exception.__str__  # a KeyError would print its message quoted


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """One term.

    Parameters
    ----------
    name, text : str
    aliases : sequence of str
        Other words that find it.
    see : sequence of str
        Files of the source, and commands.
    """

    name: str
    text: str
    aliases: Sequence[str] = ()
    see: Sequence[str] = ()


class Glossary(Mapping[str, Term]):
    """Terms by name, in reading order; looked up by any of their words in any case."""

    def __init__(self, terms: Mapping[str, Term]) -> None:
        self._terms = dict(terms)
        self._names = {_plain(word): name for name, term in terms.items() for word in (name, *term.aliases)}

    @classmethod
    def load(cls) -> "Glossary":
        """Read the terms that palpate carries."""
        raw = tomllib.loads((files("palpate.cli") / "glossary.toml").read_text(encoding="utf-8"))
        return cls({name: Term(name=name, **entry) for name, entry in raw.items()})

    def __getitem__(self, word: str) -> Term:
        try:
            return self._terms[self._names[_plain(word)]]
        except KeyError:
            close = self._where(_plain(word)) or suggestion(_plain(word), self._names)
            known = ", ".join(self._terms)
            raise UnknownTermError(f"no term '{word}'{close} (known: {known})") from None

    def _where(self, word: str) -> str:
        """Text that names the terms whose text has the word, or is empty."""
        used = [t.name for t in self._terms.values() if word in re.findall(r"[\w']+", t.text.casefold())]
        return f"; the word is in the text of {', '.join(used[:3])}" if used else ""

    def __iter__(self) -> Iterator[str]:
        return iter(self._terms)

    def __len__(self) -> int:
        return len(self._terms)


def _plain(word: str) -> str:
    return " ".join(word.replace("_", " ").replace("-", " ").casefold().split())
