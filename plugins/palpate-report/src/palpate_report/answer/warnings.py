"""Warnings that limit the result of a run, and why."""

import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib.resources import files
from math import inf

import polars as pl

from palpate.api.fit import FIT, THRESHOLDS, UNCLEAR, UNSEEN, UNSETTLED, WIDENED, Adequacy
from palpate.api.report import ReportWarning
from palpate.api.runs import (
    REMEDY,
    by_reason,
    cycle_warnings,
    described,
    failures,
    limb_warnings,
    measured_warnings,
    press_warnings,
    unedited_warnings,
    unranked,
)
from palpate_report.answer.failed_checks import apparent, failed_checks, left_out
from palpate_report.answer.next_step import cause_name
from palpate_report.data.best import Best
from palpate_report.data.marks import in_words, range_of
from palpate_report.data.report_data import ReportData
from palpate_report.data.tables import cost_of_one_set, finding

FEW_SETS = 10
"""Sets per parameter below which a sweep is called thin."""

CHECK = (
    "Check the units, the signs and the columns of the measured curves, then [protocol] where there is one, "
    "the ranges and the number of sets."
)
"""What to do about a set that does not fit."""

FAILED_SHARE = 0.1
"""Share of simulations without a rank from which it is a warning."""

COSTLY = 3.0
"""Times its own least Fopt at which the set for all spots is called poor for a spot."""


def report_warnings(
    data: ReportData, tables: Mapping[str, pl.DataFrame], missed: Sequence[str] = ()
) -> Iterator[ReportWarning]:
    """Every warning and note of a run, the most severe first.

    Parameters
    ----------
    missed : sequence of str
        Intervals that do not hold the true value.
    """
    bests = data.bests
    if data.unfinished:
        linear = "First answer: intervals by linearisation, on the spots' own meshes. "
        first = "" if data.fit.intervals.is_empty() else linear
        why = f"{first}So far: {data.unfinished}. The page shows the best of the simulations so far."
        yield warn("unfinished", "The run has not ended", why)
    wrong = [(name, f"{fit} R² {at:.3g}") for name, fit, at in _r2(data, -inf, THRESHOLDS.no_fit_r2)]
    yield from _by_scenario(data, "no-fit", "{n} best {set} {do} not fit", wrong, CHECK)
    yield from _about_adequacy(data)
    yield from _about_truth(missed)
    if sentence := apparent(data):
        yield warn("apparent-moduli", sentence, REMEDY)
    yield from _about_missing(data)
    yield from _about_poor_fit(data)
    yield from _about_fits(data)
    partial = [(best.scenario, best.where) for best in bests if "unfinished" in best.found]
    what, why = "The simulation of a best set did not finish", "The set is ranked by a part of its curves."
    yield from _by_scenario(data, "partial-set", what, partial, why)
    yield from _about_one_set(data)
    yield from _about_failures(data)
    reported = [best for best in bests if best.is_reported] or list(bests)
    yield from _about_ends(data, reported, "Best")
    yield from _about_identifiability(data)
    yield from _about_posterior(data)
    if not data.unfinished:
        yield from _about_meshes(data)
    yield from _about_ends(data, [best for best in bests if best not in reported], "Other")
    yield from _about_simulations(data)
    yield from _about_coarseness(data, bests)
    yield from _about_origins(data)
    yield from _about_unfitted(data, tables)
    yield from _about_conventions(data)


def _about_truth(missed: Sequence[str]) -> Iterator[ReportWarning]:
    if missed:
        what = "An interval misses the true value" if len(missed) == 1 else "Intervals miss the true values"
        why = "By chance 1 of 20 intervals does. More of them show an error that the budget leaves out."
        yield warn("true-value-missed", f"{what} ({_some(missed)})", why)


