"""Materials of the regions: which parameters are searched, between what, and which are fixed or tied."""

import contextlib
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from palpate.domain import FloatArray, Parameter, ParameterName, ParameterSpace, Prior, RegionMaterial, Tie
from palpate.domain.material import Material
from palpate.domain.parameters import ratio_of
from palpate.domain.relaxing import relaxing
from palpate.errors import PalpateError
from palpate.study.build import Context, build_component
from palpate.study.model import ParameterTable, RegionTable, StudyFile
from palpate.study.problems import Problems, choice
from palpate.study.source_positions import Key
from palpate.units import convert, convert_factor, unit_of


def split_tie(given: object, names: Collection[str]) -> tuple[str, str] | None:
    """Factor and name of what is written as a tie; None for a quantity, such as ``"20 N*mm"``.

    ``names`` are the parameters of the same region.
    """
    factor, _, name = given.rpartition("*") if isinstance(given, str) else ("", "", "")
    factor, name = factor.strip(), name.strip()
    is_tie = (
        name in names or "." in name or re.fullmatch(r"[+-]?[\d.]+([eE][+-]?\d+)?|[+-]?(nan|inf)", factor)
    )
    return (factor, name) if factor and is_tie and re.fullmatch(r"([\w-]+\.)?[^\W\d]\w*", name) else None


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
            full, written = region.name_of(name), {}
            for key, (factor, source) in (ties_in(table, names) if name in names else {}).items():
                written[key] = factor, source if "." in source else region.name_of(source)
            sources = {ParameterName.parse(source).region for _, source in written.values()}
            if not written or sources & (tables.keys() - {r.region for r in space.regions}):
                continue  # no tie, or the mistake in that region is reported already
            with problems.at(*_key(full)):
                ties[full] = _tie(table, written, every, full)
    named = [(ParameterName.parse(name), tie) for name, tie in ties.items()]
    regions = [
        replace(r, tied={name.name: tie for name, tie in named if name.region == r.region})
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
    name = ParameterName.parse(full)
    return ("region", name.region, "parameters", name.name)


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
    per, own, name = every[sources[0]], every[follower], ParameterName.parse(follower).name
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
        by=table.by,
    )
    return Tie(source=sources[0], factor=ratio)


def _factor(factor: str, source: str, every: Mapping[str, Parameter], follower: str) -> float:
    if source not in every:
        raise ValueError(
            f"{choice(source, every, 'parameter')}; name a region of this study in the tie, or search the "
            'parameter: { lower = "…", upper = "…" }'
        )
    per, unit = every[source].unit, every[follower].unit
    try:
        number = convert_factor(factor, per, unit)
    except ValueError as error:
        raise ValueError(f"no factor from '{source}' [{per}] to '{follower}' [{unit}]: {error}") from None
    if number == 0.0:
        raise ValueError(f"a factor of {factor} ties it to nothing; write a quantity to fix the parameter")
    return number


def _followed(name: str, ties: Mapping[str, Tie]) -> list[str]:
    """Chain of parameters that one follows, until they end or repeat."""
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


def build_space(context: Context, tables: Mapping[str, RegionTable]) -> ParameterSpace:
    """Build the material of every region."""
    built = [_region(context, name, table) for name, table in tables.items()]
    regions = tuple(region for region in built if region is not None)
    space = ParameterSpace(regions=regions)
    space = with_ties(context.problems, tables, space, _every(space))
    given = all(len(r.fixed) + len(r.tied) == len(r.material.parameters) for r in space.regions)
    given = given and not space.names
    if regions and len(regions) == len(built) and given:
        context.problems.add(
            ("region",), 'no parameter is searched; give at least one as { lower = "…", upper = "…" }'
        )
    return space


def _region(context: Context, name: str, table: RegionTable) -> RegionMaterial | None:
    key: Key = ("region", name)
    material = build_component(
        context, context.plugins.materials, table.material, table.settings, (*key, "material")
    )
    if material is None:
        return None
    if table.relaxation_times:
        with context.problems.at(*key, "relaxation_times"):
            material = relaxing(material, table.relaxation_times, table.relaxing_stress == "isochoric")
    elif table.relaxing_stress != "all":
        context.problems.add((*key, "relaxing_stress"), "nothing relaxes; give relaxation_times too")
    defaults: dict[str, Parameter] = {}
    with context.problems.at(*key, "convention"):
        defaults = {p.name: p for p in _in_convention(material, table.convention)}
    if not defaults:
        return None
    for unknown in table.parameters.keys() - defaults.keys():
        context.problems.add(
            (*key, "parameters", unknown),
            choice(unknown, defaults, f"parameter of material '{material.name}'"),
        )
    fixed, searched = _split(context.problems, (*key, "parameters"), defaults, table.parameters)
    return RegionMaterial(
        region=name, material=material, searched=searched, fixed=fixed, convention=table.convention
    )


def _split(
    problems: Problems, key: Key, defaults: Mapping[str, Parameter], given: Mapping[str, ParameterTable]
) -> tuple[dict[str, float], tuple[Parameter, ...]]:
    """Fixed values and searched parameters; ties are in neither."""
    fixed: dict[str, float] = {}
    searched: list[Parameter] = []
    for name, default in defaults.items():
        if name not in given:
            searched.append(default)
        elif ties_in(given[name], defaults):
            continue
        elif given[name].value is None:
            searched.extend(_range(problems, (*key, name), default, given))
        else:
            with problems.at(*key, name):
                fixed[name] = _value(default, given[name].value, _unit_nearby(default, given))
    return fixed, tuple(searched)


