"""Study files with one more press: what was written by hand stays as it is."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import tomlkit
from tomlkit.items import AoT

from palpate.errors import StudyError


@dataclass(frozen=True, slots=True, kw_only=True)
class AddedPress:
    """A press that a study gets: the spot once more under another name.

    Parameters
    ----------
    name : str
        What the press is called: a name that no spot has.
    spot : str
        Where the press is.
    protocol : mapping
        Keys of ``[spot.protocol]``: what is done otherwise than in ``[protocol]``.
    measured : str
        File of its measured curves, relative to the study file.
    """

    name: str
    spot: str
    protocol: Mapping[str, Any]
    measured: str


def with_presses(text: str, presses: Iterable[AddedPress]) -> str:
    """Add presses to the text (TOML) of a study.

    Raises
    ------
    StudyError
        There is no such spot, or one of that name.
    """
    document = tomlkit.parse(text)
    tables = document.get("spot", [])
    known = {str(table.get("name")): table.unwrap() for table in tables}
    names = set(known)
    for press in presses:
        if press.spot not in known:
            raise StudyError(f"no spot '{press.spot}' (known: {', '.join(known)}); correct the name")
        if press.name in names:
            raise StudyError(f"a spot '{press.name}' already exists; give the press another name")
        names.add(press.name)
        like = known[press.spot]
        own = {**like.get("protocol", {}), **press.protocol}
        added = {**like, "name": press.name, "measured": press.measured, **({"protocol": own} if own else {})}
        tables.append(_table(added) if isinstance(tables, AoT) else tomlkit.item(added, _parent=tables))
    return tomlkit.dumps(document)


def _table(values: Mapping[str, Any]) -> tomlkit.items.Table:
    table = tomlkit.table()
    for key, value in values.items():
        table.add(key, _inline(value) if isinstance(value, dict) else value)
    return table


def _inline(values: Mapping[str, Any]) -> tomlkit.items.InlineTable:
    table = tomlkit.inline_table()
    for key, value in values.items():
        table.append(key, _inline(value) if isinstance(value, dict) else value)
    return table