def _r2(data: ReportData, least: float, below: float) -> Iterator[tuple[str, str, float]]:
    """Scenario, fit and channel, and R², of the best sets whose R² in a fitted channel is in a range.

    A joint fit of spots that differ has none: each spot has a fit of its own.
    """
    for best in data.bests:
        if best.spot == data.together and best.found == FIT and data.spots_differ(best.scenario):
            continue
        for channel in data.scenario(best.scenario).weighed:
            if (at := best.r2.get(channel)) is not None and least <= at < below:
                yield best.scenario, f"{best.where}: {in_words(channel)}", at


def _about_poor_fit(data: ReportData) -> Iterator[ReportWarning]:
    found = _r2(data, THRESHOLDS.no_fit_r2, THRESHOLDS.good_r2)
    poor = [(name, f"{fit} R² {at:.3f}") for name, fit, at in found]
    why = (
        "This material law may be wrong for this specimen."
        if data.study.protocol is None
        else "The material law, the mesh or the contact may be wrong for this press."
    )
    for warning in _by_scenario(data, "poor-fit", "{n} {fit} {is} poor", poor, why):
        yield warning if warning.is_note else replace(warning, why=f"{warning.why}{_explained(data)}")


def _explained(data: ReportData) -> str:
    """Sentences on differences of the leading fit that the budget explains; empty without any."""
    checks = data.leading_rows(data.fit.adequacy)
    if "explained_by" not in checks.columns:  # tables of earlier runs have none
        return ""
    far = (pl.col("verdict") == Adequacy.DESCRIBES.value) & (pl.col("r2") < THRESHOLDS.good_r2)
    checks = checks.filter(far).drop_nulls("explained_by")
    return "".join(
        f" The {in_words(row['channel'])} differs by {100.0 * row['difference']:.2g} % of its peak, within "
        f"the stated errors, mostly by {cause_name(data, row['explained_by'])}; check it first."
        for row in checks.iter_rows(named=True)
    )


def _about_unfitted(data: ReportData, tables: Mapping[str, pl.DataFrame]) -> Iterator[ReportWarning]:
    others = [scenario.name for scenario in data.study.scenarios if scenario is not data.generalising]
    for scenarios in ([data.generalising.name], others):
        if sentence := finding(tables, scenarios):
            what, _, why = sentence.partition(": ")
            yield warn("unfitted-channel", what, why[:1].upper() + why[1:], is_note=scenarios is others)


