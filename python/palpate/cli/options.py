"""Help that teaches, commands in groups; and arguments and options that several commands share."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, TypeAlias

import typer
from typer.core import TyperGroup

from palpate.cli import completion
from palpate.plugins.commands import name_of as name_of
from palpate.study.source_positions import MOST_SETS

START, RUN, STAGES, MORE = "Start", "Run", "Stages, each from files to files", "More"

EXAMPLES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "init": ("palpate init", "palpate init first", "palpate init --study forearm-demo arm"),
        "check": ("palpate check arm", "palpate check --schema > study.schema.json"),
        "run": (
            "palpate run arm",
            "palpate run arm --out /scratch/arm --sets 500",
            "palpate run runs/arm --sets 500 --fork runs/arm-500",
            "palpate run arm --json > arm.json",
        ),
        "status": (
            "palpate status runs/arm",
            "palpate status runs/arm --watch",
            "palpate status runs/arm --cost",
        ),
        "plugins": ("palpate plugins", "palpate plugins materials yeoh"),
        "new-plugin": (
            "palpate new-plugin material my_tissue",
            "palpate new-plugin loader my_log --into plugins",
        ),
        "synthesise": ("palpate synthesise arm --into planned",),
        "doctor": ("palpate doctor", "palpate doctor /scratch/me --json"),
        "schema": ("palpate schema", "palpate schema run > run.schema.json"),
        "experiment": ("palpate experiment arm --plots", "palpate experiment inspect press.csv"),
        "limb": ("palpate limb arm", "palpate limb scan.ply --bones radius.stl --bones ulna.stl"),
        "sample": ("palpate sample arm",),
        "simulate": ("palpate simulate arm", "palpate simulate arm --only p1/3 --traceback"),
        "score": ("palpate score arm",),
        "select": ("palpate select arm",),
        "verify": ("palpate verify arm",),
        "fit": ("palpate fit arm",),
        "surface": ("palpate surface arm",),
        "answer": ("palpate answer arm",),
    }
)
"""How each of the core's commands may be called, in the order in which help lists them."""


def examples(*lines: str) -> str:
    """Lay examples out for the end of a command's help."""
    # The backspace tells the formatter to keep the lines as they are.
    return "\n".join(["\b", "Examples:", *(f"  {line}" for line in lines)])


class GroupedCommands(TyperGroup):
    """Lists its commands under the headings that they were added with."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:  # noqa: ANN401 - of the library's own click
        """Refuse an unknown command, with where more commands are from."""
        from palpate.plugins.registry import MORE, suggestion

        if args and not args[0].startswith("-") and self.get_command(ctx, args[0]) is None:
            close = suggestion(args[0], self.list_commands(ctx))
            ctx.fail(
                f"no command '{args[0]}'{close}; `palpate plugins` lists the plugins that are installed, and "
                f"{MORE}"
            )
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - of the library's own click
        """Write one list of commands for each heading, in the order of the first of them."""
        lists: dict[str, list[tuple[str, str]]] = {START: [], RUN: [], STAGES: []}
        for name in self.list_commands(ctx):
            command = self.get_command(ctx, name)
            if command is not None and not command.hidden:
                heading = getattr(command, "rich_help_panel", None)
                heading = heading if isinstance(heading, str) else MORE
                lists.setdefault(heading, []).append((name, command.get_short_help_str(limit=200)))
        place = {name: i for i, name in enumerate(EXAMPLES)}
        for heading, rows in lists.items():
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(sorted(rows, key=lambda row: place.get(row[0], len(place))))


StudyPath: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="STUDY", help="A study.toml, or the folder that holds one.", autocompletion=completion.studies
    ),
]
StudyOrRun: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="STUDY|RUN",
        help="A study.toml, the folder that holds one, or a run directory.",
        autocompletion=completion.studies_and_runs,
    ),
]
OutFolder: TypeAlias = Annotated[
    Path | None, typer.Option("--out", metavar="FOLDER", help="Run directory; default: runs/<study>.")
]
RunPath: TypeAlias = Annotated[
    Path | None,
    typer.Argument(
        metavar="[RUN]",
        help="A run directory, or a study for its newest run; default: the newest in runs/.",
        show_default=False,
        autocompletion=completion.runs,
    ),
]
RunPaths: TypeAlias = Annotated[
    list[Path],
    typer.Argument(
        metavar="RUN RUN…|STUDY",
        help="Run directories, or studies for their newest runs.",
        autocompletion=completion.runs,
    ),
]
NumberOfSets: TypeAlias = Annotated[
    int | None,
    typer.Option(
        "--sets",
        min=2,
        max=MOST_SETS,
        help="First sets of the design for a cheap first look, or more sets after those it has.",
    ),
]
GoOn: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--go-on", help="Continue a run whose study has changed; reuse results that are still valid."
    ),
]
ForkTo: TypeAlias = Annotated[
    Path | None,
    typer.Option("--fork", metavar="FOLDER", help="Leave the run as it is, and go on in a copy of it."),
]
Trust: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--trust",
        metavar="KIND:NAME",
        help="Accept results of earlier code of material:NAME or solver:NAME as results of the present code.",
        show_default=False,
    ),
]
TrustPlugins: TypeAlias = Annotated[
    bool, typer.Option("--trust-plugins", help="Execute the plugin files that the run names, without asking.")
]
AsJson: TypeAlias = Annotated[bool, typer.Option("--json", help="Print JSON for a script.")]
Tables: TypeAlias = Annotated[
    bool, typer.Option("--tables", help="Print the tables of the report before its last lines.")
]
