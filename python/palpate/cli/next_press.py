"""``palpate plan``, ``next`` and ``extend``: which presses to make, and a run with one more."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from palpate.cli.options import AsJson, OutFolder, RunPath, StudyPath, Tables, TrustPlugins
from palpate.cli.progress import StageProgress
from palpate.cli.run import go
from palpate.cli.runs import find_run, plugins_of, session_of_run, study_file_of
from palpate.cli.session import Session, run_folder
from palpate.errors import StudyError

if TYPE_CHECKING:
    from palpate.study.reading import Study
    from palpate_planning.options import PlanOptions
    from palpate_planning.stage import Proposal

SHOWN = 8
"""Candidates that are printed for each step."""


Allowed: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--allowed",
        metavar="FILE",
        help="Spots, protocols and limits to choose among; default: shares of the study's own.",
        show_default=False,
    ),
]
Goal: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--for",
        metavar="GOAL",
        help="What to narrow: all, worst, one parameter, or with --tool the prediction; default: all.",
        show_default=False,
    ),
]
ToolFile: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--tool",
        metavar="FILE",
        help="Narrow the force of this tool, as `palpate predict` reports it.",
        show_default=False,
    ),
]
NumberOfPresses: TypeAlias = Annotated[
    int, typer.Option("--presses", min=1, max=20, help="Presses to choose, one after the other.")
]
NumberOfPoints: TypeAlias = Annotated[
    int, typer.Option("--points", min=1, max=50, help="Likely parameters at which each is simulated.")
]


def next_(  # named apart from the builtin
    context: typer.Context,
    run: RunPath = None,
    allowed: Allowed = None,
    goal: Goal = None,
    tool: ToolFile = None,
    n_presses: NumberOfPresses = 1,
    n_points: NumberOfPoints = 6,
    trust_plugins: TrustPlugins = False,
    as_json: AsJson = False,
) -> None:
    """Rank further presses by how much each would narrow the intervals of a run."""
    from palpate_planning.propose import propose

    folder, session, file = _of_run(context, run, trust=trust_plugins)
    study = session.study(file)
    options = _options(session, study, allowed, tool, goal=goal, n_presses=n_presses, n_points=n_points)
    with StageProgress(session, folder) as progress:
        found = propose(study, folder, session.plugins, progress, options)
    picture = _draw(study, found, folder)
    if as_json:
        _print_json(session, folder, progress)
        return
    _show(session, study, found)
    session.labelled("Picture", picture.resolve().as_uri())
    name = found.steps[0].chosen.press.press.name
    session.next(
        f"extend {folder} --press {name} --with {name}.csv",
        f"poses and paths are in {folder / 'next.json'}; once the press is measured, ",
    )


def plan(
    context: typer.Context,
    study: StudyPath,
    out: OutFolder = None,
    allowed: Allowed = None,
    goal: Goal = None,
    tool: ToolFile = None,
    n_presses: NumberOfPresses = 3,
    n_points: NumberOfPoints = 6,
    as_json: AsJson = False,
) -> None:
    """Rank the first presses of a study, over its ranges; nothing needs to be measured."""
    from palpate_planning.propose import plan as plan_presses

    session = Session.of(context)
    checked = session.study(study, need_measured=False)
    folder = run_folder(checked, out)
    options = _options(session, checked, allowed, tool, goal=goal, n_presses=n_presses, n_points=n_points)
    with StageProgress(session) as progress:
        found = plan_presses(checked, folder, session.plugins, progress, options)
    picture = _draw(checked, found, folder)
    if as_json:
        _print_json(session, folder, progress)
        return
    _show(session, checked, found)
    session.labelled("Picture", picture.resolve().as_uri())
    session.note(f"poses and paths are in {folder / 'next.json'}")


def _options(
    session: Session,
    study: "Study",
    allowed: Path | None,
    tool: Path | None,
    *,
    goal: str | None,
    n_presses: int,
    n_points: int,
) -> "PlanOptions":
    from palpate.study.tool import read_tool
    from palpate_planning.candidates import read_allowed
    from palpate_planning.options import PlanOptions

    return PlanOptions(
        allowed=read_allowed(allowed) if allowed else None,
        tool=read_tool(tool, study, session.plugins) if tool else None,
        goal=goal,
        n_presses=n_presses,
        n_points=n_points,
    )


def _draw(study: "Study", found: "Proposal", folder: Path) -> Path:
    from palpate.limb.loading import load_limbs
    from palpate_planning.figure import draw

    return draw(found, load_limbs(study, to_show=True), folder)[0]


def _print_json(session: Session, folder: Path, progress: StageProgress) -> None:
    from palpate.run.directory import RunDirectory

    session.json({**RunDirectory(folder).proposal(), "warnings": progress.warnings})


def _show(session: Session, study: "Study", found: "Proposal") -> None:
    from palpate_planning.tables import proposal_tables
    from palpate_report.written_units import rows_in_written_units

    tables = proposal_tables(found)
    if found.failed_checks:
        failed = ", ".join(found.failed_checks)
        session.paragraph(
            f"The model does not describe the data ({failed}), so narrower intervals would mislead."
            f" First repeat the press at {found.check} as it was: if its curves repeat, the model is "
            "wrong, else the measurement. What would narrow the intervals if the model were right:"
        )
    for number, ranking in tables.ranking.group_by("step", maintain_order=True):
        title = f"Press {number[0]}: width after it, over that before"
        session.frame(title, ranking.drop("step").head(SHOWN))
    intervals = rows_in_written_units(study, tables.intervals, ("value", "lower", "upper"))
    session.frame("95 % intervals: now (step 0), and expected after each press", intervals)
    if tables.refused.height:
        session.frame("Refused", tables.refused)


def extend(
    context: typer.Context,
    run: RunPath = None,
    measured: Annotated[
        Path | None, typer.Option("--with", metavar="FILE", help="Measured curves of the press.")
    ] = None,
    press: Annotated[
        str | None, typer.Option("--press", metavar="NAME", help="Which press; default: the best.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FOLDER", help="Run directory; default: that of RUN with the press."),
    ] = None,
    trust_plugins: TrustPlugins = False,
    tables: Tables = False,
    as_json: AsJson = False,
) -> None:
    """Add a measured press to a run: a study with one more press, fitted in a copy of the run.

    The fit starts at the answer of the run.
    """
    from palpate.run.directory import RunDirectory
    from palpate_planning.extension import extended_study

    if measured is None:
        raise StudyError("name the measured curves of the press: --with FILE")
    folder, session, file = _of_run(context, run, trust=trust_plugins)
    name, written = extended_study(folder, file, press, measured)
    target = out or folder.with_name(f"{folder.name}-{name}")
    session.note(f"study with the press '{name}': {written}")
    study = session.study(written)
    go(
        session,
        study,
        folder,
        go_on=True,
        fork=target,
        trust=(),
        tables=tables,
        as_json=as_json,
        adopt=True,
        fit_start=RunDirectory(folder).fit().joint_values(study.generalise_by),
    )


def _of_run(context: typer.Context, run: Path | None, *, trust: bool) -> tuple[Path, Session, Path]:
    """Folder of a run, a session with its plugins, and its study file."""
    from palpate.run.directory import RunDirectory
    from palpate.study.reading import study_plugins

    folder = find_run(run)
    manifest = RunDirectory(folder).manifest()
    file = study_file_of(folder, manifest, "put it back, with its meshes")
    named = [*plugins_of(folder, manifest), *study_plugins(file)]
    return folder, session_of_run(Session.of(context), folder, named, trust=trust, command="next"), file
