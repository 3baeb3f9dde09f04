"""``palpate experiment``: measured curves of a study, and what a file without a study holds."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from palpate.cli.options import AsJson, OutFolder, StudyOrRun, TrustPlugins, examples
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session, opened
from palpate.cli.stages import show_next

if TYPE_CHECKING:
    from palpate.domain import Response
    from palpate.plugins.optional import Inspection

Plots = Annotated[
    bool,
    typer.Option(
        "--plots",
        help="Draw every step from file to curve into measured/plots/, and all curves with a common cursor "
        "on the page measured/curves.html.",
    ),
]


def _rows(session: Session, spot: str, response: "Response") -> Iterator[dict[str, Any]]:
    """Row of each measured curve of a spot."""
    averages = response.record.get("averages", {})
    for name, curve in response.curves.items():
        along, unit = session.plugins.channels[name].units
        yield {
            "spot": spot,
            "channel": name,
            "n_points": curve.abscissa.size,
            "n_presses": averages[name]["n_presses"] if name in averages else 1,
            "over": f"{curve.abscissa.min():.4g} to {curve.abscissa.max():.4g} {along}".rstrip(),
            "least": float(curve.ordinate.min()),
            "largest": float(curve.ordinate.max()),
            "unit": unit,
            "largest_std": None if curve.std is None else float(curve.std.max()),
        }


def experiment(
    context: typer.Context,
    study: StudyOrRun,
    out: OutFolder = None,
    plots: Plots = False,
    trust_plugins: TrustPlugins = False,
    as_json: AsJson = False,
) -> None:
    """Read the measured curves of a study; `palpate experiment inspect FILE` shows a log's columns."""
    from palpate.run.directory import RunDirectory
    from palpate.stages import pipeline
    from palpate.stages.stage import read_run

    session, checked, folder = opened(context, study, out, trust=trust_plugins)
    with StageProgress(session) as progress:
        measured = pipeline.measure(checked, folder, session.plugins, progress, plots=plots)
    rows = [row for spot in checked.spot_names for row in _rows(session, spot, measured[spot])]
    if as_json:
        session.json(rows)
        return
    cells = [
        [
            *(row[key] for key in ("spot", "channel", "n_points", "n_presses", "over")),
            f"{row['least']:.4g} to {row['largest']:.4g} {row['unit']}",
            None if row["largest_std"] is None else f"{row['largest_std']:.2g} {row['unit']}",
        ]
        for row in rows
    ]
    heads = ["spot", "channel", "points", "presses", "over", "values", "largest sd"]
    session.table("Measured curves", heads, cells)
    show_cycles(session, measured)
    directory = RunDirectory(folder)
    if plots:
        session.note(f"pictures in {folder / 'measured' / 'plots'}")
        if directory.curves_page.is_file():
            session.say(f"Page  {directory.curves_page.resolve().as_uri()}")
    show_next(session, read_run(checked, directory, session.plugins), "experiment", study)


def show_cycles(session: Session, measured: "Mapping[str, Response]") -> None:
    """Print a table of the cycles of each log that holds several."""
    from palpate.experiment.cycles import cycles_of

    for _, file, rows in cycles_of(measured):
        channels = dict.fromkeys(name for row in rows for name in row.get("peaks", ()))
        cells = []
        for row in rows:
            cell = [f"{row['cycle']}{' (counts)' * row['counts']}", row["start_s"], row.get("depth_mm")]
            for name in channels:
                change = row.get("changes", {}).get(name, {})
                cell.append(row.get("peaks", {}).get(name))
                shares = (change.get(key) for key in ("share", "since_first"))
                cell += (None if share is None else f"{100.0 * share:+.1f} %" for share in shares)
            cells.append([*cell, row.get("work_Nmm")])
        peaks = (f"{name} ({session.plugins.channels[name].units[1]})" for name in channels)
        heads = [head for peak in peaks for head in (peak, "since before", "since first")]
        session.table(f"Cycles of {file}", ["cycle", "from (s)", "depth (mm)", *heads, "work (N·mm)"], cells)
        for row in (row for row in rows if row["problem"]):
            session.say(f"cycle {row['cycle']} cannot be processed: {row['problem']}")


