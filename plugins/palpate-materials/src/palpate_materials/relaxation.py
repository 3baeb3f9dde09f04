"""Relaxation of a tissue under its press: quasi-linear viscoelasticity, from elastic curves.

All moduli relax alike, by g(t) = 1 - Σ γ_i (1 - e^(-t/τ_i)). Under a prescribed motion the elastic
deformation is then also the relaxing tissue's, and a curve is g convolved with the elastic one,

    F(t) = ∫ g(t - s) dFᵉ(s) = Fᵉ(t) - Σ γ_i (Fᵉ(t) - h_i(t)),    h_i(t) = ∫ e^(-(t - s)/τ_i) dFᵉ(s)

(Fung, Biomechanics, 1993, section 7.6). That holds for the force of a press and a rest. A twist turns the
stresses of the press, which have relaxed, so that its torque is larger: by 4 to 15 % of its peak in blocks of
FEBio that had relaxed by a quarter. While the contact shrinks, and where the skin slips, it is an
approximation too. The searched moduli are those at once.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated

import numpy as np
from pydantic import Field, field_validator

from palpate.api import (
    FORCE,
    TORQUE,
    Curve,
    FloatArray,
    Indentation,
    Parameter,
    ParameterError,
    ParameterSpace,
    Protocol,
    Quantity,
    Response,
    StudyError,
    checked_times,
    relaxed_share,
    time_name,
)
from palpate.api.experiment import TIME
from palpate.api.fit import SpotInputs, StandardParametrisation, StandardSettings, for_each_spot

FORCE_OVER_TIME, TORQUE_OVER_TIME = (
    replace(
        channel, name=f"{channel.name}_over_time", abscissa=TIME, abscissa_label="time (s)", dissipative=False
    )
    for channel in (FORCE, TORQUE)
)


def reduced_relaxation(time_s: FloatArray, times_s: FloatArray, shares: FloatArray) -> FloatArray:
    """Modulus (n, ...) after times (n,), over that at once; shares (m, ...) relax with constants (m,)."""
    gone: FloatArray = -np.expm1(-time_s[:, None] / times_s)
    return 1.0 - gone @ shares


def loss_tangent(frequency: FloatArray, times_s: FloatArray, shares: FloatArray) -> FloatArray:
    """Tangent (n, ...) of the loss angle at angular frequencies (n,) [rad/s]; shares (m, ...)."""
    product = frequency[:, None] * times_s
    stored = 1.0 - shares.sum(axis=0) + (product**2 / (1.0 + product**2)) @ shares
    lost = (product / (1.0 + product**2)) @ shares
    return np.asarray(lost / stored)


def relaxed(time_s: FloatArray, ordinate: FloatArray, times_s: FloatArray, shares: FloatArray) -> FloatArray:
    """Ordinates (n,) of a relaxing tissue, from elastic ones (n,), straight between their times (n,).

    Parameters
    ----------
    times_s, shares : (m,) array
        Time constants, and the shares of the moduli that relax with them.
    """
    steps_s = np.diff(time_s)[:, None] / times_s
    kept = np.exp(-steps_s)
    # Mean of e^(-(t - s)/τ) over a step; of no duration, a jump.
    added = np.where(steps_s > 0.0, -np.expm1(-steps_s) / np.where(steps_s > 0.0, steps_s, 1.0), 1.0)
    history = np.empty((ordinate.size, times_s.size))
    history[0] = ordinate[0]
    for k, rise in enumerate(np.diff(ordinate)):
        history[k + 1] = kept[k] * history[k] + added[k] * rise
    return ordinate - (ordinate[:, None] - history) @ shares


@dataclass(frozen=True, slots=True, eq=False)
class Relaxed:
    """Response of a relaxing tissue, from the response of the elastic tissue.

    Parameters
    ----------
    times_s, shares : (m,) array
    """

    times_s: FloatArray
    shares: FloatArray

    def __call__(self, response: Response) -> Response:
        """Curves after relaxation, along the same path.

        Raises
        ------
        StudyError
            The solver gives no times.
        """
        return Response(curves={name: self._relaxed(curve) for name, curve in response.curves.items()})

    def _relaxed(self, curve: Curve) -> Curve:
        if curve.time_s is None:
            raise StudyError(
                f"'{curve.channel}' has no times to relax in; use a solver that gives them, as jax does"
            )
        time, abscissa, ordinate = curve.time_s, curve.abscissa, curve.ordinate
        if np.array_equal(time, abscissa):
            # First of these points, over the shortest time constant.
            abscissa = _refined(time, 0.1 * float(self.times_s.min()))
            time, ordinate = abscissa, np.interp(abscissa, time, ordinate)
        return Curve(
            channel=curve.channel,
            abscissa=abscissa,
            ordinate=relaxed(time, ordinate, self.times_s, self.shares),
            time_s=time,
        )


def _refined(time_s: FloatArray, finest_s: float) -> FloatArray:
    """Times with more of them after each, the closer to it the more."""
    found = [time_s[-1:]]
    for start, end in pairwise(time_s.tolist()):
        decades = np.log10(max((end - start) / finest_s, 1.0))
        # Points per decade after each corner of the motion: between them the curve is straight.
        n = int(np.ceil(12 * decades))
        found.append(np.r_[start, start + np.geomspace(finest_s, end - start, n, endpoint=False)])
    return np.unique(np.concatenate(found))


class RelaxingSettings(StandardSettings):
    """Settings of the values that are searched besides the materials' parameters, with relaxation."""

    relaxation_times: tuple[Annotated[float, Quantity("s")], ...] = Field(
        (0.1, 1.0, 10.0, 100.0),
        min_length=1,
        description="Time constants [s]; the share of each is searched.",
    )
    relaxation_upper: Annotated[float, Quantity("1")] = Field(
        0.8, gt=0.0, lt=1.0, description="Largest share of the moduli that relaxes with one of them."
    )

    @field_validator("relaxation_times")
    @classmethod
    def _check(cls, times: tuple[float, ...]) -> tuple[float, ...]:
        return checked_times(times)


