"""Arguments and options that several commands share."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from palpate.study.source_positions import MOST_SETS

StudyPath: TypeAlias = Annotated[
    Path, typer.Argument(metavar="STUDY", help="A study.toml, or the folder that holds one.")
]
StudyOrRun: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="STUDY|RUN", help="A study.toml, the folder that holds one, or a run directory to continue."
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
        help="Accept results of earlier code of material:NAME or solver:NAME as those of its code now.",
        show_default=False,
    ),
]
TrustPlugins: TypeAlias = Annotated[
    bool,
    typer.Option("--trust-plugins", help="Execute the plugin files that the run names, without asking."),
]
AsJson: TypeAlias = Annotated[bool, typer.Option("--json", help="Print JSON for a script.")]
Tables: TypeAlias = Annotated[
    bool, typer.Option("--tables", help="Print the tables of the report before the five lines.")
]
