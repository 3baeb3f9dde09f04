"""``palpate resume``: go on with a run where it stopped."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli.options import AsJson, ForkTo, GoOn, NumberOfSets, Trust
from palpate.cli.run import go
from palpate.cli.session import Session
from palpate.errors import StudyError

if TYPE_CHECKING:
    from palpate.study import Study


def resume(
    context: typer.Context,
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run directory.", show_default=False)],
    study: Annotated[
        Path | None,
        typer.Option(
            "--study", help="The study file, where it does not lie where it did.", show_default=False
        ),
    ] = None,
    n_sets: NumberOfSets = None,
    go_on: GoOn = False,
    fork: ForkTo = None,
    trust: Trust = None,
    as_json: AsJson = False,
) -> None:
    """Go on with a run; what is finished is kept, and the tables are those of a run never stopped."""
    from palpate.run_directory import RunDirectory

    manifest = RunDirectory(run).manifest()
    given = Session.of(context)
    session = Session((*given.files, *_plugin_files(run, manifest)), given.without)
    checked = session.study(study or _study_file(run, manifest))
    extended = _extended(checked, manifest, n_sets)
    go(session, extended, run, go_on=go_on, fork=fork, trust=trust or (), as_json=as_json)


def _extended(study: "Study", manifest: dict[str, Any], n_sets: int | None) -> "Study":
    """The study with as many sets as the run has, or more."""
    n_before: int = manifest.get("n_total", 0)
    if not n_before and n_sets is not None and n_sets <= study.n_sets:
        return study
    return replace(study, n_total=max(n_sets or 0, n_before))


def _study_file(run: Path, manifest: dict[str, Any]) -> Path:
    file = run / str(manifest.get("study_file", "missing"))
    if not file.is_file():
        raise StudyError(
            f"{file}: the study file of this run is not there any more; name it: "
            f"palpate resume {run} --study FILE"
        )
    return file.resolve()


def _plugin_files(run: Path, manifest: dict[str, Any]) -> list[Path]:
    files = [run / file for file in manifest.get("plugin_files", [])]
    for file in files:
        if not file.is_file():
            raise StudyError(
                f"{file}: a plugin file of this run is not there any more; put it back, "
                "or use `palpate run` with --plugin FILE and --out"
            )
    return [file.resolve() for file in files]
