"""Ties: parameters that follow another one, such as ``kappa = "20 * c1"`` or ``E = "0.3 * skin.E"``."""

import re
from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from palpate.domain import Parameter, ParameterSpace, Tie
from palpate.errors import PalpateError
from palpate.study.model import RegionTable
from palpate.study.problems import Problems, choice
from palpate.study.source_positions import Key
from palpate.units import convert_factor

_NAME = re.compile(r"([\w-]+\.)?[^\W\d]\w*")
_NUMBER = re.compile(r"[+-]?[\d.]+([eE][+-]?\d+)?|[+-]?(nan|inf)")


def split_tie(given: object, names: Collection[str]) -> tuple[str, str] | None:
    """Factor and name of what is written as a tie; None for a quantity, such as ``"20 N*mm"``.

    ``names`` are the parameters of the same region.
    """
    factor, _, name = given.rpartition("*") if isinstance(given, str) else ("", "", "")
    factor, name = factor.strip(), name.strip()
    is_tie = name in names or "." in name or _NUMBER.fullmatch(factor)
    return (factor, name) if factor and is_tie and _NAME.fullmatch(name) else None


def with_ties(
    problems: Problems,
    tables: Mapping[str, RegionTable],
    space: ParameterSpace,
    every: Mapping[str, Parameter],
) -> ParameterSpace:
    """Add the ties that the tables give to a space of what is searched and fixed.

    ``every`` holds the parameters of all regions by full name, in their conventions.
    """
    ties: dict[str, Tie] = {}
    for region in space.regions:
        names = [p.name for p in region.material.parameters]
        for name, table in tables[region.region].parameters.items():
            tie = split_tie(table.value, names) if name in names else None
            if tie is not None:
                full = f"{region.region}.{name}"
                source = tie[1] if "." in tie[1] else f"{region.region}.{tie[1]}"
                if source.partition(".")[0] in tables.keys() - {r.region for r in space.regions}:
                    continue  # the mistake in that region is reported already
                with problems.at(*_key(full)):
                    ties[full] = _tie(tie[0], source, every, full)
    regions = [
        replace(r, tied={n.partition(".")[2]: t for n, t in ties.items() if n.partition(".")[0] == r.region})
        for r in space.regions
    ]
    circles = [name for name in ties if name in _followed(name, ties)]
    for name in circles:
        around = " → ".join([name, *_followed(name, ties)])
        problems.add(_key(name), f"the ties go round in a circle, {around}; search or fix one of them")
    tied = ParameterSpace(regions=tuple(regions))
    if not circles:
        _check_ranges(problems, tied, every)
    return tied


def _key(full: str) -> Key:
    region, _, name = full.partition(".")
    return ("region", region, "parameters", name)


def _tie(factor: str, source: str, every: Mapping[str, Parameter], follower: str) -> Tie:
    if source not in every:
        raise ValueError(choice(source, every, "parameter"))
    per, unit = every[source].unit, every[follower].unit
    try:
        number = convert_factor(factor, per, unit)
    except ValueError as error:
        raise ValueError(f"no factor from '{source}' [{per}] to '{follower}' [{unit}]: {error}") from None
    if number == 0.0:
        raise ValueError(f"a factor of {factor} ties it to nothing; write a quantity to fix the parameter")
    return Tie(source=source, factor=number)


def _followed(name: str, ties: Mapping[str, Tie]) -> list[str]:
    """What a parameter follows, one after the other, until they end or repeat."""
    followed: list[str] = []
    while name in ties and (name := ties[name].source) not in followed:
        followed.append(name)
    return followed


def _check_ranges(problems: Problems, space: ParameterSpace, every: Mapping[str, Parameter]) -> None:
    """Refuse ties that leave the physical range where a searched parameter is at an end of its own."""
    searched = {p.name: p for p in space.parameters}
    for name, tie in space.ties.items():
        root = searched.get(space.root(name))
        for known in [{root.name: root.lower}, {root.name: root.upper}] if root else [{}]:
            value = space.complete(known)[name]
            if np.isnan(value):
                continue  # what it follows has no value, which is reported already
            try:
                every[name].check(value)
            except PalpateError as error:
                at = "".join(f" where {name} = {end:g} {root.unit}" for name, end in known.items() if root)
                problems.add(_key(name), f"{tie.factor:g} * {tie.source} leaves its range{at}: {error}")
