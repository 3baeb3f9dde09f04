"""Curves that are processed already: recognised by their columns, and proposed for the loader ``csv``."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from palpate.api import convert
from palpate.api.files import Column, Kind, factor_to_base, kind_of
from palpate_indentation.csv_loader import FOREARM, HOMOGENEOUS
from palpate_robot_log.reading.proposal import words_of
from palpate_robot_log.reading.raw import RawLog

_LAYOUT = {"decimal": ".", "skip_lines": 0, "comment": "#"}
_DEGREES_PER_RADIAN = 57.29577951308232


class _Role(NamedTuple):
    """Unit and words that a column must have, and the factor from a log's base unit to the channel's."""

    kind: Kind
    words: frozenset[str]
    factor: float = 1.0


_ROLES: Mapping[str, tuple[_Role, _Role]] = {
    "force": (
        _Role("length", frozenset({"depth", "indentation", "displacement", "travel"})),
        _Role("force", frozenset({"force", "load", "fn", "fz", "normal"})),
    ),
    "torque": (
        _Role("angle", frozenset({"angle", "rotation", "twist", "turn"}), _DEGREES_PER_RADIAN),
        _Role("moment", frozenset({"torque", "moment", "tz", "mz"})),
    ),
}
_Pair = tuple[tuple[str, float], tuple[str, float]]


def curves_text(log: RawLog) -> str:
    """Tables of study.toml for the loader ``csv``; empty where the file is no table of processed curves."""
    if log.format != "delimited text":
        return ""
    columns = [column for stream in log.streams for column in stream.columns.values()]
    found = {channel: _pair(columns, roles) for channel, roles in _ROLES.items()}
    curves = {channel: pair for channel, pair in found.items() if pair is not None}
    if "force" not in curves:
        return _homogeneous(columns, Path(log.source).name)
    lines = ["[experiment]", 'loader = "csv"']
    # The loader finds the separator by itself.
    layout = {key: log.layout[key] for key in _LAYOUT if log.layout.get(key, _LAYOUT[key]) != _LAYOUT[key]}
    lines += [f"settings.{key} = {json.dumps(value)}" for key, value in layout.items()]
    usual = {
        channel: ((columns.abscissa.name, 1.0), (columns.ordinate.name, 1.0))
        for channel, columns in FOREARM.items()
    }
    if curves != usual:
        for channel, pair in curves.items():
            lines += ["", f"[experiment.settings.channels.{channel}]"]
            for key, (name, factor) in zip(("abscissa", "ordinate"), pair, strict=True):
                text = json.dumps(name, ensure_ascii=False)
                lines.append(
                    f"{key} = {text}" if factor == 1.0 else f"{key} = {{ name = {text}, scale = {factor!r} }}"
                )
    return "\n".join(lines) + "\n"


def _homogeneous(columns: Sequence[Column], file: str) -> str:
    """Tables for the stress of a homogeneous test over its stretch, strain or shear; else empty."""
    words = [set(words_of(column.name)) for column in columns]
    if len(columns) != 2 or not words[0] & {"stretch", "strain", "shear"} or "stress" not in words[1]:
        return ""
    unit = columns[1].unit or re.split(r"[_\s\[(]", columns[1].name)[-1].rstrip(")] ")
    try:
        factor = float(f"{convert(f'1 {unit}', 'MPa'):.12g}")
    except ValueError:
        return ""
    mode = "simple_shear" if "shear" in words[0] else "uniaxial"
    lines = [f"# [[spot]] measured = {{ {mode} = {json.dumps(file)} }}: the key is the mode of the test"]
    lines += ["[experiment]", 'loader = "csv"']
    own, (along, of) = HOMOGENEOUS[mode], (column.name for column in columns)
    if (along, of) != (own.abscissa.name, own.ordinate.name):
        offset = ", offset = 1.0" if "strain" in words[0] else ""
        lines += ["", f"[experiment.settings.channels.{mode}]"]
        lines += [f"abscissa = {{ name = {json.dumps(along)}{offset} }}"]
        lines += [f"ordinate = {{ name = {json.dumps(of)}, scale = {factor!r} }}"]
    return "\n".join(lines) + "\n"


def _pair(columns: Iterable[Column], roles: tuple[_Role, _Role]) -> _Pair | None:
    """Names and factors of abscissa and ordinate, where one column each can be meant."""
    chosen = []
    for role in roles:
        found = [
            column
            for column in columns
            if kind_of(column.shown_unit) == role.kind and role.words & set(words_of(column.name))
        ]
        if len(found) != 1:
            return None
        factor = factor_to_base(found[0].shown_unit, role.kind, found[0].name) * role.factor
        chosen.append((found[0].name, float(f"{factor:.12g}")))
    return chosen[0], chosen[1]
