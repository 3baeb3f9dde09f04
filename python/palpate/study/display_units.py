"""Units in which a study gives its ranges; the stages have the units of the materials."""

from collections.abc import Iterable
from dataclasses import replace

from palpate.domain import Parameter, Prior
from palpate.study.reading import Study
from palpate.units import convert


def unit_factors(study: Study) -> dict[str, float]:
    """Factors from the materials' units to those in which a study writes its ranges, by full name."""
    own = {r.name_of(p.name): p.unit for r in study.space.regions for p in r.material.parameters}
    return {name: 1.0 / convert(f"1 {unit}", own[name]) for name, unit in study.units.items()}


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
