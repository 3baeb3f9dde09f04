"""``palpate check``: everything that can be known before the first simulation."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli import completion
from palpate.cli.experiment import show_cycles
from palpate.cli.limb import show_remarks
from palpate.cli.options import AsJson
from palpate.cli.progress import StageProgress
from palpate.cli.results import data_notice
from palpate.cli.runs import newest_run
from palpate.cli.session import Session
from palpate.errors import StudyError, typed
from palpate.progress import FIRST_LOOK

if TYPE_CHECKING:
    from palpate.cli.output import CheckOutput, Searched
    from palpate.domain import Curve, Parameter
    from palpate.run.result import StudyInputs
    from palpate.simulation.cost import Cost
    from palpate.study.reading import Study


def check(
    context: typer.Context,
    study: Annotated[
        Path | None,
        typer.Argument(
            metavar="STUDY",
            help="A study.toml, or the folder that holds one.",
            autocompletion=completion.studies,
        ),
    ] = None,
    schema: Annotated[
        bool, typer.Option("--schema", help="Print the JSON schema of study.toml instead.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Check a study with its curves and meshes, and how long it will take; writes nothing."""
    session = Session.of(context)
    if schema:
        from palpate.study.schema import NAMED_BY, json_schema

        kinds = {kind: session.plugins.catalogue(kind) for kind in NAMED_BY}
        session.json(
            json_schema({kind: {n: c.Settings for n, c in each.items()} for kind, each in kinds.items()})
        )
        return
    if study is None:
        raise StudyError("no study given; name a study.toml: palpate check STUDY")
    from palpate.stages import pipeline

    with StageProgress(session, keeps=False) as progress:
        progress.begin("check", 1)
        checked_study = session.study(study)
        checked = pipeline.check_study(checked_study, session.plugins)
        progress.step()
        left = _cost(session, checked_study, checked, study, progress)
    show_remarks(session, checked.limbs)
    for text in checked.warnings:
        session.stderr.print(f"warning: {text}", markup=False)
    if as_json:
        session.json(_as_json(checked_study, checked, left))
        return
    _show(session, checked_study, checked)
    _say_cost(session, study, checked.design.n_sets, left)
    session.next("run {study}", study=study)


def _cost(
    session: Session, study: "Study", checked: "StudyInputs", path: Path, progress: StageProgress
) -> "Cost":
    """Simulations left after the newest run of the study; one is timed if no time is known."""
    from palpate.simulation import cost, jobs as simulation
    from palpate.stages.pipeline import parts_of

    keys = simulation.keys(study, checked.jobs, checked.limbs)
    by_key, run = dict(zip(keys, checked.jobs, strict=True)), newest_run(path)
    left = cost.cost(study, by_key, run, checked.limbs, parts_of(study, checked, session.plugins))
    if left.seconds_each is None and (left.n_left or left.n_fit):
        progress.begin("timing a simulation", 1)
        to_time = checked.jobs or simulation.middle_jobs(study, checked.measured)
        left = replace(left, seconds_each=cost.timed(study, to_time, checked.limbs))
        progress.step()
    return left


def _say_cost(session: Session, path: Path, n_sets: int, left: "Cost") -> None:
    if left.seconds_each is None or not (left.n_left or left.n_fit):
        return
    session.say(str(left))
    if first := left.first_look(n_sets):
        session.say(
            f"{first}: palpate run {typed(path)} --sets {FIRST_LOOK}; the whole run keeps its simulations"
        )