def _value(parameter: Parameter, given: object, usual: str = "") -> float:
    value = convert(given, parameter.unit, usual)
    parameter.check(value)
    return value


def _unit_nearby(parameter: Parameter, given: Mapping[str, ParameterTable]) -> str:
    """Unit in which other quantities of a parameter, else its neighbours, are written."""
    for table in (given[parameter.name], *given.values()):
        for text in (table.lower, table.upper, table.value):
            if isinstance(text, str) and (unit := unit_of(text)):
                with contextlib.suppress(ValueError):
                    convert(text, parameter.unit)
                    return unit
    return ""


def _range(
    problems: Problems, key: Key, default: Parameter, given: Mapping[str, ParameterTable]
) -> Iterator[Parameter]:
    ends, table, usual = {}, given[default.name], _unit_nearby(default, given)
    for end, written in (("lower", table.lower), ("upper", table.upper)):
        with problems.at(*key, end):
            ends[end] = _value(default, written, usual)
    if len(ends) < 2:
        return
    if not ends["lower"] < ends["upper"]:
        units = [unit_of(text) if isinstance(text, str) else "" for text in (table.lower, table.upper)]
        remedy = (
            "swap them, or write one quantity to fix the parameter"
            if units[0] == units[1]
            else f"the one is in {units[0]}, the other in {units[1]}: check the units"
        )
        problems.add(key, f"lower {table.lower!r} is not less than upper {table.upper!r}; {remedy}")
        return
    with problems.at(*key, "scale"):
        searched = replace(default, lower=ends["lower"], upper=ends["upper"], scale=table.scale, by=table.by)
        with problems.at(*key, "prior"):
            known = table.prior and {name: convert(x, default.unit) for name, x in table.prior}
            yield replace(searched, prior=Prior(**known) if known else None)


def _in_convention(material: Material, convention: str) -> Iterator[Parameter]:
    """Parameters of a material with their ranges and limits as ``convention`` writes them."""

    def written(end: str) -> FloatArray:
        textbook = np.array([getattr(p, end) for p in material.parameters])
        return material.from_textbook(textbook, convention)

    ranges = np.sort([written("lower"), written("upper")], axis=0).T
    limits = np.sort([written("physical_lower"), written("physical_upper")], axis=0).T
    every = zip(material.parameters, ranges.tolist(), limits.tolist(), strict=True)
    for parameter, (lower, upper), (least, most) in every:
        yield replace(parameter, lower=lower, upper=upper, physical_lower=least, physical_upper=most)


def _every(space: ParameterSpace) -> dict[str, Parameter]:
    """Every parameter of every region by full name, in the convention of its region."""
    return {r.name_of(p.name): p for r in space.regions for p in _in_convention(r.material, r.convention)}


def display_units(tables: Mapping[str, RegionTable], space: ParameterSpace) -> dict[str, str]:
    """Units in which ranges are written, by full name, where they are not the material's.

    A parameter tied to one of the same unit has its unit, and every modulus has the unit of the first.
    """
    own = {r.name_of(p.name): p for r in space.regions for p in r.material.parameters}
    shown = [name for name in own if name in {*space.names, *space.ties}]
    alike = [name for name in shown if own[name].unit == own[space.root(name)].unit]
    written = {name: _written_unit(tables, space.root(name)) for name in alike}
    moduli = [name for name in shown if own[name].kind == "modulus"]
    first = next((written[name] for name in moduli if written.get(name)), "")
    units = written | (dict.fromkeys(moduli, first) if first else {})
    return {name: unit for name, unit in units.items() if unit not in ("", own[name].unit)}


def _written_unit(tables: Mapping[str, RegionTable], name: str) -> str:
    """Unit in which the range or the value of a parameter is written; empty where it has none."""
    named = ParameterName.parse(name)
    table = tables[named.region].parameters.get(named.name, ParameterTable())
    given = table.lower if table.value is None else table.value
    return unit_of(given) if isinstance(given, str) else ""


def build_truth(context: Context, tables: StudyFile, space: ParameterSpace) -> dict[str, float]:
    """Read the known answer, by ``region.parameter``, in the region's convention."""
    if tables.truth and tables.study and tables.study.data != "simulated":
        context.problems.add(("truth",), 'only simulated data have a known answer; set data = "simulated"')
    truth: dict[str, float] = {}
    if not space.regions or len(space.regions) < len(tables.region):
        return truth  # a region's mistake is reported already
    known = _every(space)
    for key, value in _leaves(("truth",), tables.truth):
        name = ".".join(str(part) for part in key[1:])
        if name not in known:
            context.problems.add(key, choice(name, known, "parameter"))
            continue
        with context.problems.at(*key):
            truth[name] = _value(known[name], value)
    return truth | space.ratios(truth)


def _leaves(key: Key, table: Mapping[str, object]) -> Iterator[tuple[Key, object]]:
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves((*key, name), value)
        else:
            yield (*key, name), value
