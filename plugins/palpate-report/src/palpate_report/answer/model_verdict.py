"""Verdict on the model of a run, made once: a tissue's parameters, effective ones, or none."""

from collections.abc import Iterator
from dataclasses import dataclass

from palpate.api.fit import THRESHOLDS, Adequacy, channel_of
from palpate.api.report import rounded
from palpate_report.answer.failed_checks import failed_checks
from palpate_report.answer.law import laws_of
from palpate_report.answer.warnings import CHECK
from palpate_report.data.marks import in_words
from palpate_report.data.report_data import ReportData

NO_PARAMETERS = "No parameters can be read from this run"
UNREADABLE = NO_PARAMETERS.removesuffix(" from this run")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelVerdict:
    """Verdict on the model of what leads.

    Parameters
    ----------
    verdict : Adequacy
    sentence : str
        Reason and remedy, or how close an approximation is and over which range; empty where the model
        describes the curves.
    power : str
        Sentence on the least error of a law that the curves would show; empty where they show one.
    """

    verdict: Adequacy = Adequacy.DESCRIBES
    sentence: str = ""
    power: str = ""

    @property
    def failure(self) -> str:
        """Sentence on a model without parameters; empty where there are some."""
        return self.sentence if self.verdict is Adequacy.FAILS else ""

    @property
    def approximation(self) -> str:
        """Sentence on effective parameters; empty where they are others, or none."""
        return self.sentence if self.verdict is Adequacy.APPROXIMATES else ""


def model_verdict(data: ReportData) -> ModelVerdict:
    """Verdict on the model of the fit, or of the set, that is reported."""
    rows = data.answer.filter("reported")
    verdict = Adequacy(rows["model"][0]) if rows.height else Adequacy.DESCRIBES
    if verdict is Adequacy.DESCRIBES:
        return ModelVerdict(power=_power(data))
    if verdict is Adequacy.APPROXIMATES:
        return ModelVerdict(verdict=verdict, sentence=_approximation(data))
    least, found = THRESHOLDS.no_fit_r2, r2_by_spot(data)
    wrong = [f"{name} at {spot} (R² {r2:.3g})" for name, spot, r2 in found if r2 < least]
    if wrong:
        more = f" and {len(wrong) - 4} more" if len(wrong) > 4 else ""
        why = f"the best set does not fit {', '.join(wrong[:4])}{more}"
        return ModelVerdict(verdict=verdict, sentence=f"{NO_PARAMETERS}: {why}. {CHECK}")
    main = (data.together, data.generalising.name)
    failed = [e for e in failed_checks(data) if (e.fit, e.scenario, e.verdict) == (*main, verdict)]
    remedies = " ".join(dict.fromkeys(each.remedy for each in failed))
    reasons = "; ".join(dict.fromkeys(each.message for each in failed))
    return ModelVerdict(verdict=verdict, sentence=f"{NO_PARAMETERS}: {reasons}. {remedies}")


def _power(data: ReportData) -> str:
    """Sentence on the error of a law that the curves show; empty without one."""
    checks = data.leading_rows(data.fit.adequacy)
    if "visible" not in checks.columns:  # tables of earlier runs have none
        return ""
    rows = checks.drop_nulls(["visible", "channel"]).iter_rows(named=True)
    sizes = [f"{100.0 * row['visible']:.2g} % of the {in_words(row['channel'])}" for row in rows]
    if not sizes:
        return ""
    return (
        f"Nine of ten such experiments show a law that is wrong by {' and '.join(sizes)} "
        "(standard deviation over the peak)."
    )


def _approximation(data: ReportData) -> str:
    """Sentence on the largest difference from the curves of what leads, and their range."""
    names, checks = laws_of(data.study.space), data.leading_rows(data.fit.adequacy)
    difference = f"{max(100.0 * float(checks['difference'].max()), 0.1):.2g}"  # type: ignore[arg-type]
    own = ", with values of its own at each spot" if data.spots_differ(data.generalising.name) else ""
    return (
        f"Effective parameters: {' and '.join(names)} describe{'s' if len(names) == 1 else ''} these "
        f"curves to within {difference} % of their peak{own}, for {' and '.join(_ranges(data))}."
    )


def _ranges(data: ReportData) -> Iterator[str]:
    """Each abscissa of the fitted curves with the ends that were measured."""
    ends: dict[str, list[float]] = {}
    for response in data.measured.values():
        for name in dict.fromkeys(map(channel_of, data.generalising.weighed)):
            if name in response:
                path = response[name].abscissa
                ends.setdefault(data.channels[name].abscissa_label, []).extend([path.min(), path.max()])
    for label, values in ends.items():
        quantity, _, unit = label.removesuffix(")").partition(" (")
        lower, upper = (rounded(end) for end in (min(values), max(values)))
        yield f"{quantity} {lower} to {upper}{f' {unit}' if unit else ''}"


def least_r2(data: ReportData) -> dict[str, tuple[float, str]]:
    """Least R² of each fitted channel of what leads, and its spot."""
    rows = list(r2_by_spot(data))
    return {name: min((r2, spot) for of, spot, r2 in rows if of == name) for name, _, _ in rows}


def r2_by_spot(data: ReportData) -> Iterator[tuple[str, str, float]]:
    """Name, spot and R² of each fitted channel of what leads; where spots differ, of their own fits."""
    main = data.generalising.name
    joint = data.fit.joint(main)
    if data.spots_differ(main):
        joint = data.fit.of_each_spot.filter(scenario=main)
    if len(data.spots) > 1:
        of_all = data.generalisation if joint.is_empty() else joint
        rows = [(row["spot"], row) for row in of_all.iter_rows(named=True)]
    else:
        own = (best for best in data.bests if best.scenario == main)
        rows = [(best.spot, {f"r2_{name}": r2 for name, r2 in best.r2.items()}) for best in own]
    for spot, row in rows:
        for name in data.generalising.weighed:
            if (r2 := row.get(f"r2_{name}")) is not None:
                yield in_words(name), spot, r2
