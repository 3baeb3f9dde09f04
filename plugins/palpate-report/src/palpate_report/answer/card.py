"""The first card of the page: what was found, how sure it is, and what it rests on."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from palpate.api import ParameterName, ParameterSpace
from palpate.api.fit import EFFECTIVE, MODULI, THRESHOLDS
from palpate.api.report import ReportWarning, shown
from palpate_report.answer.headline import between_spots, least_fopt
from palpate_report.answer.law import laws_of, searched_laws
from palpate_report.answer.model_verdict import least_r2
from palpate_report.answer.next_step import cause_name
from palpate_report.answer.result import Conclusion
from palpate_report.data.marks import Headline, in_words, with_unit
from palpate_report.data.report_data import ReportData

IN_THE_OPEN = 3
"""Warnings on the first screen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SummaryCard:
    """The first card of the page.

    Parameters
    ----------
    title : str
        The answer in one sentence, or that there are no parameters.
    about : str
        Curves that were fitted, and where the search began.
    laws : mapping of name to str
        Formula of each searched law.
    lines : tuple of Headline
        Values of what leads.
    cut : mapping of parameter to str
        End of its interval that is an end of the search range.
    least : str
        Values of the least Fopt next to the intervals; empty without intervals.
    warnings : tuple of ReportWarning
        The most severe ones.
    is_sure : bool
        Intervals are of 95 %.
    """

    title: str
    about: str
    laws: Mapping[str, str]
    lines: tuple[Headline, ...]
    cut: Mapping[str, str]
    least: str
    warnings: tuple[ReportWarning, ...]
    facts: tuple[tuple[str, str], ...]
    is_sure: bool


def answer(data: ReportData, conclusion: Conclusion) -> SummaryCard:
    """Sum up what leads: the joint fit, the set for all spots, or the best set of the only spot."""
    channels = " + ".join(map(in_words, data.generalising.weighed))
    fitted = f"fitted to {channels} (scenario {data.generalising.name})"
    start = "the sweep" if data.design.n_sets else "the middle of the ranges"
    by = f"Searched from {start}" if data.is_fitted else "Best set of the sweep"
    facts = {
        "Fit": quality(data),
        "Spots": _spots(data, conclusion),
        "Certainty": "" if conclusion.failure else causes(data),
        **conclusion.facts,
        "Based on": conclusion.spent
        or f"{sum(data.completeness.simulated.values())} simulations of the sweep.",
    }
    return SummaryCard(
        title="No parameters from this run" if conclusion.failure else sentence(data, conclusion),
        about=f"{by}, {fitted}",
        laws=laws_of(data.study.space),
        cut={} if conclusion.failure else cut_ends(data, conclusion.estimates),
        least=least_fopt(data, conclusion.estimates),
        warnings=conclusion.warnings[:IN_THE_OPEN],
        lines=(*conclusion.estimates, *_besides(conclusion)),
        facts=tuple((name, text) for name, text in facts.items() if text),
        is_sure=any(value.level for each in conclusion.bests for value in each.values),
    )


def _besides(conclusion: Conclusion) -> Iterator[Headline]:
    """Initial shear moduli, and Young's moduli that are not a parameter already."""
    known = {(each.text, each.interval) for each in conclusion.estimates}
    for each in conclusion.moduli:
        if each.parameter.startswith(MODULI[0]) or (each.text, each.interval) not in known:
            yield each


def sentence(data: ReportData, conclusion: Conclusion) -> str:
    """The answer in one sentence: materials, moduli and the parameters that are not identified."""
    space, n_spots = data.study.space, len(data.spots)
    where = "" if n_spots > 1 else f" at spot {data.spots[0]}"
    shear = [each for each in conclusion.moduli if each.parameter.startswith(MODULI[0])]
    values = shear or [each for each in conclusion.estimates if each.identifiability in ("well", "roughly")]
    kind = f"{EFFECTIVE} " if conclusion.model.approximation else ""
    found = ", ".join(
        f"{kind}{each.parameter} {_with_error(each)}" for each in values if each.value is not None
    )
    unknown = [each.parameter for each in conclusion.estimates if each.identifiability == "not"]
    what = "tests" if data.study.protocol is None else "presses"
    verb = "is" if len(unknown) == 1 else "are"
    lost = f"{' and '.join(unknown)} {verb} not identified by these {what}" if unknown else ""
    title = title_of(space, n_spots, differ=data.spots_differ(data.generalising.name))
    return f"{title}{where}: {'; '.join(filter(None, (found, lost)))}".rstrip(": ")


