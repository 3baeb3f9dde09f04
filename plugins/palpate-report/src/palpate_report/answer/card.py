"""The first card of the page: what was found, how sure it is, and what it rests on."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from palpate_report.answer.best_sets import Best, leading
from palpate_report.answer.model_verdict import r2_by_spot
from palpate_report.answer.next_step import CAUSES
from palpate_report.answer.result import Conclusion
from palpate_report.answer.warnings import GOOD_R2, NO_FIT_R2
from palpate_report.data.marks import Headline
from palpate_report.data.report_data import ReportData

MOST_CAUSES = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class SummaryCard:
    """The card: title, what it is of, values, facts by name, and whether intervals are of 95 %."""

    title: str
    about: str
    lines: tuple[Headline, ...]
    facts: tuple[tuple[str, str], ...]
    is_sure: bool


def answer(data: ReportData, conclusion: Conclusion) -> SummaryCard:
    """Sum up what leads: the joint fit, the set for all spots, or the best set of the only spot."""
    n_spots = len(data.spots)
    material = " and ".join(
        dict.fromkeys(
            r.material.name for r in data.study.space.regions if data.study.space.columns_of(r.region)
        )
    )
    where = f"all {n_spots} spots" if n_spots > 1 else f"spot {data.spots[0]}"
    fitted = f"fitted to {' + '.join(data.generalising.weighed)} (scenario {data.generalising.name})"
    start = "the sweep" if data.design.n_sets else "the middle of the ranges"
    by = f"Searched from {start}" if data.is_fitted else "Best set of the sweep"
    facts = {
        "Next": conclusion.next_step,
        "Fit": "; ".join(_quality(data, conclusion)),
        "Spots": _spots(data, conclusion),
        "Certainty": "" if conclusion.failure else _causes(data),
        "NOT included": ", ".join(conclusion.not_included),
        "Known": conclusion.known,
        "Rests on": conclusion.spent
        or f"{sum(data.completeness.simulated.values())} simulations of the sweep.",
    }
    return SummaryCard(
        title="No parameters from this run"
        if conclusion.failure
        else f"{material.capitalize()}, one for {where}",
        about=f"{by}, {fitted}",
        lines=(*conclusion.estimates, *conclusion.moduli),
        facts=tuple((name, text) for name, text in facts.items() if text),
        is_sure=any(value.level for each in conclusion.bests for value in each.values),
    )


def _quality(data: ReportData, conclusion: Conclusion) -> Iterator[str]:
    rows = list(r2_by_spot(data, conclusion.bests))
    for channel in dict.fromkeys(name for name, _, _ in rows):
        r2, spot = min((r2, spot) for name, spot, r2 in rows if name == channel)
        word = "good" if r2 >= GOOD_R2 else "poor" if r2 >= NO_FIT_R2 else "no fit"
        least = f" at {spot} (the least)" if len(data.spots) > 1 else ""
        yield f"{channel}: {word}, R² {r2:.4g}{least}"


def _spots(data: ReportData, conclusion: Conclusion) -> str:
    """Spots that are used, and the one that differs from the joint fit."""
    used = f"{len(data.spots)} used ({', '.join(data.spots[:6])}{', …' if len(data.spots) > 6 else ''})"
    if len(data.spots) == 1 or not data.is_fitted:
        return used
    if found := apart_from_joint(data, conclusion.bests):
        apart = "; ".join(f"{spot} ({', '.join(names)})" for spot, names in found.items())
        return f"{used}; intervals apart from the joint fit's: {apart}"
    if conclusion.failure or not any(each.level for each in conclusion.estimates):
        return used
    return f"{used}; none differs from the joint fit by more than the intervals"


def apart_from_joint(data: ReportData, bests: Sequence[Best]) -> dict[str, list[str]]:
    """Parameters by spot whose 95 % interval does not meet that of the fit that leads."""
    lead = leading(data, bests)
    found: dict[str, list[str]] = {}
    for best in bests:
        if lead is None or best.scenario != lead.scenario:
            continue
        for one, other in zip(best.values, lead.values, strict=True):
            ends = (one.lower, one.upper, other.lower, other.upper)
            if None in ends or not (one.level and other.level):
                continue
            if one.lower > other.upper or one.upper < other.lower:  # type: ignore[operator]
                found.setdefault(best.spot, []).append(one.parameter)
    return found


def _causes(data: ReportData) -> str:
    """Causes that the widest interval is mostly due to."""
    certainty = data.fit.certainty
    rows, budget = data.leading_rows(certainty.intervals), data.leading_rows(certainty.budget)
    if rows.is_empty() or budget.is_empty():
        return ""
    name = rows.sort("relative_width", descending=True)["parameter"][0]
    known = budget.filter(parameter=name).drop_nulls("share")
    causes = known.sort("share", descending=True).head(MOST_CAUSES)
    shares = " and ".join(
        f"{CAUSES.get(row['cause'], row['cause'])} ({100.0 * row['share']:.0f} %)"
        for row in causes.iter_rows(named=True)
    )
    return f"widest for {data.brief_name(name)}, mostly by {shares}"
