"""Cards of what a run has found, one for each region."""

from collections.abc import Iterator

import numpy as np

from palpate.api import FloatArray, RegionMaterial, Run
from palpate.api.fit import FitResult, Fitted, inputs_at
from palpate_prediction.cards.card import CardData, ranges_of
from palpate_report.best_sets import best_sets
from palpate_report.from_run import report_data
from palpate_report.headline import failure_of, headlines
from palpate_report.marks import TIED


def cards_of(run: Run) -> Iterator[CardData]:
    """What was found for all spots together, by region; a value by spot is that of the first."""
    data = report_data(run)
    bests = tuple(best_sets(data))
    failure, known = failure_of(data, bests), {each.name: each for each in headlines(data, bests)}
    study, found, fit = run.study, run.fitted(), run.fit()
    strains = run.strains().values()
    thetas = inputs_at(study, found.spots[0], found.values, run.measured).thetas
    for number, region in enumerate(study.space.regions, start=1):
        theta = thetas[region.region]
        full = {p.name: f"{region.region}.{p.name}" for p in region.material.parameters}
        searched = {p: known.get(name) or known.get(f"{name}@{found.spots[0]}") for p, name in full.items()}
        source = "fitted" if found.source == "fit" else "selected"
        yield CardData(
            title=f"{study.name}, region {region.region}, material {region.material.name} ({found.source}, "
            f"scenario {found.scenario}, spots {', '.join(found.spots)})",
            region=region.region,
            material=region.material,
            theta=theta,
            intervals=_intervals(fit, found, region, theta),
            strain=ranges_of([strain[region.region] for strain in strains if region.region in strain]),
            origins={p: "fixed" if p in region.fixed else TIED if p in region.tied else source for p in full},
            verdicts={p: each.verdict for p, each in searched.items() if each},
            failure=failure,
            number=number,
        )


def _intervals(
    fit: FitResult, found: Fitted, region: RegionMaterial, theta: FloatArray
) -> dict[str, tuple[float, float]]:
    """95 % intervals in textbook values, of the parameters that the fit has some for."""
    table = fit.certainty.intervals
    if table.is_empty() or found.source != "fit":
        return {}
    rows = table.filter(fit=found.fit, scenario=found.scenario).iter_rows(named=True)
    known = {}
    for row in rows:
        name, _, spot = row["parameter"].partition("@")
        if spot in ("", found.spots[0]):  # whose values these are
            known[name] = (row["lower"], row["upper"])
    intervals = {}
    for i, parameter in enumerate(region.material.parameters):
        if (ends := known.get(f"{region.region}.{parameter.name}")) is None or None in ends:
            continue
        values = np.tile(region.material.from_textbook(theta, region.convention), (2, 1))
        values[:, i] = ends
        lower, upper = sorted(float(region.material.to_textbook(v, region.convention)[i]) for v in values)
        intervals[parameter.name] = (lower, upper)
    return intervals