@cache
def kinds() -> dict[str, dict[str, str]]:
    """Warnings by code: when each comes, why it matters, and what to do."""
    text = files("palpate_report").joinpath("answer/warnings.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def warn(code: str, what: str, why: str, *, is_note: bool = False) -> ReportWarning:
    """Warning of a kind that :func:`kinds` has."""
    assert code in kinds(), f"no warning has the code '{code}'"
    return ReportWarning(what, why, is_note, code)


def _listed(code: str, what: str, texts: Iterable[str], why: str = "") -> Iterator[ReportWarning]:
    """Warn where there is anything to list: the first of it, then why it matters or what to do."""
    if texts := list(texts):
        yield warn(code, what, f"{_some(texts)}. {why}".rstrip())


def _by_scenario(
    data: ReportData, code: str, what: str, found: Iterable[tuple[str, str]], why: str = ""
) -> Iterator[ReportWarning]:
    """Warn of texts of the reported scenario, and note texts of others; each is given with its scenario.

    ``what`` may have ``{n}``, the number of texts, and words with it, such as ``{is}`` or ``{fit}``.
    """
    every = list(found)
    one = {"is": "is", "has": "has", "do": "does", "fit": "fit", "set": "set"}
    several = {"is": "are", "has": "have", "do": "do", "fit": "fits", "set": "sets"}
    for is_note in (False, True):
        texts = [text for name, text in every if (name != data.generalising.name) == is_note]
        heading = what.format_map({"n": len(texts)} | (one if len(texts) == 1 else several))
        for warning in _listed(code, heading, texts, why):
            yield replace(warning, is_note=is_note)


def _some(texts: Sequence[str]) -> str:
    return "; ".join([*texts[:4], *([f"and {len(texts) - 4} more"] if texts[4:] else [])])


def _about_adequacy(data: ReportData) -> Iterator[ReportWarning]:
    by_remedy: dict[tuple[Adequacy, str], dict[tuple[str, str], list[str]]] = {}
    for each in failed_checks(data):
        fits = by_remedy.setdefault((each.verdict, each.remedy), {})
        fits.setdefault((each.scenario, each.message), []).append(each.fit)
    for (verdict, remedy), found in by_remedy.items():
        more = {key: f" and {len(fits) - 1} more" if fits[1:] else "" for key, fits in found.items()}
        texts = [(k[0], f"{fits[0]}{more[k]}, scenario {k[0]}: {k[1]}") for k, fits in found.items()]
        yield from _by_scenario(data, "model", f"The model {verdict} the data", texts, remedy)


def _about_missing(data: ReportData) -> Iterator[ReportWarning]:
    found = data.completeness
    if not found.is_complete:
        yield warn(
            "incomplete-sweep",
            "Incomplete sweep",
            f"{found}. A missing set may fit better. Run `palpate run` again to simulate the rest.",
        )
    if missing := data.without_result:
        n_pairs = len(data.spots) * len(data.study.scenarios)
        what = f"No result for {len(missing)} of {n_pairs} spots and scenarios"
        yield warn("no-result", what, f"{described(missing)}.")
    yield from _listed(
        "channel-not-compared",
        "A measured channel could not be compared with any simulation",
        (
            f"{in_words(channel)} at {spot}"
            for (spot, channel), rows in data.scores.group_by("spot", "channel", maintain_order=True)
            if rows["nmse"].is_null().all() and spot in data.selection["spot"]
        ),
        "The simulated curve is missing or does not reach far enough.",
    )


def _about_fits(data: ReportData) -> Iterator[ReportWarning]:
    failed = [
        (scenario, f"{fit}, scenario {scenario}: {why}") for (fit, scenario), why in data.fit.failures.items()
    ]
    yield from _by_scenario(
        data,
        "failed-fit",
        "{n} of the fits {has} no result",
        failed,
        "The page shows the best set of the sweep there, if there is one.",
    )
    yield from _by_scenario(
        data,
        "undecided-value",
        "A fit has values that the curves do not decide",
        (
            (row["scenario"], f"{row['fit']}, scenario {row['scenario']}: {message}")
            for row in data.fit.ends.iter_rows(named=True)
            for message in row["message"].split("; ")
            if message.startswith(UNSEEN)
        ),
    )


def _about_meshes(data: ReportData) -> Iterator[ReportWarning]:
    ends = list(data.fit.ends.iter_rows(named=True))
    yield from _by_scenario(
        data,
        "mesh-not-settled",
        "The correction by finer meshes has not settled",
        (
            (row["scenario"], f"{row['fit']}, scenario {row['scenario']}")
            for row in ends
            if UNSETTLED in row["message"]
        ),
        "The values there keep a part of the mesh error. Raise `fine_runs` in `[fit]`, or refine the meshes.",
    )
    if ends and data.study.solver.provides.mesh and data.fit.mesh.is_empty():
        yield warn(
            "mesh-unknown",
            "The mesh error of the parameters is unknown",
            "No finer mesh corrected the fit. Make finer ones: `palpate limb SCAN --fine`.",
        )


def _about_origins(data: ReportData) -> Iterator[ReportWarning]:
    unedited = unedited_warnings(data.study)
    yield from _listed("unedited", "Lines of the study are not edited yet", unedited)
    odd = (*measured_warnings(data.measured), *cycle_warnings(data.study, data.measured))
    yield from _listed("odd-curves", "Checks of the measured curves found something unusual", odd)
    of_meshes = limb_warnings(data.study, data.limbs)
    yield from _listed("odd-meshes", "Checks of the meshes found something unusual", of_meshes)
    of_presses = press_warnings(data.study, data.limbs)
    yield from _listed("contact-law", "First contact is found by the law of another press", of_presses)
    curves = [curve for response in data.measured.values() for curve in response.curves.values()]
    if not data.notice and all(curve.std is None for curve in curves):
        yield warn(
            "no-spread",
            "No spread was measured",
            "No measurement was repeated, so the scatter is unknown. The intervals use the residuals of the "
            "fit instead.",
        )
    if names := list(data.manifest.get("trusted", {})):
        yield warn(
            "trusted-code",
            f"Results of earlier code are accepted: {', '.join(names)}",
            "Simulations of the sweep were made with other code than the local search and the verification. "
            "Run in a new folder to have all of the same code.",
        )


def _about_ends(data: ReportData, bests: Sequence[Best], whose: str) -> Iterator[ReportWarning]:
    return _by_scenario(
        data,
        "end-of-range",
        f"{whose} values are at the end of their range",
        [
            (best.scenario, f"{value.parameter} at {best.where}")
            for best in bests
            for value in best.values
            if value.at_bound and value.identifiability != "not"
        ],
        "Widen the range: the minimum may be outside.",
    )


def _about_identifiability(data: ReportData) -> Iterator[ReportWarning]:
    if not data.unfinished and data.table("identifiability").is_empty() and not data.selection.is_empty():
        has_intervals = not data.fit.intervals.is_empty()
        what = "Identifiability by the sweep" if has_intervals else "How well each parameter is identified"
        first = "`palpate intervals`, then " if data.is_fitted and not has_intervals else ""
        yield warn(
            "not-assessed",
            f"{what} has not been assessed",
            f"Run {first}`palpate identifiability` (of palpate-certainty), then `palpate report` again.",
        )
    rows, together = (data.identified(together=together) for together in (False, True))
    if not data.fit.intervals.is_empty():
        rows, together = rows.head(0), data.leading_rows(data.fit.intervals)
    names = together.filter(identifiability="not")["parameter"].unique(maintain_order=True)
    if not names.is_empty():
        yield warn(
            "not-identified",
            f"Not identified: {', '.join(data.brief_name(name) for name in names)}",
            "The intervals are nearly as wide as the values or as the search ranges. Do not report these "
            "values as properties of the material.",
        )
    missing = [f"{cause}: {why}" for cause, why in left_out(data).items()]
    yield from _listed(
        "cause-left-out",
        "Intervals leave out error sources that could not be simulated",
        missing,
        "The intervals are too narrow by an unknown amount.",
    )
    is_explained = bool(apparent(data)) or bool(missing) or any(failed_checks(data))
    if UNCLEAR in [*rows["identifiability"], *together["identifiability"]] and not is_explained:
        yield warn(
            "unclear",
            "Identifiability of some parameters is unclear",
            "Few sets were ranked, or their curves follow the parameters too unevenly. Run more sets."
            if data.fit.intervals.is_empty()
            else "The usual error of a mesh is the largest cause of their intervals. Correct the fit by a "
            "finer mesh ([fit] fine_edge), or state the error of these meshes ([budget] mesh).",
        )
    yield from _listed(
        "spots-disagree", "The spots disagree", _apart(data, rows), "One material may not describe all spots."
    )


def _apart(data: ReportData, rows: pl.DataFrame) -> Iterator[str]:
    """Sentences on parameters whose intervals at two spots do not meet."""
    for parameter, brief in data.brief.items():
        known = rows.filter(parameter=parameter).drop_nulls("lower")
        if known.height > 1 and known["lower"].max() > known["upper"].min():  # type: ignore[operator]
            lowest, highest = known.sort("upper")["spot"][0], known.sort("lower")["spot"][-1]
            yield f"{brief.name} at {lowest} and {highest} have intervals that do not meet"


def _about_posterior(data: ReportData) -> Iterator[ReportWarning]:
    table = data.table("posterior")
    if table.is_empty():
        return
    worst = table.group_by("scenario", maintain_order=True).agg(
        pl.col("converged").all(), pl.col("split_r", "autocorrelation").max()
    )
    yield from _listed(
        "posterior-not-converged",
        "A posterior has not converged",
        (
            f"scenario {row['scenario']}: split-R̂ up to {row['split_r']:.4g}, autocorrelation time up to "
            f"{row['autocorrelation']:.3g} steps"
            for row in worst.filter(~pl.col("converged")).iter_rows(named=True)
        ),
        "Its means and intervals are no results. Fix an undecided parameter or narrow its range; then run "
        "`palpate certainty` again.",
    )


def _about_one_set(data: ReportData) -> Iterator[ReportWarning]:
    if len(data.spots) < 2:
        return
    costs = cost_of_one_set(data)
    if costs.is_empty() and not data.is_fitted:
        yield warn("one-set-missing", "No set for all spots", "No set could be ranked at every spot.")
        return
    costly = [] if data.is_fitted else costs.filter(pl.col("times") >= COSTLY).select("spot", "times").rows()
    if costly:
        times = _some([f"{spot} ({times:.3g} times)" for spot, times in costly])
        yield warn(
            "one-set-poor",
            "The set for all spots fits some spots much worse than their best set",
            f"Fopt of the common set divided by the least Fopt at that spot: {times}.",
        )


def _about_coarseness(data: ReportData, bests: Sequence[Best]) -> Iterator[ReportWarning]:
    return _listed(
        "between-sets",
        "The optimum is between the sampled sets",
        (
            f"{value.parameter} at {best.spot}: set {value.value:.4g}, optimum {value.optimum:.4g}"
            for best in bests
            if best.scenario == data.generalising.name and best.found != "fit"
            for value in best.values
            if value.value is not None and value.optimum is not None and not value.is_in_interval
        ),
        'Search from the best sets ([fit] search = "least_squares"), or raise n_sets.',
    )


def _about_failures(data: ReportData) -> Iterator[ReportWarning]:
    n_jobs = data.scores.select("spot", "set_id").n_unique()
    reasons = by_reason(failures(unranked(data.scores)))
    n_failed = reasons["n"].sum()
    if n_failed > FAILED_SHARE * n_jobs:
        first = reasons.row(0, named=True)
        yield warn(
            "failed-simulations",
            f"{n_failed} of {n_jobs} simulations could not be ranked",
            f"Most often ({first['n']}): {first['reason'] or first['status']}. "
            f"What to try: {first['remedy']}.",
        )


def _about_simulations(data: ReportData) -> Iterator[ReportWarning]:
    messages = [part for row in data.fit.ends.iter_rows(named=True) for part in row["message"].split("; ")]
    known = (m for m in messages if m not in ("converged", UNSETTLED) and not m.startswith((UNSEEN, WIDENED)))
    wider = (f"{range_of(p)} (study: {range_of(data.searched[name])})" for name, p in data.widened.items())
    yield from _listed("range-widened", "A range was widened", wider)
    ended = () if data.unfinished else dict.fromkeys(known)
    yield from _listed("not-converged", "Not every search converged", ended)
    failed = [row for row in data.verification.iter_rows(named=True) if not row["passed"]]
    yield from _listed(
        "failed-verification",
        f"{len(failed)} of {len(data.verification)} selected sets failed verification",
        [f"{row['spot']}, set {row['set_id']}: {row['message']}" for row in failed],
    )
    n_parameters, n_sets = len(data.design.parameters), min(data.completeness.simulated.values())
    if n_sets < FEW_SETS * n_parameters and data.fit.table.is_empty():
        yield warn(
            "thin-sweep",
            f"A thin sweep: {n_sets} sets for {n_parameters} parameters",
            "The best set is the best of few; raise n_sets, or name a search under [fit].",
        )


def _about_conventions(data: ReportData) -> Iterator[ReportWarning]:
    if getattr(data.study.scoring.score.settings, "normaliser", "") == "mean":
        yield warn(
            "mean-normaliser",
            "NMSE is over the mean of the measured curve",
            "Over a path to both sides, such as a twist, that is close to zero, and inflates the error.",
        )
    for region in data.study.space.regions:
        if region.convention != "textbook":
            yield warn(
                "convention",
                f"Coefficients of {region.region} are in the convention '{region.convention}'",
                f"The textbook's {region.material.name} has other numbers for the same material.",
            )
