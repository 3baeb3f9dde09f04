"""Study files with one more press: what was written by hand stays as it is."""

from collections.abc import Mapping
from typing import Any

import tomlkit
from tomlkit.items import AoT

from palpate.errors import StudyError


def with_press(text: str, spot: str, name: str, protocol: Mapping[str, Any], measured: str) -> str:
    """Add a press at a spot to the text of a study: the spot once more under another name.

    Parameters
    ----------
    text : str
        TOML of a study.
    spot : str
        Where the press is.
    name : str
        What the press is called: a name that no spot has.
    protocol : mapping
        Keys of ``[spot.protocol]``: what is done otherwise than in ``[protocol]``.
    measured : str
        File of its measured curves, relative to the study file.

    Raises
    ------
    StudyError
        There is no such spot, or one of that name.
    """
    document = tomlkit.parse(text)
    tables = document.get("spot", [])
    names = [str(table.get("name")) for table in tables]
    if spot not in names:
        raise StudyError(f"no spot '{spot}' (known: {', '.join(names)}); correct the name")
    if name in names:
        raise StudyError(f"a spot '{name}' already exists; give the press another name")
    like = tables[names.index(spot)].unwrap()
    own = {**like.get("protocol", {}), **protocol}
    added = {**like, "name": name, "measured": measured, **({"protocol": own} if own else {})}
    if isinstance(tables, AoT):
        tables.append(_table(added))
    else:
        tables.append(tomlkit.item(added, _parent=tables))
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
