"""Materials of the regions: which parameters are searched, between what, and which are fixed or tied."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from palpate.domain import FloatArray, Parameter, ParameterSpace, Prior, RegionMaterial
from palpate.domain.material import Material
from palpate.study.build import Context, build_component
from palpate.study.model import ParameterTable, RegionTable, Tables
from palpate.study.problems import Problems, choice
from palpate.study.source_positions import Key
from palpate.study.ties import ties_in, with_ties
from palpate.units import convert, unit_of


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
    """What is fixed, and what is searched; ties are in neither."""
    fixed: dict[str, float] = {}
    searched: list[Parameter] = []
    for name, default in defaults.items():
        if name not in given:
            searched.append(default)
        elif ties_in(given[name], defaults):
            continue
        elif given[name].value is None:
            searched.extend(_range(problems, (*key, name), default, given[name]))
        else:
            with problems.at(*key, name):
                fixed[name] = _value(default, given[name].value)
    return fixed, tuple(searched)


def _value(parameter: Parameter, given: object) -> float:
    value = convert(given, parameter.unit)
    parameter.check(value)
    return value


def _range(problems: Problems, key: Key, default: Parameter, table: ParameterTable) -> Iterator[Parameter]:
    ends = {}
    for end, given in (("lower", table.lower), ("upper", table.upper)):
        with problems.at(*key, end):
            ends[end] = _value(default, given)
    if len(ends) < 2:
        return
    if not ends["lower"] < ends["upper"]:
        problems.add(
            key,
            f"lower {table.lower!r} is not less than upper {table.upper!r}; swap them, "
            "or write one quantity to fix the parameter",
        )
        return
    with problems.at(*key, "scale"):
        searched = replace(
            default, lower=ends["lower"], upper=ends["upper"], scale=table.scale, by_spot=table.by == "spot"
        )
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
    return {
        f"{r.region}.{p.name}": p for r in space.regions for p in _in_convention(r.material, r.convention)
    }


def written_units(tables: Mapping[str, RegionTable], space: ParameterSpace) -> dict[str, str]:
    """Units in which ranges are written, by full name, where they are not the material's.

    What is tied to a parameter of the same unit has the one that this is written in.
    """
    own = {f"{r.region}.{p.name}": p.unit for r in space.regions for p in r.material.parameters}
    shown = {*space.names, *space.ties} & own.keys()
    written = {name: _written_unit(tables, space.root(name)) for name in shown}
    return {
        name: written[name]
        for name in own
        if name in shown and own[name] == own[space.root(name)] and written[name] not in ("", own[name])
    }


def _written_unit(tables: Mapping[str, RegionTable], name: str) -> str:
    """Unit in which the range or the value of a parameter is written; empty where it has none."""
    region, _, parameter = name.partition(".")
    table = tables[region].parameters.get(parameter, ParameterTable())
    given = table.lower if table.value is None else table.value
    return unit_of(given) if isinstance(given, str) else ""


def build_truth(context: Context, tables: Tables, space: ParameterSpace) -> dict[str, float]:
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
