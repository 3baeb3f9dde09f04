"""Sizes of a specimen that the text above a table states."""

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from palpate.api.files import factors_of, unit_in
from palpate_robot_log.reading.names import WORDS, words_of


def sizes_in(preamble: str) -> Mapping[str, float]:
    r"""Length [mm] and area [mm²] of a specimen, where a text states each once and with its unit.

    Examples
    --------
    >>> sizes_in("Width,10,mm\nThickness,2,mm\nGauge length: 4 cm")
    {'length': 40.0, 'area': 20.0}
    """
    between = r'\s*(?:"\s*,\s*"?|,\s*"|[;\t|]|(?<!\d),|,(?!\d)|[:=])\s*'
    cells = [[cell.strip(' "#%') for cell in re.split(between, line)] for line in preamble.splitlines()]
    found: dict[str, set[float]] = {}
    for row, line in enumerate(cells):
        for place, label in enumerate(line):
            below = [other[place] for other in cells[row + 1 : row + 3] if place < len(other)]
            if size := _size_of(label):
                values = (_measured(size, label, near) for near in (line[place + 1 :], below))
                found.setdefault(size, set()).update([*filter(None, values)][:1])
    once = {size: values.pop() for size, values in found.items() if len(values) == 1}
    areas = [once["size_area"]] if "size_area" in once else []
    sides = [once[size] for size in ("size_width", "size_thickness") if size in once]
    areas += [sides[0] * sides[1]] if len(sides) == 2 else []
    areas += [np.pi / 4.0 * once["size_diameter"] ** 2] if "size_diameter" in once and not sides else []
    every = {"length": [once[k] for k in ("size_gauge", "size_length") if k in once], "area": areas}
    return {size: float(f"{values[0]:.6g}") for size, values in every.items() if values}


def _size_of(label: str) -> str:
    """Size that a label is of, by the key of its words; empty where it is none before the test."""
    words = words_of(label)
    if WORDS["no_size"] & {*words}:
        return ""
    known = [*words, *map("".join, pairwise(words))]
    keys = (key for key in WORDS if key.startswith("size_"))
    return next((key for key in keys if any(word.endswith(tuple(WORDS[key])) for word in known)), "")


def _measured(size: str, label: str, near: Sequence[str]) -> float | None:
    """Value of a size [mm, mm²] in the cells next to its label; None where the value or its unit lacks."""
    value = next(
        filter(None, (re.fullmatch(r"(\d+(?:[.,]\d+)?)\s*(\D.*)?", cell) for cell in near[:2])), None
    )
    for unit in (unit_in(label)[1], value[2] or "", *near[:2]) if value else ():
        part = re.fullmatch(r"(\D+?)(\^?2|²)?", unit.strip("()[] "))
        factor = factors_of(part[1]).get("length") if part else None
        if value and part and factor and bool(part[2]) == (size == "size_area"):
            return float(value[1].replace(",", ".")) * factor ** (2 if part[2] else 1)
    return None
