"""What limits the result of a run, and why."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import polars as pl

from palpate.domain import Parameter
from palpate.report.best_sets import (
    Best,
    identifiability_together,
    identifiability_when_generalising,
    with_brief_names,
)
from palpate.report.report_data import ReportData
from palpate.report.tables import cost_of_one_set, finding
from palpate.stages.completeness import described
from palpate.stages.experiment import measured_warnings
from palpate.stages.identifiability import UNCLEAR, share_of_range
from palpate.stages.selection import by_reason, failures, unranked

GOOD_R2 = 0.95
"""R² in a fitted channel below which a fit is called poor."""

FEW_SETS = 10
"""Sets per parameter below which a sweep is called thin."""

NO_FIT_R2 = 0.5
"""R² in a fitted channel below which a set is not called a fit."""

CHECK = (
    "Check the units, the signs and the order of turns of the measured curves, then friction, ranges "
    "and the number of sets."
)
"""What to do about a set that does not fit."""

CAUSES = (
    "an offset of the depth, compliance of the robot or the mount, bias of a sensor, a lag between motion "
    "and force, a wrong friction, "
)
"""Why force and torque of a press may disagree."""

EDGE = 0.01
"""Share of a range within which a value is at its end."""

FAILED_SHARE = 0.1
"""Share of simulations without a rank that is worth a word."""

COSTLY = 3.0
"""Times its own least Fopt at which the set for all spots is called poor for a spot."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportWarning:
    """A warning of the report: what is wrong, and why it matters or what to do."""

    what: str
    why: str

    def __str__(self) -> str:
        return f"{self.what}. {self.why}"


def report_warnings(
    data: ReportData, bests: Sequence[Best], tables: Mapping[str, pl.DataFrame]
) -> Iterator[ReportWarning]:
    """Every warning of a run, the most severe first."""
    yield from _about_no_fit(data, bests)
    yield from _about_missing(data)
    yield from _about_fits(data, bests)
    yield from _about_one_set(data)
    yield from _about_failures(data)
    yield from _about_disagreement(data)
    yield from _about_ends(data, bests)
    yield from _about_identifiability(data)
    yield from _about_searches(data)
    yield from _about_proofs(data)
    yield from _about_comparisons(data)
    yield from _about_sweep(data)
    yield from _about_coarseness(data, bests)
    yield from _about_data(data)
    yield from _about_trust(data)
    if sentence := finding(tables):
        what, _, why = sentence.partition(": ")
        yield ReportWarning(what=what, why=why[:1].upper() + why[1:])
    yield from _about_conventions(data)


def _about_missing(data: ReportData) -> Iterator[ReportWarning]:
    found = data.completeness
    if not found.is_complete:
        yield ReportWarning(
            what="Incomplete sweep",
            why=f"{found}. A set that was not simulated may fit better; run `palpate run` again to "
            "simulate the rest.",
        )
    if missing := data.without_result:
        yield ReportWarning(
            what=f"No result for {len(missing)} of {len(data.spots) * len(data.study.scenarios)} "
            "spots and scenarios",
            why=f"{described(missing)}.",
        )
    unscored = [
        f"{channel} at {spot}"
        for (spot, channel), rows in data.scores.group_by("spot", "channel", maintain_order=True)
        if rows["nmse"].is_null().all() and spot in data.selection["spot"]
    ]
    if unscored:
        yield ReportWarning(
            what="A measured channel could not be compared with any simulation",
            why=f"{_some(unscored)}. The simulated curve is missing or does not reach far enough.",
        )


def _about_data(data: ReportData) -> Iterator[ReportWarning]:
    if odd := measured_warnings(data.measured):
        yield ReportWarning(what="Something is odd about the measured curves", why=f"{_some(odd)}.")
    curves = [curve for response in data.measured.values() for curve in response.curves.values()]
    if not data.notice and all(curve.std is None for curve in curves):
        yield ReportWarning(
            what="No spread was measured",
            why="Without repeated presses nothing is known of how much another press would differ from these "
            "curves; the intervals rest on the misfit alone.",
        )


def _about_fits(data: ReportData, bests: Sequence[Best]) -> Iterator[ReportWarning]:
    poor = [
        f"{best.spot}, scenario {best.scenario}: {channel} R² {r2:.3f}"
        for best in bests
        for channel, r2 in _r2_of_fitted(data, best)
        if NO_FIT_R2 <= r2 < GOOD_R2
    ]
    if poor:
        yield ReportWarning(
            what=f"{len(poor)} of the best fits {'is' if len(poor) == 1 else 'are'} poor",
            why=f"{_some(poor)}. The material, the mesh or the contact may not be what was pressed.",
        )
    unfinished = [f"{best.spot}, scenario {best.scenario}" for best in bests if "unfinished" in best.found]
    if unfinished:
        yield ReportWarning(
            what="A best set is of a simulation that did not finish",
            why=f"{_some(unfinished)}. It is ranked by what its curves had reached.",
        )


