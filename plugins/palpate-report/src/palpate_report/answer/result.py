"""Result of a run, and what a report of it shows: parameters, tables, warnings."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

import polars as pl

from palpate.api import ParameterName, PluginError
from palpate.api.fit import ALL_SPOTS, THRESHOLDS, UNCLEAR, WORDS
from palpate.api.report import ReportWarning, Section, rounded, shown
from palpate.api.runs import Study, answering_for
from palpate_report.answer.failed_checks import apparent, left_out
from palpate_report.answer.headline import between_spots, holds_truth, missed_truth
from palpate_report.answer.methods import assumed, methods
from palpate_report.answer.model_verdict import ModelVerdict, least_r2, model_verdict
from palpate_report.answer.next_step import CAUSES, next_step
from palpate_report.answer.warnings import report_warnings, warn
from palpate_report.data.best import Best
from palpate_report.data.marks import Headline, in_words, with_unit
from palpate_report.data.report_data import ReportData, label_of
from palpate_report.data.showable import is_own
from palpate_report.data.tables import make_tables


def ordered(sections: Mapping[str, type[Section]]) -> list[type[Section]]:
    """Sections in the order of the page: each plugin's follows the one that it names, or is the last."""
    order = [section for section in sections.values() if is_own(section)]
    for section in sections.values():
        if not is_own(section):
            names = [each.name for each in order]
            place = names.index(section.after) + 1 if section.after in names else len(order)
            order.insert(place, section)
    return order


def section_warnings(data: ReportData) -> Iterator[ReportWarning]:
    """Warnings of the sections."""
    for section in ordered(data.sections):
        try:
            with answering_for(section, "warning of its section"):
                found = tuple(section().warnings(data))
            for each in found:
                if not isinstance(each, ReportWarning):
                    raise PluginError(
                        f"section '{section.name}' warns of {each!r}, which is no palpate.api.ReportWarning"
                    )
            yield from found
        except PluginError as error:
            yield warn("failed-section", f"Section '{section.name}' of the report has failed", f"{error}.")


