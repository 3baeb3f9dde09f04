"""A paragraph on the methods of a run for a paper, from the run's own settings, and what to cite."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from palpate.api import Indentation, Parameter, RegionMaterial, convert
from palpate.api.runs import FINE
from palpate_report.answer.headline import between_spots
from palpate_report.answer.law import law_name
from palpate_report.answer.model_verdict import NO_PARAMETERS
from palpate_report.answer.next_step import cause_name
from palpate_report.data.marks import Headline, in_words, range_of, with_minus, with_unit
from palpate_report.data.report_data import ReportData


def methods(data: ReportData, estimates: Sequence[Headline], not_included: Sequence[str]) -> str:
    """Paragraph on what was done, with references in BibTeX, as Markdown.

    Parameters
    ----------
    estimates : sequence of Headline
        Parameters of what leads; none where no parameters can be read.
    not_included : sequence of str
        What is in no interval.
    """
    sentences = (
        *_experiment(data),
        *_meshes(data),
        *_materials(data),
        *_search(data),
        *_intervals(data, not_included),
        f"Found: {'; '.join(map(str, estimates))}." if estimates else f"{NO_PARAMETERS}.",
    )
    return f"{with_minus(' '.join(sentences))}\n\n```bibtex\n{references(data)}```\n"


def references(data: ReportData) -> str:
    """BibTeX of this palpate and of the paper whose method it implements."""
    version = str(data.manifest.get("versions", {}).get("palpate", ""))
    return (Path(__file__).parent / "palpate.bib").read_text(encoding="utf-8").replace("VERSION", version)


def _experiment(data: ReportData) -> Iterator[str]:
    versions, study = data.manifest.get("versions", {}), data.study
    yield (
        f"Parameters were identified with palpate {versions.get('palpate', '')} "
        f"(solver {study.solver.name}, {versions.get(f'solver {study.solver.name}', 'version unknown')})."
    )
    names = list(map(in_words, data.measured_channels))
    measured = " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))
    were = "were measured" if study.data == "measured" else "were simulated, not measured"
    protocol, n = study.protocol, len(data.spots)
    spots = f"{n} spot{'s' if n > 1 else ''} ({', '.join(data.spots)})"
    if not isinstance(protocol, Indentation):
        yield f"The curves of {measured} {were}, of {spots}."
        return
    depth, turns = protocol.path[:, 0], protocol.path[:, 1]
    twist = f" and rotated from {turns.min():g}° to {turns.max():g}° about it" if turns.any() else ""
    is_searched = any(p.name.partition("@")[0] == "friction" for p in data.searched.values())
    friction = "was searched" if is_searched else f"was {protocol.friction:g}"
    tool = f"{protocol.indenter.name}, radius {protocol.indenter.radius_mm:g} mm"
    yield (
        f"At {spots} a rigid indenter ({tool}) was pressed {depth.max():g} mm along the "
        f"surface normal{twist}; {measured} {were}. "
        f"The Coulomb friction coefficient of the contact {friction}."
    )


def _meshes(data: ReportData) -> Iterator[str]:
    coarse = [limb.mesh.n_nodes for name, limb in data.limbs.items() if "/" not in name]
    if coarse and data.study.solver.provides.mesh:
        yield f"The mesh around each spot had {_range(coarse)} nodes."
    fits = data.fit.table
    if "n_fine" in fits.columns and (fits["n_fine"].sum() or 0) > 0:
        fine = [limb.mesh.n_nodes for name, limb in data.limbs.items() if name.endswith(FINE)]
        edges = [f"{spot.fine_edge_mm:g}" for spot in data.study.spots if spot.fine_edge_mm]
        of = f" of {_range(fine)} nodes" if fine else ""
        to = f", refined to edges of {edges[0]} mm at the contact," if edges else ""
        yield f"Simulations with finer meshes{of}{to} corrected the fit."


def _range(numbers: Sequence[int]) -> str:
    low, high = min(numbers), max(numbers)
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"


def _materials(data: ReportData) -> Iterator[str]:
    for region in data.study.space.regions:
        kept = f", assuming {', '.join(found)}" if (found := list(assumed(data, region))) else ""
        yield (
            f"The {in_words(region.region)} was modelled as {law_name(region.material)} "
            f"({region.convention} coefficients){kept}."
        )
    yield f"The search ranges were {', '.join(map(range_of, (data.searched | data.widened).values()))}."
    if data.widened:
        before = ", ".join(range_of(data.searched[name]) for name in data.widened)
        yield f"The search began with narrower ranges, {before}, and widened them."


def assumed(data: ReportData, region: RegionMaterial) -> Iterator[str]:
    """Equations of what is fixed, or a factor times another parameter, and has a part in the curves."""
    ignored = data.study.solver.ignored(region.material)
    for parameter in (each for each in region.material.parameters if each.name not in ignored):
        name = data.brief_name(region.name_of(parameter.name))
        if parameter.name in region.fixed:
            value, unit = region.fixed[parameter.name], parameter.unit
            if unit == "MPa" and abs(value) < 10.0:  # beyond, kPa would have too many digits
                value, unit = convert(f"{value} MPa", data.modulus_unit), data.modulus_unit
            yield f"{name} = {with_unit(f'{value:.4g}', unit)}"
        elif (tie := region.tied.get(parameter.name)) and not isinstance(tie.factor, Parameter):
            yield f"{name} = {tie.factor:.4g} × {data.brief_name(tie.source)}"


def _search(data: ReportData) -> Iterator[str]:
    study, scenario = data.study, data.generalising
    weights = " + ".join(f"{weight:g} × {in_words(name)}" for name, weight in scenario.weighed.items())
    if data.design.n_sets:
        yield (
            f"{data.design.n_sets} parameter sets (sampler {study.sampler.name}, seed {study.seed}) were "
            "simulated first."
        )
    where = ", jointly over all spots" if len(data.spots) > 1 else ""
    fopt = f"Fopt, the {study.scoring.score.name.upper()} of {weights} (scenario {scenario.name}){where}"
    if not data.is_fitted:
        yield f"The set with the least {fopt} was selected."
        return
    began = "their best" if data.design.n_sets else "the middle of the ranges"
    yield f"The search ({in_words(study.search.name)}) began at {began} and minimised {fopt}."
    if spread := between_spots(data).removeprefix("they differ, "):
        yield (
            "The spots differ. The reported values are the means of a random effect between the spots "
            "(restricted maximum likelihood; intervals of its size by the Q-profile, Viechtbauer 2007), with "
            f"the {spread}."
        )
        return
    (row,) = data.leading_rows(data.fit.ends).to_dicts()
    mean = "Mean Fopt over the spots" if len(data.spots) > 1 else "Fopt"
    if data.leading_rows(data.fit.intervals).is_empty():
        yield f"The reported values have the least Fopt. {mean} is {row['fopt']:.3g}."
        return
    yield (
        "One step of an efficient estimator led from the least Fopt to the reported values. Within a curve "
        "all points count alike; the scores of the curves are weighted by the inverse of their covariance "
        "under the error budget (generalised method of moments, Hansen 1982). "
        f"{mean} is {row['fopt']:.3g} at the reported values and {row['fopt_least']:.3g} at its least."
    )


def _intervals(data: ReportData, not_included: Sequence[str]) -> Iterator[str]:
    budget = data.leading_rows(data.table("budget"))
    if budget.is_empty():
        return
    causes = budget.filter(status="included")["cause"].unique(maintain_order=True)
    listed = ", ".join(cause_name(data, cause) for cause in causes)
    missing = f", and not {', '.join(not_included)}" if not_included else ""
    yield f"The 95 % intervals include {listed}{missing}."
