"""Relaxation of any material: shares of its stress that relax, each with a time constant of its own."""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from pydantic import Field, create_model

from palpate.domain.component import NO_FIELDS, Array
from palpate.domain.curves import FloatArray
from palpate.domain.material import HyperelasticMaterial, Material
from palpate.domain.parameter import Parameter
from palpate.errors import ParameterError

LARGEST_TOTAL = 0.9
"""Sum of the shares at the upper ends of their ranges."""


class RelaxingMaterial(HyperelasticMaterial):
    """A material whose stress relaxes by 1 - Σ γ_i (1 - e^(-t/τ_i)); the shares γ_i are its last values.

    Its energy and its other values are those at once.
    """

    elastic: Any
    energy_form = None

    def energy(self, stretches: Array, theta: Array) -> Array:  # noqa: D102
        return self.elastic.energy(stretches, self._own(theta))

    def energy_from_F(  # noqa: D102, N802
        self, F: Array, theta: Array, fields: Mapping[str, Array] = NO_FIELDS
    ) -> Array:
        return self.elastic.energy_from_F(F, self._own(theta), *([fields] if fields else []))

    def _own(self, theta: Array) -> Array:
        return theta[: len(self.elastic.parameters)]

    def _factors(self, convention: str) -> tuple[float, ...]:
        return (*self.elastic._factors(convention), *(1.0 for _ in self.relaxation_times_s))

    def check(self, theta: FloatArray) -> None:
        """Refuse what the elastic material refuses, and shares that add up to 1."""
        super().check(theta)
        self.elastic.check(self._own(theta))
        if not (total := float(sum(theta[len(self.elastic.parameters) :]))) < 1.0:
            raise ParameterError(f"shares that relax add up to {total:.3g}; they are less than 1")

    def fingerprint(self) -> str:  # noqa: D102
        return str(self.elastic.fingerprint())

    def __reduce__(self) -> tuple[Any, ...]:
        return relaxing, (self.elastic, self.relaxation_times_s, self.relaxes_isochoric)


@cache
def _relaxing(elastic: type[Any]) -> Any:  # noqa: ANN401
    """Class of the relaxing form of materials of a class, whose settings have the times too."""
    added: Any = {"relaxation_times_s": (tuple[float, ...], Field()), "relaxes_isochoric": (bool, Field())}
    settings = create_model(elastic.Settings.__name__, __base__=elastic.Settings, **added)
    return type(f"Relaxing{elastic.__name__}", (RelaxingMaterial, elastic), {"Settings": settings})


def relaxing(material: Material, times_s: Sequence[float], isochoric: bool = False) -> Material:
    """The material with shares of its stress that relax, parameters such as ``relaxed_10s`` after its own.

    With ``isochoric`` only the stress of the isochoric part of its energy, Ψ(J^(-1/3) F), relaxes.
    """
    cls, times = _relaxing(type(material)), tuple(map(float, times_s))
    own = {"relaxation_times_s": times, "relaxes_isochoric": isochoric}
    shares = tuple(_share(time, LARGEST_TOTAL / len(times)) for time in times)
    result: Material = cls.__new__(cls)
    vars(result).update(vars(material) | own)
    vars(result).update(elastic=material, parameters=(*material.parameters, *shares))
    result.settings = cls.Settings.model_construct(**dict(material.settings), **own)
    return result


def _share(time_s: float, upper: float) -> Parameter:
    time = f"{time_s:.0f}s" if time_s == round(time_s) else f"{1000.0 * time_s:.0f}ms"
    text = f"share of the stress that relaxes with {time_s:g} s"
    ends: Any = {"lower": 0.0, "upper": upper, "physical_lower": 0.0, "physical_upper": 1.0}
    return Parameter(name=f"relaxed_{time}", unit="", kind="shape", description=text, **ends)
