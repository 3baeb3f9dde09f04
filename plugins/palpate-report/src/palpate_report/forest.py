"""The parameters of every spot and scenario next to those that lead: the first picture of the page."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from palpate_report.best_sets import Best, leading
from palpate_report.marks import Headline
from palpate_report.report_data import ReportData, label_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """Best sets of a spot by number of the scenario; ``differs`` names parameters apart from the lead's."""

    label: str
    differs: tuple[str, ...]
    bests: dict[int, Best]


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """Axis of a parameter, with the known answer and, of several spots, the value that leads."""

    label: str
    low: float
    high: float
    is_log: bool
    truth: float | None = None
    lead: Headline | None = None

    def percent(self, value: float) -> float:
        """Place of a value in percent of the axis; an end of it where it reaches beyond."""
        ends = (self.low, value, self.high)
        low, at, high = map(math.log, ends) if self.is_log and value > 0.0 else ends
        return round(min(max(100.0 * (at - low) / (high - low), 0.0), 100.0), 2)


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
    lead = leading(data, bests)
    numbers = {scenario.name: k for k, scenario in enumerate(data.study.scenarios)}
    rows = []
    for spot in dict.fromkeys(best.spot for best in bests):
        found = {numbers[best.scenario]: best for best in bests if best.spot == spot}
        differs = tuple(_differs(found.get(numbers[data.generalising.name]), lead))
        rows.append(Row(label=spot, differs=differs, bests=found))
    axes = tuple(_axis(data, bests, lead, i, name) for i, name in enumerate(data.searched))
    return Forest(axes=axes, rows=tuple(rows))


def _differs(own: Best | None, lead: Best | None) -> Iterator[str]:
    """Parameters whose 95 % intervals are apart."""
    for one, other in zip(own.values, lead.values, strict=True) if own and lead else ():
        if None in (one.lower, one.upper, other.lower, other.upper) or not (one.level and other.level):
            continue
        if one.lower > other.upper or one.upper < other.lower:  # type: ignore[operator]
            yield one.parameter


def _axis(data: ReportData, bests: Sequence[Best], lead: Best | None, i: int, name: str) -> Axis:
    """Axis that holds every value, and every interval of the scenario that generalises."""
    parameter, truth = data.searched[name], data.study.truth.get(name)
    shown = [truth, *(best.values[i].value for best in bests)]
    for best in bests:
        if best.scenario == data.generalising.name:
            shown += [best.values[i].lower, best.values[i].upper]
    known = [value for value in shown if value is not None]
    is_log = parameter.scale == "log" and min(known, default=0.0) > 0.0
    low, high = _widened(known or [parameter.lower, parameter.upper], is_log=is_log)
    return Axis(
        label=label_of(parameter),
        low=low,
        high=high,
        is_log=is_log,
        truth=truth,
        lead=None if lead is None or len(data.spots) == 1 else lead.values[i],
    )


def _widened(known: Sequence[float], *, is_log: bool) -> tuple[float, float]:
    low, high = min(known), max(known)
    if is_log:
        margin = max((high / low) ** 0.06, 1.01)
        return low / margin, high * margin
    margin = 0.06 * (high - low) or 0.01 * abs(high) or 1.0
    return low - margin, high + margin
