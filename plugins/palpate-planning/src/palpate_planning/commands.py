"""``palpate next`` and ``palpate extend``: which presses to make, and a run with one more."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.api import StudyError, typed
from palpate.api.cli import (
    AsJson,
    OutFolder,
    RunPath,
    Session,
    StageProgress,
    Tables,
    TrustPlugins,
    find_run,
    is_study,
    newest_run,
    original_study,
    run_and_show,
    run_folder,
)

if TYPE_CHECKING:
    import polars as pl

    from palpate.api.fit import FitResult
    from palpate.api.runs import Study
    from palpate_planning.plan import Proposal
    from palpate_planning.tables import ProposalOutput

FIRST_PRESSES, FURTHER_PRESSES = 3, 1
"""Presses to choose where no number is given: for a study without a fit, and for a run."""


AllowedFile = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Spots, protocols and limits to choose among; default: shares of the study's own.",
        show_default=False,
    ),
]
GoalName = Annotated[
    str | None,
    typer.Option(
        "--for",
        metavar="GOAL",
        help="Error to reduce: all, worst, one parameter, or with --tool the prediction; default: all.",
        show_default=False,
    ),
]
ToolFile = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Reduce the error of the force of this tool, as `palpate predict` reports it.",
        show_default=False,
    ),
]
NPresses = Annotated[
    int | None,
    typer.Option(
        "--presses",
        min=1,
        max=20,
        help="Presses to choose, one after the other; default: 1, without a fit 3.",
        show_default=False,
    ),
]
NPoints = Annotated[
    int | None,
    typer.Option(
        "--points",
        min=1,
        max=50,
        help="Likely parameters at which each is simulated; default: up to 6, no slower than the run.",
        show_default=False,
    ),
]
Quick = Annotated[
    bool, typer.Option("--quick", help="One simulation of each press, linear around the fit, coarse meshes.")
]


def next_(  # named apart from the builtin
    context: typer.Context,
    run: RunPath = None,
    out: OutFolder = None,
    allowed: AllowedFile = None,
    goal: GoalName = None,
    tool: ToolFile = None,
    n_presses: NPresses = None,
    n_points: NPoints = None,
    quick: Quick = False,
    trust_plugins: TrustPlugins = False,
    as_json: AsJson = False,
) -> None:
    """Rank possible next presses by the error expected after making them.

    The error has the variance of the intervals and the bias of the meshes. For a study without a fit it is
    expected over the ranges, and nothing needs to be measured.
    """
    from palpate.api.runs import RunDirectory, load_limbs, read_options, read_tool
    from palpate_planning.candidates import Allowed
    from palpate_planning.figure import draw
    from palpate_planning.propose import PlanOptions, propose

    folder = _run_to_extend(run, out)
    session, study = _study_of(Session.of(context), folder, run, trust=trust_plugins)
    options = PlanOptions(
        allowed=read_options(allowed, Allowed, {}) if allowed else None,
        tool=read_tool(tool, study, session.plugins) if tool else None,
        goal=goal,
        n_presses=n_presses or (FURTHER_PRESSES if folder else FIRST_PRESSES),
        n_points=n_points,
        is_quick=quick,
    )
    where = folder or run_folder(study, out)
    with StageProgress(session) as progress:
        found = propose(study, where, session.plugins, progress, options)
    picture = draw(found, load_limbs(study, to_show=True), where)[0]
    if as_json:
        content: Any = {**RunDirectory(where).proposal(), "warnings": progress.warnings}
        printed: ProposalOutput = content
        session.json(printed)
        return
    _show(session, study, found)
    session.labelled("Picture", picture.resolve().as_uri())
    _say_next(session, found, folder, f"poses and paths are in {where / 'next.json'}")


def _study_of(
    session: Session, folder: Path | None, study: Path | None, *, trust: bool
) -> "tuple[Session, Study]":
    """Study of a run, or the study itself, which need not be measured; and a session with its plugins."""
    if folder is None:
        assert study is not None
        return session, session.study(study, need_measured=False)
    session, file = original_study(session, folder, trust=trust)
    return session, session.study(file)


def _say_next(session: Session, found: "Proposal", folder: Path | None, poses: str) -> None:
    """Show the command that adds the press to the run in the folder, once it is measured."""
    if folder is None:
        session.note(f"no fit, so over the ranges of the study; {poses}")
        return
    name = found.steps[0].chosen.press.press.name
    before = f"{poses}; once the press is measured, "
    session.next(f"extend {{folder}} --press {name} --with {name}.csv", before, folder=folder)


def _run_to_extend(given: Path | None, out: Path | None) -> Path | None:
    """Run directory that further presses are for; None for a study that has no fit yet."""
    from palpate.api.runs import FIRST_ANSWER, RunDirectory

    study = given if given is not None and is_study(given) else None
    if out is not None and study is None:
        raise StudyError(f"--out {out}: is for a study; further presses of a run are planned in its folder")
    found = find_run(given) if study is None else newest_run(study) if out is None else None
    if found and RunDirectory(found).records.has(FIRST_ANSWER):
        raise StudyError(f"{found} has a first answer alone; finish the run: `palpate run {typed(found)}`")
    return found if study is None or (found and (found / "fit.parquet").exists()) else None


def _show(session: Session, study: "Study", found: "Proposal") -> None:
    from palpate_planning.candidates import described, is_repeat
    from palpate_planning.tables import not_narrowed, proposal_tables, shown_intervals
    from palpate_report.api import rows_in_display_units

    tables = proposal_tables(found)
    if found.failure:
        session.paragraph(
            f"The model does not describe the data ({found.failure}), so the expected errors would mislead."
            f" First repeat the press at {found.check} as it was: if its curves repeat, the model is "
            "wrong, else the measurement. Presses to make if the model were right:"
        )
    every = [each.press.press for step in found.steps for each in step.ranked]
    again = [press.name for press in every if is_repeat(study, press)]
    for number, ranking in tables["ranking"].group_by("step", maintain_order=True):
        title = (
            f"Press {number[0]}: expected error ({found.goal.name}), with the bias of the meshes, and width "
            "of each interval, in % of those before the press"
        )
        _show_ranking(session, title, ranking, again)
    if same := not_narrowed(tables["ranking"].filter(step=1)):
        session.paragraph(f"No allowed press narrows {', '.join(same)} by more than 5 %.")
    intervals = shown_intervals(rows_in_display_units(study, tables["intervals"]))
    session.frame("95 % intervals: now (step 0), and expected after each press", intervals)
    session.paragraph(
        "mesh_bias is the most by which mesh errors of one standard deviation each change a value, in its "
        "unit. The error of a press counts it; the intervals do not."
    )
    if tables["refused"].height:
        session.frame("Refused", tables["refused"])
    for k, step in enumerate([] if found.failure else found.steps, 1):
        chosen = step.chosen.press.press
        widths = intervals.filter(step=k).select("parameter", "width").iter_rows()
        then = ", ".join(f"{name} {width}" for name, width in widths)
        session.labelled("Press", f"{chosen.name} at {chosen.spot}: {described(chosen)}; widths then: {then}")


def _show_ranking(session: Session, title: str, ranking: "pl.DataFrame", again: Sequence[str]) -> None:
    """Show the candidates of one step; ``again`` names those that repeat a press."""
    import polars as pl

    from palpate_planning.candidates import PRESSURE
    from palpate_planning.tables import shown_ranking

    labels = {name: channel.ordinate_label for name, channel in session.plugins.channels.items()}
    # Candidates that are printed for each step.
    shown = shown_ranking(ranking, {**labels, PRESSURE: "pressure (MPa)"}).head(8)
    mark = pl.when(pl.col("press").is_in(again)).then(pl.lit(" (repeat)")).otherwise(pl.lit(""))
    session.frame(title, shown.with_columns(pl.col("protocol") + mark))
    if (first := ranking.row(0, named=True))["press"] in again:
        session.paragraph(f"{first['press']} repeats the press at {first['spot']} as it was made.")
    best = ranking.row(int(ranking["error"].arg_min() or 0), named=True)
    if best["error"] >= 1.0:
        session.paragraph(
            "No allowed press reduces the error: with the meshes at their worst, each adds as much bias "
            "as it takes variance away. Use finer meshes, or allow other presses."
        )
    if best["press"] != ranking["press"][0]:
        session.paragraph(
            f"{best['press']} would reduce the error more, but is at a place that has been pressed: at "
            "two places the meshes err differently. places = 1 at the top of the file of --allowed ranks "
            "presses by the error alone."
        )


def extend(
    context: typer.Context,
    measured: Annotated[Path, typer.Option("--with", metavar="FILE", help="Measured curves of the press.")],
    run: RunPath = None,
    press: Annotated[
        str | None, typer.Option("--press", metavar="NAME", help="Which press; default: the best.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FOLDER", help="Run directory; default: RUN and the press."),
    ] = None,
    trust_plugins: TrustPlugins = False,
    tables: Tables = False,
    as_json: AsJson = False,
) -> None:
    """Add a measured press to a run: a study with one more press, fitted in a copy of the run.

    The fit starts at the answer of the run.
    """
    from palpate.api.runs import RunDirectory
    from palpate_planning.candidates import extended_study

    folder = find_run(run)
    session, file = original_study(Session.of(context), folder, trust=trust_plugins)
    name, written = extended_study(folder, file, press, measured)
    target, before = out or folder.with_name(f"{folder.name}-{name}"), RunDirectory(folder)
    fit = before.fit()
    session.note(f"study with the press '{name}': {written}")
    study = session.study(written)
    run_and_show(
        session,
        study,
        folder,
        go_on=True,
        fork=target,
        trust=(),
        tables=tables,
        as_json=as_json,
        adopt=True,
        fit_start=fit.joint_values(study.generalise_by),
    )
    if not as_json:
        _show_realised(session, study, name, before.proposal(), (fit, RunDirectory(target).fit()))


def _show_realised(
    session: Session, study: "Study", press: str, proposed: Mapping[str, Any], fits: "Sequence[FitResult]"
) -> None:
    """Show the intervals that were expected of a press next to the intervals of the fit with it."""
    from palpate_planning.tables import realised, shown_realised

    found = realised(proposed, press, *(f.intervals.filter(scenario=study.generalise_by) for f in fits))
    if found.height:
        session.frame(f"95 % intervals before and with {press}, in % of the value", shown_realised(found))