STAGE = "study"
"""Command of the stage itself, which nobody writes: a study may have this name."""


class StageGroup(TyperGroup):
    """A stage with commands of its own: any other first word is a file of one, or the study."""

    @property
    def suffixes(self) -> dict[str, frozenset[str]]:
        """Suffixes of the files whose name alone calls a command, by the command."""
        return {name: getattr(command, "suffixes", frozenset()) for name, command in self.commands.items()}

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - a context of whichever click typer carries
        """Put the stage's own command before arguments that name no other."""
        is_help = args and args[0] in ctx.help_option_names
        if args and args[0] not in self.commands.keys() - {STAGE} and not is_help:
            suffix = PurePath(args[0]).suffix.lower()
            names = (name for name, kinds in self.suffixes.items() if suffix in kinds)
            args = [next(names, STAGE), *args]
        return super().parse_args(ctx, args)


def stage_group(stage: Callable[..., None], metavar: str) -> typer.Typer:
    """A stage as a group, which more commands may be added to."""
    group = typer.Typer(
        cls=StageGroup,
        no_args_is_help=True,
        rich_markup_mode=None,
        subcommand_metavar=metavar,
        help=stage.__doc__,
    )
    group.command(STAGE, hidden=True)(stage)
    return group


def experiment_commands() -> typer.Typer:
    """``palpate experiment STUDY`` and ``palpate experiment inspect FILE``."""
    group = stage_group(experiment, "STUDY | inspect FILE")
    calls = examples(
        "palpate experiment inspect press.csv",
        "palpate experiment inspect pose.csv wrench.csv",
        "palpate experiment inspect bag/ --loader NAME",
    )
    group.command(epilog=calls)(inspect)
    return group


def inspect(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A log, or the folder of a bag.")],
    other: Annotated[
        Path | None, typer.Argument(metavar="[WRENCH]", help="The file of the wrench, if it is another one.")
    ] = None,
    loader: Annotated[
        str | None, typer.Option("--loader", metavar="NAME", help="Loader to ask; default: all that can.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show the columns of a file, and the tables of study.toml that would read it."""
    session = Session.of(context)
    found = look_into(file, other, session, loader)
    if as_json:
        session.json(found.record)
        return
    for table in found.tables:
        session.table(table.title, table.columns, table.rows)
    for finding in found.findings:
        session.say(f"- {finding}")
    if found.study_text:
        session.say(f"\n{found.study_text}")
        wrench = " --wrench {wrench}" if other else ""
        mesh = "" if found.test else " --mesh MESH"
        how = "put these tables into a study.toml, or make one"
        how += "; " if found.test else " with your mesh of the limb at the spot; "
        session.next(f"init my-study --measured {{file}}{wrench}{mesh}", how, file=file, wrench=other)


def look_into(file: Path, other: Path | None, session: Session, loader: str | None) -> "Inspection":
    """Inspection by the first loader that can read the files; a CurveError with the reason of each."""
    from palpate.errors import CurveError
    from palpate.plugins.guard import answering_for
    from palpate.plugins.optional import FileInspector

    catalogue = session.plugins.loaders
    able = [name for name, kind in catalogue.items() if isinstance(kind, FileInspector)]
    asked = able if loader is None else [loader]
    refusals = []
    for name in asked:
        try:
            with answering_for(catalogue[name], f"inspecting {file}"):
                kind = catalogue[name]
                if not isinstance(kind, FileInspector):
                    raise CurveError(f"{file}: loader '{name}' cannot inspect files; use one that can")
                return kind.inspect(file) if other is None else kind.inspect(file, other)
        except CurveError as error:
            refusals.append(str(error) if len(asked) == 1 else f"{name}: {error}")
    if not refusals:
        raise CurveError(f"{file}: no loader can inspect files; install a plugin with one that can")
    raise CurveError("; ".join(refusals))
