"""Arguments and options that several commands share."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from palpate.plain_values import MOST_SETS

StudyPath: TypeAlias = Annotated[
    Path, typer.Argument(metavar="STUDY", help="A study.toml, or the folder that holds one.")
]
OutFolder: TypeAlias = Annotated[
    Path | None, typer.Option("--out", metavar="FOLDER", help="Run directory; default: runs/<study>.")
]
NumberOfSets: TypeAlias = Annotated[
    int | None,
    typer.Option(
        "--n",
        min=2,
        max=MOST_SETS,
        help="Extend the design to this many sets; those it has stay as they are.",
    ),
]
GoOn: TypeAlias = Annotated[
    bool,
    typer.Option("--go-on", help="Go on in a run whose study has changed, with what is still valid of it."),
]
ForkTo: TypeAlias = Annotated[
    Path | None,
    typer.Option("--fork", metavar="FOLDER", help="Leave the run as it is, and go on in a copy of it."),
]
AsJson: TypeAlias = Annotated[bool, typer.Option("--json", help="Print JSON for a script.")]
