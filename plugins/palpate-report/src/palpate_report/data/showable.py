"""Blocks of a section as the page can show them."""

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.api import Component, PluginError
from palpate.api.report import Block, Choice, Drawing, Figure, Fold, Lines, Listing, Picture, Table, Word


def is_own(section: type[Component[Any]]) -> bool:
    """True if a section is the page's own, of palpate-report."""
    return section.__module__.startswith("palpate_report.")


def checked(section: Component[Any], blocks: Iterable[Block]) -> tuple[Block, ...]:
    """Blocks of a section, each of them as it can be shown.

    Raises
    ------
    PluginError
        One of them is no block, or cannot be shown.
    """
    return tuple(_checked(section, block) for block in blocks)


def _checked(section: Component[Any], block: Block) -> Block:
    match block:
        case Drawing() if not is_own(type(section)):
            raise PluginError(
                f"section '{section.name}' has {block!r}, which only the page's own sections can draw; "
                "give a palpate.api.Figure"
            )
        case Fold():
            return _fold(section, block)
        case Choice():
            return replace(block, options=tuple(_fold(section, option) for option in block.options))
        case Table():
            return _table(section, block)
        case Listing():
            return replace(block, items=tuple((strong, rest) for strong, rest in block.items))
        case Figure():
            figure_data(block)
        case Picture():
            address(block)
        case _ if not isinstance(block, Block):
            raise PluginError(
                f"section '{section.name}' has {block!r}, which is no block; see palpate.api.Section"
            )
    return block


def _fold(section: Component[Any], fold: Fold) -> Fold:
    # A generator would be used up by the first who looks.
    return replace(fold, blocks=checked(section, fold.blocks))


def _table(section: Component[Any], table: Table) -> Table:
    columns, rows = tuple(table.columns), tuple(map(tuple, table.rows))
    for k, row in enumerate(rows):
        if len(row) != len(columns):
            raise PluginError(
                f"section '{section.name}', table '{table.caption}': row {k} has {len(row)} cells for "
                f"{len(columns)} columns; give one cell for each"
            )
        for column, cell in zip(columns, row, strict=True):
            if problem := _wrong(cell):
                where = f"section '{section.name}', table '{table.caption}', column '{column}', row {k}"
                raise PluginError(f"{where}: {problem}")
    return replace(table, columns=columns, rows=rows)


def _wrong(cell: object) -> str:
    """Problem of a cell; empty where it can be shown."""
    match cell:
        case Lines(values=values):
            nested = (each for each in values if isinstance(each, Lines))
            problems = [f"{each!r} is one of several lines; give values and words" for each in nested]
            return next(filter(None, problems + list(map(_wrong, values))), "")
        case Word(text=text):
            return "" if isinstance(text, str) else f"a word is {text!r}; give a text"
        case None | str() | bool() | int() | float() | np.generic():
            return ""
    return f"{cell!r} is no cell; give a number, a text, None, Word or Lines"


def figure_data(figure: Figure) -> dict[str, Any]:
    """Values from which the page's script draws a figure."""
    return {"traces": plain(figure.traces), "layout": plain(figure.layout), "height": figure.height}


def plain(value: object) -> Any:  # noqa: ANN401 - JSON
    """JSON of a part of a figure: five digits, more than a screen shows; None for what is not finite.

    Raises
    ------
    PluginError
        Something in it is no text, number, list or mapping.
    """
    match value:
        case np.ndarray() | np.generic():
            return plain(value.tolist())
        case float():
            return float(f"{value:.5g}") if math.isfinite(value) else None
        case str() | bool() | int() | None:
            return value
        case Mapping():
            return {str(key): plain(item) for key, item in value.items()}
        case Sequence():
            return [plain(item) for item in value]
    raise PluginError(f"a figure has {value!r}; give it text, numbers, arrays, lists and mappings")


def address(picture: Picture) -> str:
    """A picture as an address that holds it.

    Raises
    ------
    PluginError
        It is of no known kind.
    """
    content = picture.content
    types = {b"\x89PNG": "image/png", b"\xff\xd8": "image/jpeg"}
    kind = next((kind for head, kind in types.items() if content.startswith(head)), "")
    if not kind and b"<svg" in content[:2000]:
        kind = "image/svg+xml"
    if not kind:
        raise PluginError(f"the picture '{picture.label}' is no PNG, JPEG or SVG file")
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
