"""Arguments and options that several commands share."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

StudyPath: TypeAlias = Annotated[
    Path, typer.Argument(metavar="STUDY", help="A study.toml, or the folder that holds one.")
]
OutFolder: TypeAlias = Annotated[
    Path | None, typer.Option("--out", metavar="FOLDER", help="Run directory; default: runs/<study>.")
]
AsJson: TypeAlias = Annotated[bool, typer.Option("--json", help="Print JSON for a script.")]
