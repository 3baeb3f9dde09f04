"""Ties: parameters that follow another one, such as ``kappa = "20 * c1"`` or ``E = "0.3 * skin.E"``.

A range of factors, ``E = { lower = "0.1 * skin.E", upper = "0.5 * skin.E" }``, is a ratio that is searched.
"""

import re
from collections.abc import Collection, Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from palpate.domain import Parameter, ParameterSpace, Prior, Tie
from palpate.domain.parameters import ratio_of
from palpate.errors import PalpateError
from palpate.study.model import ParameterTable, RegionTable
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


def ties_in(table: ParameterTable, names: Collection[str]) -> dict[str, tuple[str, str]]:
    """Factor and name of each tie that a parameter is written with, by key; ``names`` as above."""
    given = {"value": table.value, "lower": table.lower, "upper": table.upper}
    if table.prior:
        given |= {f"prior.{key}": value for key, value in table.prior}
    return {key: tie for key, each in given.items() if (tie := split_tie(each, names))}


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
            full, written = f"{region.region}.{name}", {}
            for key, (factor, source) in (ties_in(table, names) if name in names else {}).items():
                written[key] = factor, source if "." in source else f"{region.region}.{source}"
            sources = {source.partition(".")[0] for _, source in written.values()}
            if not written or sources & (tables.keys() - {r.region for r in space.regions}):
                continue  # no tie, or the mistake in that region is reported already
            with problems.at(*_key(full)):
                ties[full] = _tie(table, written, every, full)
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


def _tie(
    table: ParameterTable,
    written: Mapping[str, tuple[str, str]],
    every: Mapping[str, Parameter],
    follower: str,
) -> Tie:
    factors = {key: _factor(factor, source, every, follower) for key, (factor, source) in written.items()}
    sources = [source for _, source in written.values()]
    n_ends = 1 if table.value is not None else 2 if table.prior is None else 4
    if len(set(sources)) > 1 or len(written) < n_ends:
        raise ValueError(
            "the ends of a ratio, and its prior, are factors of one parameter; write "
            f'{{ lower = "0.1 * {sources[0]}", upper = "0.5 * {sources[0]}" }}'
        )
    if table.value is not None:
        return Tie(source=sources[0], factor=factors["value"])
    per, own, name = every[sources[0]], every[follower], follower.partition(".")[2]
    if ratio_of(follower) in every:
        raise ValueError(f"the material has a parameter '{ratio_of(name)}' of its own; fix the ratio")
    prior = Prior(value=factors["prior.value"], sd=factors["prior.sd"]) if table.prior else None
    ratio = Parameter(
        name=ratio_of(name),
        unit="1" if own.unit == per.unit else own.unit if per.unit == "1" else f"{own.unit}/({per.unit})",
        lower=factors["lower"],
        upper=factors["upper"],
        kind="shape",
        description=f"{name} over {sources[0]}",
        scale=table.scale,
        prior=prior,
        by_spot=table.by == "spot",
    )
    return Tie(source=sources[0], factor=ratio)


def _factor(factor: str, source: str, every: Mapping[str, Parameter], follower: str) -> float:
    if source not in every:
        raise ValueError(choice(source, every, "parameter"))
    per, unit = every[source].unit, every[follower].unit
    try:
        number = convert_factor(factor, per, unit)
    except ValueError as error:
        raise ValueError(f"no factor from '{source}' [{per}] to '{follower}' [{unit}]: {error}") from None
    if number == 0.0:
        raise ValueError(f"a factor of {factor} ties it to nothing; write a quantity to fix the parameter")
    return number


def _followed(name: str, ties: Mapping[str, Tie]) -> list[str]:
    """What a parameter follows, one after the other, until they end or repeat."""
    followed: list[str] = []
    while name in ties and (name := ties[name].source) not in followed:
        followed.append(name)
    return followed


def _check_ranges(problems: Problems, space: ParameterSpace, every: Mapping[str, Parameter]) -> None:
    """Refuse ties that leave the physical range where what they follow is at an end of its own range."""
    searched = {p.name: p for p in space.parameters}
    for name, tie in space.ties.items():
        roots = [searched[root] for root in space.roots(name) if root in searched]
        for ends in product(*((p.lower, p.upper) for p in roots)):
            value = space.complete({p.name: end for p, end in zip(roots, ends, strict=True)})[name]
            if np.isnan(value):
                continue  # what it follows has no value, which is reported already
            try:
                every[name].check(value)
            except PalpateError as error:
                at = [f"{p.name} = {end:g} {p.unit}" for p, end in zip(roots, ends, strict=True)]
                where = f" where {', '.join(at)}" if at else ""
                problems.add(_key(name), f"{tie} leaves its range{where}: {error}")
