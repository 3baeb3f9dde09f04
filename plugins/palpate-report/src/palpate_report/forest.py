"""The parameters of every spot and scenario beside those that lead: the first picture of the page."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from palpate_report.best_sets import Best, leading
from palpate_report.marks import Headline, rounded
from palpate_report.report_data import ReportData, label_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """A value with its interval on the axis of its parameter.

    Parameters
    ----------
    scenario : int
        Its number in the study.
    value, lower, upper : float or None
        Percent of the axis; an interval ends with the axis where it reaches beyond it.
    text : str
        The same in numbers.
    """

    scenario: int
    value: float | None
    lower: float | None
    upper: float | None
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """Marks of a spot by parameter, then by scenario; ``differs`` names parameters apart from the lead's."""

    label: str
    differs: tuple[str, ...]
    marks: tuple[tuple[Mark, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """Axis of a parameter, with the known answer and the interval that leads in percent of it."""

    label: str
    low: float
    high: float
    is_log: bool
    truth: float | None = None
    band: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Forest:
    """Rows of the joint fit, if there is one, and of every spot."""

    axes: tuple[Axis, ...]
    rows: tuple[Row, ...]

    @property
    def apart(self) -> dict[str, tuple[str, ...]]:
        """Parameters by spot whose interval does not meet that of the joint fit."""
        return {row.label: row.differs for row in self.rows if row.differs}


def forest(data: ReportData, bests: Sequence[Best]) -> Forest:
    """Lay out the intervals, or values without them, of everything that was fitted or selected."""
    by_spot: dict[str, dict[str, Best]] = {}
    for best in bests:
        by_spot.setdefault(best.spot, {})[best.scenario] = best
    axes = tuple(_axis(data, bests, i, name) for i, name in enumerate(data.searched))
    lead = leading(data, bests)
    numbers = {scenario.name: k for k, scenario in enumerate(data.study.scenarios)}
    rows = []
    for spot, found in by_spot.items():
        marks = tuple(
            tuple(_mark(axis, numbers[scenario], best.values[i]) for scenario, best in found.items())
            for i, axis in enumerate(axes)
        )
        own = found.get(data.generalising.name)
        rows.append(Row(label=spot, differs=tuple(_differs(own, lead)), marks=marks))
    return Forest(axes=axes, rows=tuple(rows))


def _differs(own: Best | None, lead: Best | None) -> Iterator[str]:
    """Parameters whose 95 % intervals are apart."""
    for one, other in zip(own.values, lead.values, strict=True) if own and lead else ():
        if None in (one.lower, one.upper, other.lower, other.upper) or not (one.level and other.level):
            continue
        if one.lower > other.upper or one.upper < other.lower:  # type: ignore[operator]
            yield one.parameter


def _axis(data: ReportData, bests: Sequence[Best], i: int, name: str) -> Axis:
    """Axis that holds every value, and every interval of the scenario that generalises."""
    parameter, truth = data.searched[name], data.study.truth.get(name)
    shown = [truth, *(best.values[i].value for best in bests)]
    for best in bests:
        if best.scenario == data.generalising.name:
            shown += [best.values[i].lower, best.values[i].upper]
    known = [value for value in shown if value is not None]
    is_log = parameter.scale == "log" and min(known, default=0.0) > 0.0
    low, high = _widened(known or [parameter.lower, parameter.upper], is_log=is_log)
    axis = Axis(label=label_of(parameter), low=low, high=high, is_log=is_log)
    if truth is not None:
        axis = replace(axis, truth=_percent(axis, truth))
    leads = leading(data, bests)
    lead = None if leads is None else leads.values[i]
    if lead is None or lead.lower is None or lead.upper is None or len(data.spots) == 1:
        return axis
    return replace(axis, band=(_percent(axis, lead.lower), _percent(axis, lead.upper)))


def _widened(known: Sequence[float], *, is_log: bool) -> tuple[float, float]:
    low, high = min(known), max(known)
    if is_log:
        margin = max((high / low) ** 0.06, 1.01)
        return low / margin, high * margin
    margin = 0.06 * (high - low) or 0.01 * abs(high) or 1.0
    return low - margin, high + margin


def _percent(axis: Axis, value: float) -> float:
    ends = (axis.low, value, axis.high)
    low, at, high = map(math.log, ends) if axis.is_log and value > 0.0 else ends
    return round(min(max(100.0 * (at - low) / (high - low), 0.0), 100.0), 2)


def _mark(axis: Axis, scenario: int, value: Headline) -> Mark:
    at = {end: getattr(value, end) for end in ("value", "lower", "upper")}
    known = {end: None if number is None else _percent(axis, number) for end, number in at.items()}
    ends = (value.lower, value.upper)
    text = "by spot" if value.value is None else rounded(value.value, *ends)
    if value.lower is not None and value.upper is not None:
        text += f" ({rounded(value.lower, *ends)} to {rounded(value.upper, *ends)})"
    return Mark(scenario=scenario, text=text, **known)
