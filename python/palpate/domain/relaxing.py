"""Relaxation of any material: shares of its stress that relax, each with a time constant of its own."""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from pydantic import Field, create_model

from palpate.domain.component import NO_FIELDS, Array
from palpate.domain.curves import FloatArray
from palpate.domain.material import HyperelasticMaterial, Material
from palpate.domain.parameter import Parameter
from palpate.errors import MaterialError, ParameterError

SHORTEST_S = 1e-3
"""Unit of the times in the names of shares."""


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

    def _shares(self, theta: Array) -> Array:
        return theta[len(self.elastic.parameters) :]

    def at_once(self, theta: FloatArray) -> tuple[Material, FloatArray]:
        """Elastic material of a load that is over at once, and its values."""
        return self.elastic, self._own(theta)

    def relaxation(self, theta: FloatArray) -> dict[float, float]:
        """Share of the stress that relaxes with each time constant [s]."""
        return dict(zip(self.relaxation_times_s, map(float, self._shares(theta)), strict=True))

    def to_textbook(self, values: FloatArray, convention: str) -> FloatArray:  # noqa: D102
        return np.append(self.elastic.to_textbook(self._own(values), convention), self._shares(values))

    def from_textbook(self, theta: FloatArray, convention: str) -> FloatArray:  # noqa: D102
        return np.append(self.elastic.from_textbook(self._own(theta), convention), self._shares(theta))

    def check(self, theta: FloatArray) -> None:
        """Refuse what the elastic material refuses, and shares that add up to 1."""
        HyperelasticMaterial.check(self, theta)  # that of the elastic class takes its own values alone
        self.elastic.check(self._own(theta))
        if not (total := float(np.sum(self._shares(theta)))) < 1.0:
            raise ParameterError(
                f"material '{self.name}': shares that relax add up to {total:.3g}; they are less than 1, "
                "so lower their values or upper bounds"
            )

    def fingerprint(self) -> str:  # noqa: D102
        return str(self.elastic.fingerprint())

    def __reduce__(self) -> tuple[Any, ...]:
        return relaxing, (self.elastic, self.relaxation_times_s, self.relaxes_isochoric)


@cache
def _relaxing(elastic: type[Any]) -> Any:  # noqa: ANN401
    """Class of the relaxing form of materials of a class, whose settings have the times too."""
    added: Any = {"relaxation_times_s": (tuple[float, ...], Field()), "relaxes_isochoric": (bool, Field())}
    settings = create_model(elastic.Settings.__name__, __base__=elastic.Settings, **added)
    own = {"Settings": settings, "__doc__": elastic.__doc__}
    return type(f"Relaxing{elastic.__name__}", (RelaxingMaterial, elastic), own)


def relaxing(material: Material, times_s: Sequence[float], isochoric: bool = False) -> Material:
    """The material with shares of its stress that relax, parameters such as ``relaxed_10s`` after its own.

    With ``isochoric`` only the stress of the isochoric part of its energy, Ψ(J^(-1/3) F), relaxes.

    Raises
    ------
    MaterialError
        The material relaxes already, or :func:`checked_times` refuses the times.
    """
    if material.relaxation_times_s:
        raise MaterialError(f"material '{material.name}' relaxes already; give it all times at once")
    cls, times = _relaxing(type(material)), checked_times(times_s)
    own = {"relaxation_times_s": times, "relaxes_isochoric": isochoric}
    # The shares sum to this at the upper ends of their ranges.
    shares = (relaxed_share(f"relaxed_{time_name(t)}", t, 0.9 / len(times)) for t in times)
    result: Material = cls.__new__(cls)
    vars(result).update(vars(material) | own)
    vars(result).update(elastic=material, parameters=(*material.parameters, *shares))
    result.settings = cls.Settings.model_construct(**dict(material.settings), **own)
    return result


def time_name(time_s: float) -> str:
    """Time in the name of a share: in whole seconds, else in ms."""
    return f"{time_s:.0f}s" if time_s == round(time_s) else f"{1000.0 * time_s:.0f}ms"


def dwell_times(start_s: float, end_s: float, fastest_s: float) -> FloatArray:
    """Times after the start of a dwell up to its end, the closer to the start the more.

    ``fastest_s`` is the shortest time constant of what relaxes.
    """
    # The first step of the dwell.
    first = 0.1 * fastest_s
    decades = float(np.log10(max((end_s - start_s) / first, 1.0)))
    # Steps per decade: a curve over time is straight between them, at most 1 % of the relaxation off.
    n = int(np.ceil(6 * decades)) + 1
    return np.append(start_s + np.geomspace(min(first, end_s - start_s), end_s - start_s, n)[:-1], end_s)


def checked_times(times_s: Sequence[float]) -> tuple[float, ...]:
    """Time constants whose shares have names of their own, in ms.

    Raises
    ------
    MaterialError
        One is shorter than 1 ms, or two are less than that apart.
    """
    in_range = all(SHORTEST_S <= time < np.inf for time in times_s)
    if not (in_range and len({round(time / SHORTEST_S) for time in times_s}) == len(times_s)):
        given = ", ".join(f"{time:g} s" for time in times_s)
        raise MaterialError(
            f"time constants are at least {1e3 * SHORTEST_S:g} ms, and that far apart, got {given}; "
            "change or remove one"
        )
    return tuple(map(float, times_s))


def relaxed_share(name: str, time_s: float, upper: float) -> Parameter:
    """Share of the stress that relaxes with a time constant, searched from 0 to ``upper``."""
    text = f"share of the stress that relaxes with {time_s:g} s"
    ends: Any = {"lower": 0.0, "upper": upper, "physical_lower": 0.0, "physical_upper": 1.0}
    return Parameter(name=name, unit="1", kind="shape", description=text, **ends)
