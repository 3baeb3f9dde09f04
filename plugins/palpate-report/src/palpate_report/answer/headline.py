"""Each value of a run as every output shows it: interval, unit, verdict and mark, made once.

Page, tables, LaTeX, cards, comparison and terminal print a :class:`Headline`, or what :class:`Verdicts`
states of a value of another fit; nothing else decides what may be read.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import polars as pl

from palpate.api import ParameterName
from palpate.api.fit import ALL_SPOTS, UNCLEAR, Adequacy, FitResult, worst_of
from palpate_report.answer.best_sets import Best, best_sets, initial_moduli, leading
from palpate_report.answer.model_verdict import model_verdict
from palpate_report.answer.warnings import NO_FIT_R2, failed_checks
from palpate_report.data.marks import NOT, REFUSED, TIED, Headline, mark_of, rounded, verdict_of, with_unit
from palpate_report.data.report_data import ReportData

MODULI = ("initial shear modulus", "Young's modulus")


# -------------------------------------------------------------------- what leads


def headlines(data: ReportData, bests: Sequence[Best]) -> list[Headline]:
    """Parameters of what leads, with the intervals of the fit where it has them, else of the sweep."""
    best, model = leading(data, bests), model_verdict(data, bests).verdict
    at_bound = {each.name: each.at_bound for each in best.values} if best else {}
    rows = data.leading_rows(data.fit.certainty.intervals)
    found = [
        Headline(
            parameter=data.brief_name(row["parameter"]),
            name=row["parameter"],
            level=0.95,
            at_bound=at_bound.get(ParameterName.parse(row["parameter"]).shared, False),
            model=model,
            **{key: row[key] for key in ("unit", "value", "lower", "upper", "identifiability")},
        )
        for row in rows.iter_rows(named=True)
    ]
    if found:
        return found
    if best is not None:
        return [replace(each, model=model) for each in best.values]
    chosen = next(data.generalisation.iter_rows(named=True), {})
    swept = {row["parameter"]: row for row in data.identified(together=True).iter_rows(named=True)}
    return [
        Headline(
            parameter=parameter.name,
            name=name,
            unit=parameter.unit,
            value=chosen.get(name),
            lower=swept.get(name, {}).get("lower"),
            upper=swept.get(name, {}).get("upper"),
            identifiability=swept.get(name, {}).get("identifiability", UNCLEAR),
            model=model,
        )
        for name, parameter in data.searched.items()
    ]


def missed_truth(data: ReportData, estimates: Sequence[Headline]) -> list[str]:
    """Each interval that does not hold the true value of simulated data, with that value."""
    return [
        f"{each.parameter}: true {with_unit(rounded(truth, each.lower, each.upper), each.unit)}, interval "
        f"{with_unit(each.interval, each.unit)}"
        for each in estimates
        if (truth := _truth(data, each)) is not None and each.interval and not _holds(each, truth)
    ]


def holds_truth(data: ReportData, estimates: Sequence[Headline]) -> bool:
    """True if every parameter has an interval and a true value, and the interval holds it."""
    known = [(each, _truth(data, each)) for each in estimates]
    return bool(known) and all(
        truth is not None and each.interval and _holds(each, truth) for each, truth in known
    )


def _truth(data: ReportData, value: Headline) -> float | None:
    return data.study.truth.get(ParameterName.parse(value.name).shared) if value.name else None


def _holds(value: Headline, truth: float) -> bool:
    assert value.lower is not None
    assert value.upper is not None
    return value.lower <= truth <= value.upper


def moduli(data: ReportData, best: Best, *, model: Adequacy = Adequacy.DESCRIBES) -> Iterator[Headline]:
    """Initial shear modulus and Young's modulus of each region of a best set.

    One that a single parameter changes has the interval and the word of that.
    """
    row = {each.name: each.value for each in best.values}
    moved: dict[tuple[str, int], list[tuple[Headline, float, float]]] = {}
    for each in best.values:
        if each.lower is None or each.upper is None or not each.level:
            continue
        ends = [dict(initial_moduli(data, row | {each.name: end})) for end in (each.lower, each.upper)]
        for region, known in best.moduli.items():
            for i, modulus in enumerate(known):
                lower, upper = (end[region][i] if region in end else math.nan for end in ends)
                if not (
                    math.isclose(lower, modulus, rel_tol=1e-9) and math.isclose(upper, modulus, rel_tol=1e-9)
                ):
                    moved.setdefault((region, i), []).append((each, min(lower, upper), max(lower, upper)))
    is_sure = all(each.level for each in best.values)
    for region, known in best.moduli.items():
        of = f" of {region}" if len(data.study.space.regions) > 1 else ""
        for i, (name, modulus) in enumerate(zip(MODULI, known, strict=True)):
            by = moved.get((region, i), [])
            of_one, *ends_of_one = by[0] if is_sure and len(by) == 1 else (None, None, None)
            yield Headline(
                parameter=f"{name}{of}",
                unit=data.modulus_unit,
                value=modulus,
                lower=ends_of_one[0],
                upper=ends_of_one[1],
                identifiability=of_one.identifiability if of_one else "",
                level=0.95 if of_one else None,
                at_bound=of_one.at_bound if of_one else False,
                model=model,
            )


def between_spots(data: ReportData) -> str:
    """Sentence on spots that differ: mean ± standard deviation of each parameter; empty where none do."""
    rows = data.leading_rows(data.fit.certainty.between_spots).to_dicts()
    found = []
    for row in rows:
        mean, sd = (rounded(row[key], 0.0, row["sd"]) for key in ("value", "sd"))
        ends = f"{rounded(row['lower'])} to {rounded(row['upper'])}"
        name = data.brief_name(row["parameter"])
        found.append(f"{name} {with_unit(f'{mean} ± {sd}', row['unit'])} ({ends})")
    return (
        f"they differ, mean ± sd between spots (95 % interval of the sd): {'; '.join(found)}" if found else ""
    )


# ----------------------------------------------------------------------- verdicts


class Verdicts:
    """Verdicts on each value of a run, of any fit and of the sweep.

    Attributes
    ----------
    model : ModelVerdict
        Of what leads.
    of_fit, of_sweep : mapping of (spot, scenario) to Best
    of_models : mapping of (fit, scenario) to Adequacy
        Verdicts on fits that do not describe their curves within the budget.
    """

    def __init__(self, data: ReportData) -> None:
        bests = tuple(best_sets(data))
        swept = tuple(best_sets(replace(data, fit=FitResult()))) if not data.fit.table.is_empty() else bests
        self.data, self.model = data, model_verdict(data, bests)
        self.of_fit = {(b.spot, b.scenario): b for b in bests if b.found == "fit"}
        self.of_sweep = {(b.spot, b.scenario): b for b in swept}
        self.of_models: dict[tuple[str, str], Adequacy] = {}
        for each in failed_checks(data):
            at = (each.fit, each.scenario)
            self.of_models[at] = worst_of([each.verdict, self.of_models.get(at, each.verdict)])

    def at(self, spot: str, scenario: str, name: str, *, is_fit: bool, word: str | None = None) -> str:
        """Verdict on a parameter (full name) by what was found at a spot.

        Parameters
        ----------
        word : str, optional
            Its identifiability where the best sets do not have it.
        """
        best = (self.of_fit if is_fit else self.of_sweep).get((spot, scenario))
        model = self.model_at(spot, scenario, is_fit=is_fit)
        if model is Adequacy.FAILS:
            return REFUSED
        head = ParameterName.parse(name).shared
        if head in self.data.study.space.ties and head not in self.data.searched:
            return TIED
        value = next((each for each in best.values if each.name == head), None) if best else None
        if word is None:
            word = value.identifiability if value else UNCLEAR
        return verdict_of(word, at_bound=value is not None and value.at_bound, model=model)

    def model_at(self, spot: str, scenario: str, *, is_fit: bool) -> Adequacy:
        """Verdict on the model of what was found at a spot; one that leads and fails takes all away."""
        best = (self.of_fit if is_fit else self.of_sweep).get((spot, scenario))
        fitted = self.data.scenario(scenario).weighed
        if self.model.failure or (
            best is not None
            and any(r2 is not None and r2 < NO_FIT_R2 for name, r2 in best.r2.items() if name in fitted)
        ):
            return Adequacy.FAILS
        return self.of_models.get((spot, scenario), Adequacy.DESCRIBES) if is_fit else Adequacy.DESCRIBES


OF_FITS = ("table1_fit", "fit_mesh", "intervals", "between_spots", "posterior", "profile_ends", "fit")
"""Tables of parameters whose values are of fits."""

OF_SETS = ("table1_coefficients", "identifiability", "distance_to_truth", "generalised")
"""Those whose values are of the sweep, but for rows that state a fit as their ``search``."""


def with_verdicts(data: ReportData, tables: Mapping[str, pl.DataFrame]) -> dict[str, pl.DataFrame]:
    """Tables with a column ``verdict`` where they have values of parameters, and words in full."""
    verdicts, in_full = Verdicts(data), pl.col("^identifiability$").replace("not", NOT)
    return {
        name: table.with_columns(in_full)
        if name not in (*OF_FITS, *OF_SETS)
        else table.with_columns(
            in_full,
            verdict=pl.Series(
                [_verdict(verdicts, name, row) for row in table.iter_rows(named=True)], dtype=pl.String
            ),
        )
        for name, table in tables.items()
    }


def _verdict(verdicts: Verdicts, table: str, row: Mapping[str, object]) -> str:
    """Verdict on the value of a row, or on each of its values that is no result."""
    data = verdicts.data
    is_fit = table in OF_FITS or row.get("search") in ("fit", "joint fit")
    spot = str(row.get("fit") or row.get("spot") or ALL_SPOTS)
    scenario = str(row.get("scenario") or data.generalising.name)
    if "parameter" in row:
        region = f"{row['region']}." if "region" in row else ""
        word = row.get("identifiability")
        return verdicts.at(
            spot,
            scenario,
            f"{region}{row['parameter']}",
            is_fit=is_fit,
            word=None if word is None else str(word),
        )
    if verdicts.model.failure:
        return REFUSED
    found = {p.name: verdicts.at(spot, scenario, name, is_fit=is_fit) for name, p in data.searched.items()}
    return "; ".join(f"{name} {verdict}" for name, verdict in found.items() if mark_of(verdict))


def draws_of(data: ReportData, scenario: str, most: int) -> pl.DataFrame:
    """Draws of the fit that leads: those of its posterior, else those of its normal density; else none."""
    for frame in (data.posterior.posterior_draws, data.fit.certainty.draws):
        if not frame.is_empty():
            rows = frame.filter(pl.col("fit").is_in([data.together, ALL_SPOTS]), scenario=scenario)
            if not rows.is_empty():
                return rows.gather_every(-(-rows.height // most))
    return pl.DataFrame()