def _about_no_fit(data: ReportData, bests: Sequence[Best]) -> Iterator[ReportWarning]:
    wrong = [
        f"{best.spot}, scenario {best.scenario}: {channel} R² {r2:.3g}"
        for best in bests
        for channel, r2 in _r2_of_fitted(data, best)
        if r2 < NO_FIT_R2
    ]
    if wrong:
        yield ReportWarning(what=f"{len(wrong)} of the best sets do not fit", why=f"{_some(wrong)}. {CHECK}")


def _r2_of_fitted(data: ReportData, best: Best) -> Iterator[tuple[str, float]]:
    scenario = next(s for s in data.study.scenarios if s.name == best.scenario)
    for channel, weight in scenario.weights.items():
        if weight > 0.0 and (r2 := best.r2.get(channel)) is not None:
            yield channel, r2


def _about_disagreement(data: ReportData) -> Iterator[ReportWarning]:
    if data.disagreements.is_empty():
        return
    brief = {p.name: b.name for p, b in with_brief_names(data)}
    causes = "" if data.study.protocol is None else CAUSES
    for (first, second), rows in data.disagreements.group_by("first", "second", maintain_order=True):
        values = [
            f"{brief[row['parameter']]} at {row['spot']}: {row['first_optimum']:.4g} by {first}, "
            f"{row['second_optimum']:.4g} by {second}{'' if row['unit'] == '1' else ' ' + row['unit']}"
            for row in rows.drop_nulls("parameter").iter_rows(named=True)
        ]
        spots = ", ".join(rows["spot"].unique(maintain_order=True))
        yield ReportWarning(
            what=f"{str(first).capitalize()} and {second} disagree",
            why=f"{_some(values) or f'At {spots}'}. No set fits both about as well as each is fitted alone. "
            f"Typical causes: {causes}a material law that cannot describe both.",
        )


def _about_ends(data: ReportData, bests: Sequence[Best]) -> Iterator[ReportWarning]:
    ends = [
        f"{brief.name} at {best.spot}, scenario {best.scenario}"
        for best in bests
        for i, (parameter, brief) in enumerate(with_brief_names(data))
        if _at_end(data, parameter, i, best)
    ]
    if ends:
        yield ReportWarning(
            what="Best values are at the end of their range",
            why=f"{_some(ends)}. Widen the range: the minimum may be outside.",
        )


def _about_trust(data: ReportData) -> Iterator[ReportWarning]:
    if names := list(data.manifest.get("trusted", {})):
        yield ReportWarning(
            what=f"Results of earlier code are accepted: {', '.join(names)}",
            why="Simulations of the sweep were made with other code than the local search, the stiffness "
            "scaling and the verification. Run in a new folder to have all of the same code.",
        )


def _at_end(data: ReportData, parameter: Parameter, i: int, best: Best) -> bool:
    """Whether a best set is the outermost of the design, or within a spacing of the range's end.

    Not where the curves show that the optimum is inside, or do not depend on the parameter.
    """
    value, drawn = best.values[i], data.design.values[:, i]
    if value.identifiability == "not":
        return False
    if value.lower is not None and value.upper is not None:
        ends = [share_of_range(parameter, end) for end in (value.lower, value.upper)]
        if ends[0] > EDGE and ends[1] < 1.0 - EDGE:
            return False
    spacing = EDGE if best.found == "refined" else max(EDGE, 1.0 / data.design.n_sets)
    is_outermost = best.found != "refined" and value.value in (drawn.min(), drawn.max())
    return is_outermost or not spacing < share_of_range(parameter, value.value) < 1.0 - spacing


def _about_identifiability(data: ReportData) -> Iterator[ReportWarning]:
    rows = identifiability_when_generalising(data)
    brief = {p.name: b.name for p, b in with_brief_names(data)}
    together = identifiability_together(data)
    names = list(dict.fromkeys(together.filter(pl.col("identifiability") == "not")["parameter"]))
    if names:
        yield ReportWarning(
            what=f"Not identifiable: {', '.join(brief[name] for name in names)}",
            why="Sets that fit about as well reach across most of the range; "
            "do not read the value as the tissue's.",
        )
    if UNCLEAR in pl.concat([rows, together])["identifiability"].to_list():
        yield ReportWarning(
            what="How well some parameters are identified is unclear",
            why="Few sets were ranked, or their curves follow the parameters too unevenly. Run more sets.",
        )
    apart = [text for name in brief for text in _apart(rows, name, brief[name])]
    if apart:
        yield ReportWarning(
            what="The spots disagree",
            why=f"{_some(apart)}. One material may not explain them all.",
        )