class Relaxing(StandardParametrisation):
    """Searched values of an elastic study, and the share of the moduli that relaxes with each time."""

    name = "relaxing"
    summary = "the materials' parameters at once, and how far the moduli relax with each of some times"
    relaxing = frozenset({FORCE.name, FORCE_OVER_TIME.name})
    Settings = RelaxingSettings
    settings: RelaxingSettings

    @property
    def times_s(self) -> dict[str, float]:
        """Time constants, by the names of their shares."""
        return {f"relaxed.{time_name(time)}": time for time in self.settings.relaxation_times}

    def parameters(self, space: ParameterSpace, spots: Sequence[str]) -> tuple[Parameter, ...]:
        """Parameters of the standard parametrisation, then a share for each time, the same at all spots."""
        upper = self.settings.relaxation_upper
        own = [relaxed_share(name, time, upper) for name, time in self.times_s.items()]
        return (*super().parameters(space, spots), *for_each_spot(own, spots))

    def inputs(
        self, space: ParameterSpace, spot: str, protocol: Protocol, values: Mapping[str, float]
    ) -> SpotInputs:
        """Inputs of the standard parametrisation, and the relaxation of their curves."""
        if not isinstance(protocol, Indentation) or protocol.time_s is None:
            raise StudyError('a tissue that relaxes needs the times of its press; use motion = "moves"')
        for region in space.regions:
            if region.material.relaxation_times_s:
                raise StudyError(
                    f"region '{region.region}' relaxes in the solver already; remove its relaxation_times, "
                    'or choose parametrisation = "standard"'
                )
        shares = np.array([values[name] for name in self.times_s])
        if not shares.sum() < 1.0:
            raise ParameterError(f"shares that relax add up to {shares.sum():.3g}; they are less than 1")
        found = super().inputs(space, spot, protocol, values)
        return replace(found, observe=Relaxed(np.array(self.settings.relaxation_times), shares))

    def start(self, protocols: Mapping[str, Protocol]) -> dict[str, float]:
        """Start of the standard parametrisation, and a little relaxation with each time."""
        # Share of each time at which a search starts.
        usual = min(0.1, 0.5 / len(self.times_s))
        return super().start(protocols) | dict.fromkeys(self.times_s, usual)

    def unusable(self, channels: Sequence[str], *, indents: bool) -> Iterator[tuple[tuple[str, ...], str]]:
        """Relaxation of homogeneous tests, which have no times."""
        if not indents:
            yield ("relaxation_times",), 'homogeneous tests have no times; use parametrisation = "standard"'
        yield from super().unusable(channels, indents=indents)