def _as_json(study: "Study", checked: "StudyInputs", left: "Cost") -> "CheckOutput":
    from palpate.limb.outer_surface import surface_shares

    return {
        "study": study.name,
        "data": study.data,
        "spots": {spot: list(response) for spot, response in checked.measured.items()},
        "searched": list(map(_limits, study.space.parameters)),
        "fit": {"search": study.search.name, "searched": list(map(_limits, _by_fit_alone(study)))},
        "tied": {name: str(tie) for name, tie in study.space.ties.items()},
        "n_drawn": checked.design.n_drawn,
        "n_sets": checked.design.n_sets,
        "n_left": left.n_left,
        "seconds": left.seconds,
        "n_fit": left.n_fit,
        "fit_seconds": left.fit_seconds,
        "solver": study.solver.name,
        "scenarios": [scenario.name for scenario in study.scenarios],
        "surface": {spot: surface_shares(limb.mesh) for spot, limb in checked.limbs.items()},
        "remarks": {spot: list(limb.remarks) for spot, limb in checked.limbs.items()},
        "warnings": list(checked.warnings),
    }


def _show_spots(session: Session, study: "Study", checked: "StudyInputs") -> None:
    from palpate.limb.outer_surface import surface_shares

    heads = ("nodes (edge under the indenter)", "outer surface: fixed, in contact, free")
    rows = [
        [
            spot,
            ", ".join(_peak(session, curve) for curve in response.curves.values()),
            _meshes(study, checked, spot),
            str(surface_shares(checked.limbs[spot].mesh)) if spot in checked.limbs else None,
        ]
        for spot, response in checked.measured.items()
    ]
    session.table("Spots", ["spot", "channels and peaks", *heads], rows)


def _show(session: Session, study: "Study", checked: "StudyInputs") -> None:
    from palpate.study.display_units import in_units

    odd = f", warnings on stderr: {len(checked.warnings)}" if checked.warnings else ""
    session.say(f"{study.name}: no mistakes found{odd}; {data_notice(study)}")
    session.table(
        "Searched parameters",
        ["name", "lower", "upper", "unit", "prior", "description"],
        [
            [
                *(p.name, p.lower, p.upper, p.unit),
                f"{p.prior.value:g} ± {p.prior.sd:g}" if p.prior else None,
                f"{p.description}; a value for each {p.by}" if p.by else p.description,
            ]
            for p in in_units(study, (*study.space.parameters, *_by_fit_alone(study)))
        ],
    )
    for name, tie in study.space.ties.items():
        session.say(f"{name} = {tie}")
    _show_spots(session, study, checked)
    show_cycles(session, checked.measured)
    n_drawn, n_sets = checked.design.n_drawn, checked.design.n_sets
    kept = f"{n_drawn} sets drawn, {n_sets} kept by the filters; {n_sets * len(checked.measured)} simulations"
    session.say(f"{kept if n_drawn else 'no sweep'}; solver {study.solver.name}")
    starts = "the best sets" if n_sets else "the priors, or the middle of a range without one"
    session.say(f"fit by {study.search.name}, from {starts}")


def _by_fit_alone(study: "Study") -> list["Parameter"]:
    """Parameters of the fit that the sweep does not have, as at a single spot."""
    swept = {p.name for p in study.space.parameters}
    every = study.parametrisation.parameters(study.space, study.spot_names[:1])
    return [p for p in every if p.name not in swept]


def _limits(p: "Parameter") -> "Searched":
    return {"name": p.name, "lower": p.lower, "upper": p.upper, "unit": p.unit}


def _meshes(study: "Study", checked: "StudyInputs", spot: str) -> str:
    """Nodes and edges of a spot's mesh, and of its finer one."""
    from palpate.domain import FINE
    from palpate.limb.loading import size_at_contact

    limbs = [checked.limbs[name] for name in (spot, f"{spot}{FINE}") if name in checked.limbs]
    return ", fine ".join(f"{limb.mesh.n_nodes} ({size_at_contact(study, limb):.2f} mm)" for limb in limbs)


def _peak(session: Session, curve: "Curve") -> str:
    unit = session.plugins.channels[curve.channel].units[1].replace("Nmm", "N·mm")
    return f"{curve.channel.replace('_', ' ')} {abs(curve.ordinate).max():.4g} {unit}"