def _apart(rows: pl.DataFrame, parameter: str, name: str) -> Iterator[str]:
    known = rows.filter(pl.col("parameter") == parameter).drop_nulls("lower")
    if known.height > 1 and known["lower"].max() > known["upper"].min():  # type: ignore[operator]
        highest, lowest = known.sort("lower").row(-1, named=True), known.sort("upper").row(0, named=True)
        yield f"{name} at {lowest['spot']} and {highest['spot']} have intervals that do not meet"


def _about_one_set(data: ReportData) -> Iterator[ReportWarning]:
    if len(data.spots) < 2:
        return
    costs = cost_of_one_set(data)
    if costs.is_empty():
        yield ReportWarning(what="No set for all spots", why="No set could be ranked at every spot.")
        return
    costly = [
        f"{row['spot']} ({row['times']:.3g} times)"
        for row in costs.iter_rows(named=True)
        if row["times"] is not None and row["times"] >= COSTLY
    ]
    if costly:
        yield ReportWarning(
            what="The set for all spots fits some spots much worse than their best set",
            why=f"Fopt of the one set, over the least there: {_some(costly)}.",
        )


def _about_sweep(data: ReportData) -> Iterator[ReportWarning]:
    n_parameters = len(data.design.parameters)
    n_sets = min(data.completeness.simulated.values())
    if n_sets < FEW_SETS * n_parameters and data.refined.table.is_empty():
        yield ReportWarning(
            what=f"A thin sweep: {n_sets} sets for {n_parameters} parameters",
            why="The best set is the best of few; raise n_sets, or refine.",
        )


def _about_coarseness(data: ReportData, bests: Sequence[Best]) -> Iterator[ReportWarning]:
    outside = [
        f"{brief.name} at {best.spot}: set {value.value:.4g}, optimum {value.optimum:.4g}"
        for best in bests
        if best.scenario == data.generalising.name and best.found != "refined"
        for (_, brief), value in zip(with_brief_names(data), best.values, strict=True)
        if value.optimum is not None and value.lower is not None and value.upper is not None
        if not value.lower <= value.value <= value.upper
    ]
    if outside:
        yield ReportWarning(
            what="The optimum is between the sampled sets",
            why=f"{_some(outside)}. Search locally from the best sets ([selection] refine = true), "
            "or raise n_sets.",
        )


def _about_failures(data: ReportData) -> Iterator[ReportWarning]:
    jobs = data.scores.select("spot", "set_id").unique().height
    reasons = by_reason(failures(unranked(data.scores)))
    n_failed = int(reasons["n"].sum()) if reasons.height else 0
    if n_failed > FAILED_SHARE * jobs:
        first = reasons.row(0, named=True)
        said = first["reason"] or first["status"]
        yield ReportWarning(
            what=f"{n_failed} of {jobs} simulations could not be ranked",
            why=f"Most often ({first['n']}): {said}. What to try: {first['remedy']}.",
        )


def _about_searches(data: ReportData) -> Iterator[ReportWarning]:
    for table, expected, what in (
        (data.refined.table, "converged", "Not every local search converged"),
        (data.stiffness_scaling, "as expected", "Not every multiple of a set is as expected"),
    ):
        messages = [row["message"] for row in table.iter_rows(named=True) if row["message"] != expected]
        if messages:
            yield ReportWarning(what=what, why=f"{_some(list(dict.fromkeys(messages)))}.")


def _about_conventions(data: ReportData) -> Iterator[ReportWarning]:
    if data.study.scoring.normaliser.value == "mean":
        yield ReportWarning(
            what="NMSE is over the mean of the measured curve",
            why="Over a symmetric twist that is close to zero, and inflates the error of the torque.",
        )
    for region in data.study.space.regions:
        if region.convention != "textbook":
            yield ReportWarning(
                what=f"Coefficients of {region.region} are in the convention '{region.convention}'",
                why=f"The textbook's {region.material.name} has other numbers for the same material.",
            )


def _about_proofs(data: ReportData) -> Iterator[ReportWarning]:
    failed = [row for row in data.verification.iter_rows(named=True) if not row["passed"]]
    if failed:
        yield ReportWarning(
            what=f"{len(failed)} of {len(data.verification)} selected sets failed verification",
            why=_some([f"{row['spot']}, set {row['set_id']}: {row['message']}" for row in failed]),
        )


def _about_comparisons(data: ReportData) -> Iterator[ReportWarning]:
    for file, comparison in data.comparisons.items():
        if not isinstance(comparison, Mapping) or comparison.get("passed") is not True:
            yield ReportWarning(
                what="The solvers were not found to agree",
                why=f"See the rows of {file} under provenance.",
            )


def _some(texts: Sequence[str], most: int = 4) -> str:
    more = f"; and {len(texts) - most} more" if len(texts) > most else ""
    return "; ".join(texts[:most]) + more
