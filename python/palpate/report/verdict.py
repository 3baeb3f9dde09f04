"""What a run amounts to: the best parameters, how far they are to be believed, and what is not."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import polars as pl

from palpate.domain import Parameter
from palpate.report.best_sets import (
    Best,
    best_sets,
    identifiability_together,
    identifiability_when_generalising,
    with_brief_names,
)
from palpate.report.report_data import ReportData
from palpate.report.report_warnings import CHECK, NO_FIT_R2, ReportWarning, report_warnings
from palpate.report.space import label_of, named_briefly
from palpate.stages.identifiability import UNCLEAR, WORDS

_ORDER = [*(word for _, word in WORDS), UNCLEAR]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """The first thing that a reader of the report sees.

    Parameters
    ----------
    parameters : tuple of str
        Labels of the columns.
    bests : tuple of Best
    lead : str
        Sentence on the set for all spots, or on the best set of the only spot; empty where
        there is none. Where it does not fit, that is the sentence.
    identifiability : tuple of str
        A sentence on each parameter; none where the set does not fit.
    warnings : tuple of ReportWarning
        The most severe first.
    without_result : mapping of (spot, scenario) to str
        Why no set could be selected there.
    """

    parameters: tuple[str, ...]
    bests: tuple[Best, ...]
    lead: str
    identifiability: tuple[str, ...]
    warnings: tuple[ReportWarning, ...]
    without_result: Mapping[tuple[str, str], str] = field(default_factory=dict)

    @property
    def sentences(self) -> tuple[str, ...]:
        """What was found, and how well each parameter is identified."""
        return tuple(sentence for sentence in (self.lead, *self.identifiability) if sentence)


def make_verdict(data: ReportData, tables: Mapping[str, pl.DataFrame]) -> Verdict:
    """Sum up a run, from what its stages have left."""
    bests = tuple(best_sets(data))
    brief = named_briefly(data.design.parameters)
    no_fit = _no_fit(data, bests)
    return Verdict(
        parameters=tuple(label_of(p) for p in brief),
        bests=bests,
        lead=no_fit or _lead(data, bests, brief),
        identifiability=()
        if no_fit
        else tuple(_identifiability(data, p, b.name) for p, b in with_brief_names(data)),
        warnings=tuple(report_warnings(data, bests, tables)),
        without_result=data.without_result,
    )


def _no_fit(data: ReportData, bests: Sequence[Best]) -> str:
    """Sentence in place of parameters where the set that they would be of does not fit."""
    channels = [name for name, weight in data.generalising.weights.items() if weight > 0.0]
    if len(data.spots) > 1:
        found = {row["spot"]: row for row in data.generalisation.iter_rows(named=True)}
        r2 = {(spot, name): row.get(f"r2_{name}") for spot, row in found.items() for name in channels}
    else:
        own = (best for best in bests if best.scenario == data.generalising.name)
        r2 = {(best.spot, name): best.r2.get(name) for best in own for name in channels}
    wrong = [
        f"{name} at {spot} (R² {at:.3g})"
        for (spot, name), at in r2.items()
        if at is not None and at < NO_FIT_R2
    ]
    if not wrong:
        return ""
    more = f" and {len(wrong) - 4} more" if len(wrong) > 4 else ""
    where = f"{', '.join(wrong[:4])}{more}"
    return f"No parameters can be read from this run: the best set does not fit {where}. {CHECK}"


def _lead(data: ReportData, bests: Sequence[Best], brief: Sequence[Parameter]) -> str:
    if len(data.spots) == 1:
        best = next((b for b in bests if b.scenario == data.generalising.name), None)
        return "" if best is None else (
            f"At {best.spot}, fitted to {best.fitted_to} (scenario {best.scenario}): "
            f"{_listed(brief, [v.value for v in best.values])}; Fopt {best.fopt:.4g} ({best.found})."
        )  # fmt: skip
    if data.generalisation.is_empty():
        return ""
    row = data.generalisation.row(0, named=True)
    spread = "" if row["fopt_sd"] is None else f" ± {row['fopt_sd']:.2g}"
    found = data.completeness
    of = "" if found.is_complete else f", of {found.n_everywhere} sets simulated at each"
    return (
        f"One set for all {len(data.spots)} spots{of}: set {row['set_id']}, "
        f"{_listed(brief, [row[p.name] for p in data.design.parameters])}; "
        f"mean Fopt {row['fopt_mean']:.4g}{spread} (scenario {row['scenario']})."
    )


def _listed(brief: Sequence[Parameter], values: Sequence[float]) -> str:
    parts = (
        f"{p.name} = {value:.4g} {p.unit if p.unit != '1' else ''}"
        for p, value in zip(brief, values, strict=True)
    )
    return ", ".join(text.rstrip() for text in parts)


def _identifiability(data: ReportData, parameter: Parameter, name: str) -> str:
    """Sentence on one parameter in the scenario that generalises, over all spots."""
    rows = identifiability_when_generalising(data).filter(pl.col("parameter") == parameter.name)
    words = rows["identifiability"].to_list()
    known = _together(data, parameter)
    if not words:
        return f"{name}: nothing is known of how well it is identified."
    counts = {word: words.count(word) for word in _ORDER if word in words}
    spots = _said(next(iter(counts))) if len(counts) == 1 else ", ".join(
        f"{_said(word)} at {n} of {len(words)} spots" for word, n in counts.items()
    )  # fmt: skip
    strongest = rows.drop_nulls("correlation").sort(
        pl.col("correlation").abs(), descending=True, maintain_order=True
    )
    trade = ""
    if not strongest.is_empty() and abs(strongest["correlation"][0]) >= 0.9:
        other = {p.name: b.name for p, b in with_brief_names(data)}[strongest["most_correlated_with"][0]]
        sign = strongest["correlation"][0]
        trade = f"; most correlated with {other} (correlation {sign:.2f}, spot {strongest['spot'][0]})"
    return f"{name}: {known}{spots}{trade}."


def _together(data: ReportData, parameter: Parameter) -> str:
    """Fitted optimum and interval by all spots together; empty where they cannot be given."""
    rows = identifiability_together(data).filter(pl.col("parameter") == parameter.name).drop_nulls("lower")
    if rows.is_empty():
        return ""
    row, unit = rows.row(0, named=True), "" if parameter.unit == "1" else f" {parameter.unit}"
    where = ""
    if len(data.spots) > 1:
        where = f"{_said(row['identifiability'])} by all spots together; spot by spot: "
    return (
        f"fitted optimum {row['optimum']:.4g}{unit}, {row['lower']:.4g} to {row['upper']:.4g}{unit} "
        f"fits about as well; {where}"
    )


def _said(word: str) -> str:
    return {"not": "not identifiable", UNCLEAR: "unclear"}.get(word, f"{word} identifiable")