@dataclass(frozen=True, slots=True, kw_only=True)
class Conclusion:
    """The first thing that a reader of the report sees.

    Parameters
    ----------
    parameters : tuple of str
        Labels of the values of each best set.
    bests : tuple of Best
        Joint fits first.
    headline : str
        How well what leads fits, without its parameters; empty where there is nothing.
    estimates : tuple of Headline
        Parameters of what leads with their intervals; none where the set does not fit.
    moduli : tuple of Headline
        Its initial moduli.
    lead : str
        Sentence on the joint fit, or on the set for all spots, or on the best set of the only spot;
        empty where there is none. Where it does not fit, that is the sentence.
    identifiability : tuple of str
        A sentence on each parameter; none where the set does not fit.
    spent : str
        Sentence on the simulations of the sweep and of the fit; empty where there was no fit.
    warnings, notes : tuple of ReportWarning
        The most severe first; notes are about scenarios that are not reported.
    apparent : str
        Why the parameters are of one rate alone; empty where nothing shows it.
    not_included : tuple of str
        What may be wrong and is in no interval.
    assumed : str
        Equations of the parameters that are not searched; empty without them.
    known : str
        That every interval holds the true value of simulated data; empty where this is not so or unknown.
    mesh : str
        What the meshes may be wrong by, and the largest share of that in an interval; empty without them.
    between_spots : str
        How the spots differ; empty where they do not.
    of_stages : mapping of word to str
        What stages of plugins have found, each under its word.
    next_step : str
        What to do next; empty where there is nothing to say.
    methods : str
        Paragraph on the methods for a paper, with references, as Markdown.
    model : ModelVerdict
        On the model of what leads.
    without_result : mapping of (spot, scenario) to str
        Why no set could be selected there.
    """

    parameters: tuple[str, ...]
    bests: tuple[Best, ...]
    headline: str = ""
    estimates: tuple[Headline, ...] = ()
    moduli: tuple[Headline, ...] = ()
    lead: str
    identifiability: tuple[str, ...]
    spent: str = ""
    warnings: tuple[ReportWarning, ...]
    notes: tuple[ReportWarning, ...] = ()
    apparent: str = ""
    not_included: tuple[str, ...] = ()
    assumed: str = ""
    known: str = ""
    mesh: str = ""
    between_spots: str = ""
    of_stages: Mapping[str, str] = field(default_factory=dict)
    next_step: str = ""
    methods: str = ""
    model: ModelVerdict = field(default_factory=ModelVerdict)
    without_result: Mapping[tuple[str, str], str] = field(default_factory=dict)

    @property
    def failure(self) -> str:
        """Reason why no parameters can be read from the run, and what to check; empty where they can."""
        return self.model.failure

    def lines(self, study: Study) -> dict[str, str]:
        """Lines with which a run ends, by their label."""
        data = "measured data" if study.data != "simulated" else "SIMULATED curves, not a real experiment"
        if any(each.code == "unfinished" for each in self.warnings):
            first = "first answer, " if any(each.level for each in self.estimates) else ""
            data += f"; {first}the run has not ended"
        found = "; ".join(map(str, (*self.estimates, *self.moduli)))
        worst = ", the worst first" if len(self.warnings) > 1 else ""
        coded = (f"{each.what} [{each.code}]" if each.code else each.what for each in self.warnings)
        warned = f"{len(self.warnings)}{worst}: {'; '.join(coded)}"
        return {
            "Conclusion": f"{study.name} ({data}): {self.headline or 'no set fits all spots'}",
            **({"Mesh": self.mesh} if self.mesh else {}),
            **({"Spots": self.between_spots} if self.between_spots else {}),
            "Parameters": found or "none, for the reason above",
            **self.facts,
            "Warnings": warned if self.warnings else "none",
            **({"Next": self.next_step} if self.next_step else {}),
        }

    @property
    def facts(self) -> dict[str, str]:
        """Facts by the words that the terminal and the page have for them."""
        left_out = f"errors of {', '.join(self.not_included)}" if self.not_included else ""
        found = {"Assumed": self.assumed, "Left out": left_out, "True values": self.known}
        return {**self.of_stages, **{word: text for word, text in found.items() if text}}

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences on what was found, at which rate, how well it is identified, and what it cost."""
        apparent = f"{self.apparent}." if self.apparent else ""
        found = (self.lead, self.model.power, apparent, *self.identifiability, self.spent)
        return tuple(sentence for sentence in found if sentence)


def make_conclusion(data: ReportData, tables: Mapping[str, pl.DataFrame]) -> Conclusion:
    """Sum up a run, from what its stages have left."""
    model, (about, values, quality) = model_verdict(data), _lead(data)
    no_fit, close = model.failure, f"{model.approximation} " if model.approximation else ""
    found = data.estimates
    estimates, missing = () if no_fit else found, tuple(_not_included(data))
    missed = missed_truth(data, estimates)
    warned = (*report_warnings(data, tables, missed), *section_warnings(data))
    return Conclusion(
        parameters=tuple(map(label_of, data.searched.values())),
        bests=data.bests,
        headline=no_fit or (f"{close}{about}: {quality}" if about else ""),
        estimates=estimates,
        moduli=() if no_fit else data.moduli,
        lead=no_fit or (f"{close}{about}: {', '.join(values)}; {quality}." if about else ""),
        identifiability=() if no_fit else tuple(_identified(data, found)),
        spent=_spent(data),
        warnings=tuple(each for each in warned if not each.is_note),
        notes=tuple(each for each in warned if each.is_note),
        apparent=apparent(data),
        not_included=missing,
        methods=methods(data, estimates, missing),
        assumed=", ".join(each for region in data.study.space.regions for each in assumed(data, region)),
        known="every interval holds the true value" if holds_truth(data, estimates) else "",
        mesh="" if no_fit else _mesh(data),
        between_spots="" if no_fit else between_spots(data),
        of_stages={word: text for _, each in data.summaries.values() for word, text in each.labelled.items()},
        next_step=next_step(data, found, model=model.verdict),
        model=model,
        without_result=data.without_result,
    )


def _not_included(data: ReportData) -> Iterator[str]:
    """Name what may be wrong and is in no interval: anatomy, and causes that are stated as none or failed."""
    study, budget = data.study, data.study.budget
    if study.solver.provides.mesh and study.protocol is not None:
        known = data.table("budget")
        counted = set(known["cause"]) if known.height else set()
        anatomy = ("bone", "layers", "position") if len(study.space.regions) > 1 else ("bone", "position")
        yield from (CAUSES[name] for name in anatomy if name not in counted)
    if data.fit.intervals.is_empty():
        return
    searched = {ParameterName.parse(name).shared for name in data.fit.intervals["parameter"]}
    if study.protocol is not None and budget.friction == 0.0 and "friction" not in searched:
        yield "friction (stated as exact)"
    for name, sd in budget.parameters.items():
        if sd == 0.0:
            yield f"{name} (stated as exact)"
    yield from (f"{cause} (failed)" for cause in left_out(data))


def _mesh(data: ReportData) -> str:
    """Largest relative error of each channel by the meshes of what leads, and where it matters most."""
    errors, budget = (data.leading_rows(data.table(name)) for name in ("mesh_errors", "budget"))
    if errors.is_empty() or budget.is_empty():
        return ""
    rows = errors.sort("relative_error", descending=True)
    worst = rows.unique("channel", keep="first", maintain_order=True)
    channels = ", ".join(
        f"{100.0 * row['relative_error']:.1f} % in {in_words(row['channel'])}" for row in worst.to_dicts()
    )
    shown_by = ", ".join(worst["shown_by"].unique(maintain_order=True))
    shares = budget.filter(cause="mesh").drop_nulls("share").sort("share", descending=True)
    if shares.is_empty():
        return ""
    parameter, share = shares.select("parameter", "share").row(0)
    of = data.brief_name(parameter)
    return f"error {channels} (from {shown_by}); {100.0 * share:.0f} % of the variance of {of}"


def _lead(data: ReportData) -> tuple[str, list[str], str]:
    """Fit that leads, its values, and how well it fits; empty where there is nothing."""
    where, best = data.together, data.lead
    if best is not None:
        values = [equation(each) for each in (*best.values, *best.moduli)]
        of = f"At {where}" if where != ALL_SPOTS else f"One material for all {len(data.spots)} spots"
        fopt = f"{'mean ' if where == ALL_SPOTS else ''}Fopt {best.fopt:.2g}"
        if best.fopt_least is not None and f"{best.fopt_least:.2g}" != f"{best.fopt:.2g}":
            fopt += f" (the least: {best.fopt_least:.2g})"
        if data.spots_differ(best.scenario):
            of, fopt = f"Mean of {len(data.spots)} spots that differ", "each spot by its own fit"
        least = "at least " if where == ALL_SPOTS else ""
        r2 = [f"R² {name} {least}{shown(at)}" for name, (at, _) in least_r2(data).items()]
        about = f"{of}, fitted to {best.fitted_to} (scenario {best.scenario})"
        return about, values, f"{', '.join([fopt, *r2])} ({best.found})"
    if data.generalisation.is_empty():
        return "", [], ""
    row = data.generalisation.row(0, named=True)
    spread = "" if row["fopt_sd"] is None else f" ± {row['fopt_sd']:.2g}"
    found = data.completeness
    of = "" if found.is_complete else f", of {found.n_everywhere} sets simulated at each"
    values = [
        equation(Headline(parameter=p.name, unit=p.unit, value=row[name])) for name, p in data.brief.items()
    ]
    quality = f"mean Fopt {row['fopt_mean']:.2g}{spread} (scenario {row['scenario']})"
    return f"One set for all {len(data.spots)} spots{of}", [f"set {row['set_id']}", *values], quality


def equation(value: Headline) -> str:
    """Value of a parameter as an equation, with its unit."""
    shown = "by spot" if value.value is None else f"= {with_unit(value.text, value.unit)}"
    return f"{value.parameter} {shown}"


def _spent(data: ReportData) -> str:
    """Sentence on what was simulated."""
    if data.fit.table.is_empty():
        return ""
    if data.unfinished:
        return f"{data.n_simulations} simulations so far."
    fits = data.fit.table.unique(["fit", "scenario"])
    fine = f" and {n_fine} on finer meshes" if (n_fine := fits["n_fine"].sum()) else ""
    every = f"{data.n_simulations} simulations, of which " if data.n_simulations else "Simulations: "
    return f"{every}{fits['n_runs'].sum()} by the fit{fine}."


def _identified(data: ReportData, found: Sequence[Headline]) -> Iterator[str]:
    """Sentence on each parameter: by the intervals of the fit, where it has them, else by the sweep."""
    if not any(each.level for each in found):
        yield from (_by_sweep(data, name) for name in data.brief)
        return
    for each in found:
        ends = with_unit(each.interval, each.unit) if each.interval else ""
        known = with_unit(each.text, each.unit) + (f", 95 % interval {ends}" if ends else "")
        yield f"{each.parameter}: {known}; {_phrase(each.identifiability)}."


def _by_sweep(data: ReportData, parameter: str) -> str:
    """Sentence on one parameter in the scenario that generalises, over all spots."""
    rows = data.identified(together=False).filter(parameter=parameter)
    name, words = data.brief[parameter].name, rows["identifiability"].to_list()
    if not words:
        return f"{name}: nothing is known of how well it is identified."
    counts = {word: words.count(word) for word in [*(word for _, word in WORDS), UNCLEAR] if word in words}
    spots = ", ".join(f"{_phrase(word)} at {n} of {len(words)} spots" for word, n in counts.items())
    if len(counts) == 1:
        spots = _phrase(words[0])
    strongest = rows.drop_nulls("correlation").sort(
        pl.col("correlation").abs(), descending=True, maintain_order=True
    )
    trade = ""
    if not strongest.is_empty() and abs(strongest["correlation"][0]) >= THRESHOLDS.correlated:
        row = strongest.row(0, named=True)
        other = data.brief[row["most_correlated_with"]].name
        trade = f"; most correlated with {other} (correlation {row['correlation']:.2f}, spot {row['spot']})"
    return f"{name}: {_together(data, parameter)}{spots}{trade}."


def _together(data: ReportData, parameter: str) -> str:
    """Value and interval by all spots together; empty where they cannot be given."""
    rows = data.identified(together=True).filter(parameter=parameter).drop_nulls("lower")
    if rows.is_empty():
        return ""
    row, unit, where = rows.row(0, named=True), data.brief[parameter].unit, ""
    of, best = ("", row["value"]) if data.is_fitted else ("fitted optimum ", row["optimum"])
    if len(data.spots) > 1:
        where = f"{_phrase(row['identifiability'])} by all spots together; spot by spot: "
    known = row["lower"], row["upper"]
    best, lower, upper = (rounded(each, *known) for each in (best, *known))
    ends = with_unit(f"{lower} to {upper}", unit)
    return f"{of}{with_unit(best, unit)}, {ends} fits about as well; {where}"


def _phrase(word: str) -> str:
    return {"not": "not identifiable", UNCLEAR: "unclear"}.get(word, f"{word} identifiable")


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """Content of the report, and where it is.

    Parameters
    ----------
    conclusion : Conclusion
        What the run amounts to, and its warnings.
    files : tuple of Path
        Everything that was written.
    pictures : mapping of str to bytes
        SVG of each figure by its name; empty where none was drawn.
    """

    tables: Mapping[str, pl.DataFrame]
    conclusion: Conclusion
    files: tuple[Path, ...] = ()
    pictures: Mapping[str, bytes] = field(default_factory=dict)

    @classmethod
    def of(cls, data: ReportData) -> Self:
        """Report of these data that is not written."""
        tables = make_tables(data)
        return cls(tables=tables, conclusion=make_conclusion(data, tables))
