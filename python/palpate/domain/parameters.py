"""Parameter space: parameters of the regions' materials, with ranges, priors and ties."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from palpate.domain.curves import FloatArray
from palpate.domain.material import Material
from palpate.domain.parameter import Parameter, ParameterName
from palpate.errors import SamplingError


@dataclass(frozen=True, slots=True, kw_only=True)
class Tie:
    """Tie of a parameter to another: its value is ``factor`` times the value of ``source``.

    Parameters
    ----------
    source : str
        Full name, ``region.parameter``.
    factor : float or Parameter
        Between the numbers as their regions write them, each in its unit. A ratio that is searched
        is a parameter of the region, named after the one that follows: ``E_ratio``.
    """

    source: str
    factor: float | Parameter

    def __str__(self) -> str:
        factor = self.plain["factor"]
        return f"{factor if isinstance(factor, str) else f'{factor:g}'} * {self.source}"

    @property
    def plain(self) -> dict[str, str | float]:
        """Source and factor, or name of the ratio, for records."""
        factor = self.factor.name if isinstance(self.factor, Parameter) else self.factor
        return {"source": self.source, "factor": factor}


@dataclass(frozen=True, slots=True, kw_only=True)
class RegionMaterial:
    """The material of one region, with each parameter searched, fixed or tied to another one.

    Parameters
    ----------
    searched : tuple of Parameter
        With the study's ranges, in ``convention``.
    fixed : mapping of parameter name to value
        In ``convention``.
    convention : str
        Of the numbers: ``textbook``, or another key of
        ``material.conventions``.
    """

    region: str
    material: Material
    searched: tuple[Parameter, ...]
    fixed: Mapping[str, float]
    convention: str = "textbook"
    tied: Mapping[str, Tie] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "fixed", MappingProxyType(dict(self.fixed)))
        object.__setattr__(self, "tied", MappingProxyType(dict(self.tied)))

    @property
    def columns(self) -> tuple[Parameter, ...]:
        """Columns of the region in a design: parameters and ratios of ties."""
        ratios = (tie.factor for tie in self.tied.values() if isinstance(tie.factor, Parameter))
        return (*self.searched, *ratios)

    def name_of(self, parameter: str) -> str:
        """Full name of a parameter of the region."""
        return str(ParameterName(self.region, parameter))

    @property
    def full_names(self) -> dict[str, str]:
        """Full names of all parameters of the material, by their names in it."""
        return {p.name: self.name_of(p.name) for p in self.material.parameters}

    @property
    def room(self) -> dict[str, float]:
        """Relative distance of each fixed parameter that is not 0 to the nearer end of its physical range."""
        numbers = np.array([self.fixed.get(p.name, np.nan) for p in self.material.parameters])
        values = self.material.to_textbook(numbers, self.convention).tolist()
        return {
            p.name: min(value - p.physical_lower, p.physical_upper - value) / abs(value)
            for p, value in zip(self.material.parameters, values, strict=True)
            if p.name in self.fixed and value
        }

    @property
    def relaxes(self) -> bool:
        """True if a share of the stress that relaxes is searched, or fixed above 0."""
        n_own = len(self.material.parameters) - len(self.material.relaxation_times_s)
        return any(self.fixed.get(p.name, 1.0) != 0.0 for p in self.material.parameters[n_own:])

    def theta(self, values: Mapping[str, float]) -> FloatArray:
        """Textbook parameters in the order of ``material.parameters``, shape (n_parameters,)."""
        numbers = [
            self.fixed[p.name] if p.name in self.fixed else values[p.name] for p in self.material.parameters
        ]
        return self.material.to_textbook(np.array(numbers), self.convention)


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterSpace:
    """All searched parameters of all regions, under the names ``region.parameter``.

    Parameters
    ----------
    states : mapping of spot name to str
        State in which the person was there, such as rest: of each spot or of none.
    """

    regions: tuple[RegionMaterial, ...]
    states: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "states", MappingProxyType(dict(self.states)))

    @property
    def relaxes(self) -> bool:
        """True if the stress of any region relaxes."""
        return any(region.relaxes for region in self.regions)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Searched parameters and ratios with their full names, in design column order."""
        return tuple(replace(p, name=r.name_of(p.name)) for r in self.regions for p in r.columns)

    @property
    def names(self) -> tuple[str, ...]:
        """Full names of the parameters."""
        return tuple(r.name_of(p.name) for r in self.regions for p in r.columns)

    @property
    def ties(self) -> dict[str, Tie]:
        """Ties by the full name of the parameter that follows."""
        return {r.name_of(name): tie for r in self.regions for name, tie in r.tied.items()}

    def root(self, name: str) -> str:
        """Full name at the end of the ties of a parameter: its own where it follows none."""
        return self.roots(name)[0]

    def roots(self, name: str) -> tuple[str, ...]:
        """Full names that decide a parameter: the end of its ties, then the searched ratios on the way."""
        ties, ratios = self.ties, []
        while name in ties:
            if isinstance(ties[name].factor, Parameter):
                ratios.append(ratio_of(name))
            name = ties[name].source
        return (name, *ratios)

    def columns_of(self, region: str) -> tuple[int, ...]:
        """Design columns that the material of a region depends on."""
        (material,) = (r for r in self.regions if r.region == region)
        roots = {root for name in material.full_names.values() for root in self.roots(name)}
        return tuple(i for i, name in enumerate(self.names) if name in roots)

    def complete(self, known: Mapping[str, float]) -> dict[str, float]:
        """Values of all parameters by full name, from the values of at least the searched parameters.

        What is not known is what the study fixes it to, or follows by its tie; NaN where neither gives it.
        """
        fixed = {r.name_of(name): value for r in self.regions for name, value in r.fixed.items()}
        given, ties = {**fixed, **known}, self.ties

        def value(name: str) -> float:
            if name in given or name not in ties:
                return given.get(name, np.nan)
            factor = ties[name].factor
            if isinstance(factor, Parameter):
                factor = given.get(ratio_of(name), np.nan)
            return factor * value(ties[name].source)

        return {name: value(name) for r in self.regions for name in r.full_names.values()}

    def thetas(self, row: FloatArray) -> dict[str, FloatArray]:
        """Textbook parameters by region for one design row of shape (n_parameters,)."""
        names = self.names
        if len(row) != len(names):
            raise SamplingError(f"a design row of {len(row)} values for {len(names)} searched parameters")
        values = self.complete(dict(zip(names, row.tolist(), strict=True)))
        return {
            r.region: r.theta({name: values[full] for name, full in r.full_names.items()})
            for r in self.regions
        }

    def written(self, thetas: Mapping[str, FloatArray]) -> dict[str, float]:
        """Values of all parameters and ratios by full name, as regions write them; undoes :meth:`thetas`."""
        values = {
            name: float(value)
            for r in self.regions
            for name, value in zip(
                r.full_names.values(), r.material.from_textbook(thetas[r.region], r.convention), strict=True
            )
        }
        return values | self.ratios(values)

    def ratios(self, values: Mapping[str, float]) -> dict[str, float]:
        """Searched ratios, by their full names, of the parameters whose values are known."""
        pairs = {name: tie.source for name, tie in self.ties.items() if isinstance(tie.factor, Parameter)}
        known = {name: source for name, source in pairs.items() if name in values and values.get(source)}
        return {ratio_of(name): values[name] / values[source] for name, source in known.items()}


def ratio_of(name: str) -> str:
    """Name of the searched ratio of a tied parameter to the one that it follows."""
    return f"{name}_ratio"
