"""Units in which a study gives its ranges; the stages have the units of the materials."""

from collections.abc import Iterable
from dataclasses import replace

import polars as pl

from palpate.domain import Parameter, ParameterName, Prior
from palpate.study.reading import Study
from palpate.units import convert


def unit_factors(study: Study) -> dict[str, float]:
    """Factors from the materials' units to those in which a study writes its ranges, by full name."""
    own = {r.name_of(p.name): p.unit for r in study.space.regions for p in r.material.parameters}
    return {name: 1.0 / convert(f"1 {unit}", own[name]) for name, unit in study.units.items()}


def with_units(study: Study, frame: pl.DataFrame) -> pl.DataFrame:
    """Table with its parameters in the units of the study, which the columns name: ``tissue.c1 [kPa]``."""
    every = study.parametrisation.parameters(study.space, study.spot_names)
    units = {ParameterName.parse(p.name).shared: p.unit for p in every}
    units |= {r.name_of(p.name): p.unit for r in study.space.regions for p in r.material.parameters}
    units, factors = {**units, **study.units}, unit_factors(study)
    names = {column: ParameterName.parse(column).shared for column in frame.columns}
    heads = {c: f"{c} [{units[name]}]" for c, name in names.items() if units.get(name, "1") not in ("", "1")}
    scaled = [pl.col(c) * factors[name] for c, name in names.items() if name in factors]
    return frame.with_columns(scaled).rename(heads)


def in_units(study: Study, parameters: Iterable[Parameter]) -> tuple[Parameter, ...]:
    """Return parameters with their ranges and priors in the units in which a study writes them."""
    factors = unit_factors(study)
    return tuple(
        _converted(p, study.units[p.name], factors[p.name]) if p.name in factors else p for p in parameters
    )


def _converted(parameter: Parameter, unit: str, factor: float) -> Parameter:
    prior = parameter.prior and Prior(value=factor * parameter.prior.value, sd=factor * parameter.prior.sd)
    ends = ("lower", "upper", "physical_lower", "physical_upper")
    scaled = {end: getattr(parameter, end) * factor for end in ends}
    return replace(parameter, unit=unit, prior=prior, **scaled)
