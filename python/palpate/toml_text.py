"""Text of values in TOML, as the tables of a study have them."""

import json
import re
from collections.abc import Mapping
from typing import Any

MARK, ASKED = "CHANGE THIS", "answer first"
"""Words of a written study next to a copied value, and before a question that `inspect` and `init` repeat."""


def toml_value(value: object) -> str:
    """Text of a value in TOML, on one line."""
    match value:
        case Mapping():
            return (
                f"{{ {', '.join(f'{toml_key(key)} = {toml_value(each)}' for key, each in value.items())} }}"
            )
        case list() | tuple():
            return f"[{', '.join(map(toml_value, value))}]"
        case _:
            return json.dumps(value, ensure_ascii=False)


def toml_key(name: str) -> str:
    """Text of a key in TOML, in quotes where its characters ask for them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def toml_document(tables: Mapping[str, Any]) -> str:
    """Text of a TOML file: its tables one below the other, each value on one line."""
    heads = [
        (f"[[{toml_key(name)}]]" if isinstance(value, list) else f"[{toml_key(name)}]", each)
        for name, value in tables.items()
        for each in (value if isinstance(value, list) else [value])
    ]
    return "\n".join(
        "\n".join([head, *(f"{toml_key(key)} = {toml_value(value)}" for key, value in table.items()), ""])
        for head, table in heads
    )