def title_of(space: ParameterSpace, n_spots: int, *, differ: bool = False) -> str:
    """Law of each searched region, named where there are several, and the number of spots."""
    names = searched_laws(space) or ["fixed"]
    laws = " and ".join(names)
    if differ:
        text = f"{laws}, the mean of {n_spots} spots that differ"
    elif len(names) == 1:
        text = f"one {laws} material for all {n_spots} spots" if n_spots > 1 else f"{laws} material"
    else:
        text = laws + (f", one set for all {n_spots} spots" if n_spots > 1 else "")
    return text[0].upper() + text[1:]


def _with_error(value: Headline) -> str:
    """Value with half the width of its 95 % interval in percent, where it has one."""
    text = with_unit(value.text, value.unit)
    if value.lower is None or value.upper is None or not value.level or not value.value:
        return text
    percent = 50.0 * (value.upper - value.lower) / abs(value.value)
    return f"{text} ± {percent:.0f} %" if percent >= 1.0 else f"{text} ± {percent:.1g} %"


def cut_ends(data: ReportData, estimates: Sequence[Headline]) -> dict[str, str]:
    """Text on each interval that an end of the search range cuts off, by parameter."""
    found, ranges = {}, data.searched | data.widened
    for each in estimates:
        searched = ranges.get(ParameterName.parse(each.name).shared) if each.name else None
        if searched is None or each.lower is None or each.upper is None:
            continue
        # Share of the search range within which an end of an interval is an end of the range.
        close = 1e-3 * (searched.upper - searched.lower)
        ends = {
            "lower": abs(each.lower - searched.lower) <= close,
            "upper": abs(each.upper - searched.upper) <= close,
        }
        if cut := [name for name, is_cut in ends.items() if is_cut]:
            found[each.parameter] = f"{' and '.join(cut)} end cut by the search range"
    return found


def quality(data: ReportData) -> str:
    """R² of each fitted channel, the least of all spots, with a word for it."""
    found = []
    for channel, (r2, spot) in least_r2(data).items():
        word = "good" if r2 >= THRESHOLDS.good_r2 else "poor" if r2 >= THRESHOLDS.no_fit_r2 else "no fit"
        least = f" at {spot} (the least)" if len(data.spots) > 1 else ""
        found.append(f"{channel}: {word}, R² {shown(r2)}{least}")
    return "; ".join(found)


def _spots(data: ReportData, conclusion: Conclusion) -> str:
    """Spots that are used, and the one that differs from the joint fit."""
    used = f"{len(data.spots)} used ({', '.join(data.spots[:6])}{', …' if len(data.spots) > 6 else ''})"
    if len(data.spots) == 1 or not data.is_fitted:
        return used
    if differing := between_spots(data):
        return f"{used}; {differing}"
    if found := apart_from_joint(data):
        apart = "; ".join(f"{spot} ({', '.join(names)})" for spot, names in found.items())
        return f"{used}; intervals that do not meet the joint fit's: {apart}"
    if conclusion.failure or not any(each.level for each in conclusion.estimates):
        return used
    return f"{used}; every spot agrees with the joint fit within its 95 % interval"


def apart_from_joint(data: ReportData) -> dict[str, list[str]]:
    """Parameters by spot whose 95 % interval does not meet the interval of the fit that leads."""
    lead = data.lead
    found: dict[str, list[str]] = {}
    for best in data.bests:
        if lead is None or best.scenario != lead.scenario:
            continue
        for one, other in zip(best.values, lead.values, strict=True):
            ends = (one.lower, one.upper, other.lower, other.upper)
            if None in ends or not (one.level and other.level):
                continue
            if one.lower > other.upper or one.upper < other.lower:  # type: ignore[operator]
                found.setdefault(best.spot, []).append(one.parameter)
    return found


def causes(data: ReportData) -> str:
    """Causes that the widest interval is mostly due to."""
    rows, budget = data.leading_rows(data.fit.intervals), data.leading_rows(data.table("budget"))
    if rows.is_empty() or budget.is_empty():
        return ""
    name = rows.sort("relative_width", descending=True)["parameter"][0]
    known = budget.filter(parameter=name).drop_nulls("share")
    most = known.sort("share", descending=True).head(2)
    shares = " and ".join(
        f"{cause_name(data, row['cause'])} ({100.0 * row['share']:.0f} %)"
        for row in most.iter_rows(named=True)
    )
    least = "least certain: " if len(data.brief) > 1 else "interval of "
    return f"{least}{data.brief_name(name)}, mostly by {shares}"
