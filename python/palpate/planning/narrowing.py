"""Which further presses narrow an interval most, one after the other."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.certainty.laplace import RANGE_SD, Laplace
from palpate.domain import FloatArray, Parameter
from palpate.errors import StudyError
from palpate.planning.evidence import Evidence, total
from palpate.planning.presses import SimulatedPress

ALL, WORST = "all", "worst"
"""Goals: the volume of the joint region, and the relative width of the parameter that is known least."""

MOST_WIDER = 1.1
"""Width of an interval, over that before, up to which a press counts as one that widens none."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Goal:
    """What is to become narrower.

    Parameters
    ----------
    name : str
        ``all``, ``worst`` or the name of a parameter; any other name with a ``gradient``.
    parameters : tuple of Parameter
        Those that all presses share.
    values : (n_parameters,) array
        Where the fit has ended.
    gradient : (n_parameters,) array, optional
        Derivative of a prediction in each parameter, per its unit.
    """

    name: str
    parameters: tuple[Parameter, ...]
    values: FloatArray
    gradient: FloatArray | None = None

    def __post_init__(self) -> None:
        names = [p.name for p in self.parameters]
        if self.gradient is None and self.name not in (ALL, WORST, *names):
            raise StudyError(
                f"'{self.name}' is nothing to narrow; name one of {', '.join([ALL, WORST, *names])}"
            )

    def width(self, covariance: FloatArray) -> float:
        """Width to be narrowed, in some unit, of a covariance (n, n) in shares of the ranges."""
        ranges = np.array([p.upper - p.lower for p in self.parameters])
        sds = np.sqrt(np.diag(covariance)) * ranges
        if self.gradient is not None:
            along = self.gradient * ranges
            return float(np.sqrt(along @ covariance @ along))
        if self.name == ALL:
            return float(np.exp(0.5 * np.linalg.slogdet(covariance)[1] / len(covariance)))
        if self.name == WORST:
            return float((sds / np.maximum(np.abs(self.values), 1e-3 * ranges)).max())
        return float(sds[[p.name for p in self.parameters].index(self.name)])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Narrowing:
    """What a press is expected to do.

    Parameters
    ----------
    press : SimulatedPress
    goal : float
        Width of the goal over that before the press, in the mean over the points.
    widths : (n_parameters,) array
        Of each parameter, likewise.
    covariance : (n_parameters, n_parameters) array
        After it, at the first point, as :attr:`Plan.covariance` is.
    """

    press: SimulatedPress
    goal: float
    widths: FloatArray
    covariance: FloatArray


class Plan:
    """Presses so far, to which the ones that narrow most are added.

    Parameters
    ----------
    so_far : sequence of SimulatedPress
    goal : Goal
    known : Evidence
        Of no press: what priors tell.
    n_points : int
    """

    def __init__(self, so_far: Sequence[SimulatedPress], goal: Goal, known: Evidence, n_points: int) -> None:
        self.goal = goal
        self._times: dict[str, int] = {}
        n = len(goal.parameters)
        self._evidence = [
            total([known, *(each.at[k].evidence for each in so_far)], n) for k in range(n_points)
        ]

    @property
    def covariance(self) -> FloatArray:
        """Covariance (n_parameters, n_parameters) at the first point, in shares of the ranges.

        It knows little of the ranges, as that of a fit: :func:`interval` cuts it off at them.
        """
        return self._evidence[0].covariance(RANGE_SD)

    def ranked(self, presses: Sequence[SimulatedPress]) -> list[Narrowing]:
        """What each of these presses would do next, the best first; last those that widen an interval.

        Fopt weighs every press alike, so that one that shows a parameter badly may widen its interval.
        """
        before = [evidence.covariance() for evidence in self._evidence]
        found = [self._narrowing(each, before) for each in presses if each.at]
        return sorted(found, key=lambda each: (each.widths.max() > MOST_WIDER, each.goal))

    def add(self, press: SimulatedPress) -> None:
        """Make a press part of what is known."""
        self._evidence = self._with(press)
        self._times[press.press.name] = self._times.get(press.press.name, 0) + 1

    def _with(self, press: SimulatedPress) -> list[Evidence]:
        name = press.press.name
        times = self._times.get(name, 0)
        added = [at.evidence.again(name, times) if times else at.evidence for at in press.at]
        return [known + more for known, more in zip(self._evidence, added, strict=True)]

    def _narrowing(self, press: SimulatedPress, before: Sequence[FloatArray]) -> Narrowing:
        after = [evidence.covariance() for evidence in self._with(press)]
        pairs = list(zip(before, after, strict=True))
        widths = [np.sqrt(np.diag(new) / np.diag(old)) for old, new in pairs]
        goals = [self.goal.width(new) / self.goal.width(old) for old, new in pairs]
        return Narrowing(
            press=press,
            goal=float(np.mean(goals)),
            widths=np.mean(widths, axis=0),
            covariance=self._with(press)[0].covariance(RANGE_SD),
        )


def interval(goal: Goal, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ends (n_parameters,) of the 95 % intervals around the goal's values, cut off at the ranges."""
    lower, upper = (np.array([getattr(p, end) for p in goal.parameters]) for end in ("lower", "upper"))
    shares = (goal.values - lower) / (upper - lower)
    density = Laplace(centre=shares, covariance=covariance, shares={}).within()
    ends = density.interval(shares)
    return lower + (upper - lower) * ends[0], lower + (upper - lower) * ends[1]
