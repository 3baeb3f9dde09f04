"""What a run amounts to: the best parameters, how well they are identified, and its warnings."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import polars as pl

from palpate.report.best_sets import Best, best_sets
from palpate.report.report_data import ReportData, label_of
from palpate.report.report_warnings import CHECK, NO_FIT_R2, ReportWarning, report_warnings
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
    no_fit = _no_fit(data, bests)
    return Verdict(
        parameters=tuple(map(label_of, data.brief.values())),
        bests=bests,
        lead=no_fit or _lead(data, bests),
        identifiability=() if no_fit else tuple(_identifiability(data, name) for name in data.brief),
        warnings=tuple(report_warnings(data, bests, tables)),
        without_result=data.without_result,
    )


def _no_fit(data: ReportData, bests: Sequence[Best]) -> str:
    """Sentence in place of parameters where the set that they would be of does not fit."""
    if len(data.spots) > 1:
        rows = [(row["spot"], row) for row in data.generalisation.iter_rows(named=True)]
    else:
        own = (best for best in bests if best.scenario == data.generalising.name)
        rows = [(best.spot, {f"r2_{name}": r2 for name, r2 in best.r2.items()}) for best in own]
    wrong = [
        f"{name} at {spot} (R² {r2:.3g})"
        for spot, row in rows
        for name in data.generalising.weighed
        if (r2 := row.get(f"r2_{name}")) is not None and r2 < NO_FIT_R2
    ]
    if not wrong:
        return ""
    more = f" and {len(wrong) - 4} more" if len(wrong) > 4 else ""
    where = f"{', '.join(wrong[:4])}{more}"
    return f"No parameters can be read from this run: the best set does not fit {where}. {CHECK}"


def _lead(data: ReportData, bests: Sequence[Best]) -> str:
    if len(data.spots) == 1:
        best = next((b for b in bests if b.scenario == data.generalising.name), None)
        return "" if best is None else (
            f"At {best.spot}, fitted to {best.fitted_to} (scenario {best.scenario}): "
            f"{_listed(data, (v.value for v in best.values))}; Fopt {best.fopt:.4g} ({best.found})."
        )  # fmt: skip
    if data.generalisation.is_empty():
        return ""
    row = data.generalisation.row(0, named=True)
    spread = "" if row["fopt_sd"] is None else f" ± {row['fopt_sd']:.2g}"
    found = data.completeness
    of = "" if found.is_complete else f", of {found.n_everywhere} sets simulated at each"
    return (
        f"One set for all {len(data.spots)} spots{of}: set {row['set_id']}, "
        f"{_listed(data, (row[name] for name in data.brief))}; "
        f"mean Fopt {row['fopt_mean']:.4g}{spread} (scenario {row['scenario']})."
    )


def _listed(data: ReportData, values: Iterable[float]) -> str:
    pairs = zip(data.brief.values(), values, strict=True)
    return ", ".join(
        f"{p.name} = {value:.4g} {p.unit if p.unit != '1' else ''}".rstrip() for p, value in pairs
    )


def _identifiability(data: ReportData, parameter: str) -> str:
    """Sentence on one parameter in the scenario that generalises, over all spots."""
    rows = data.identified(together=False).filter(parameter=parameter)
    name, words = data.brief[parameter].name, rows["identifiability"].to_list()
    if not words:
        return f"{name}: nothing is known of how well it is identified."
    counts = {word: words.count(word) for word in _ORDER if word in words}
    spots = ", ".join(f"{_phrase(word)} at {n} of {len(words)} spots" for word, n in counts.items())
    if len(counts) == 1:
        spots = _phrase(words[0])
    strongest = rows.drop_nulls("correlation").sort(
        pl.col("correlation").abs(), descending=True, maintain_order=True
    )
    trade = ""
    if not strongest.is_empty() and abs(strongest["correlation"][0]) >= 0.9:
        row = strongest.row(0, named=True)
        other = data.brief[row["most_correlated_with"]].name
        trade = f"; most correlated with {other} (correlation {row['correlation']:.2f}, spot {row['spot']})"
    return f"{name}: {_together(data, parameter)}{spots}{trade}."


def _together(data: ReportData, parameter: str) -> str:
    """Fitted optimum and interval by all spots together; empty where they cannot be given."""
    rows = data.identified(together=True).filter(parameter=parameter).drop_nulls("lower")
    if rows.is_empty():
        return ""
    row, unit = rows.row(0, named=True), data.brief[parameter].unit
    unit, where = "" if unit == "1" else f" {unit}", ""
    if len(data.spots) > 1:
        where = f"{_phrase(row['identifiability'])} by all spots together; spot by spot: "
    return (
        f"fitted optimum {row['optimum']:.4g}{unit}, {row['lower']:.4g} to {row['upper']:.4g}{unit} "
        f"fits about as well; {where}"
    )


def _phrase(word: str) -> str:
    return {"not": "not identifiable", UNCLEAR: "unclear"}.get(word, f"{word} identifiable")
