"""``palpate resume``: go on with a run where it stopped."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli.options import AsJson, ForkTo, GoOn, NumberOfSets, RunPath, Tables, Trust, TrustPlugins
from palpate.cli.run import go
from palpate.cli.runs import find_run, plugins_of, session_of_run, study_file_of
from palpate.cli.session import Session

if TYPE_CHECKING:
    from palpate.study.reading import Study


def resume(
    context: typer.Context,
    run: RunPath = None,
    study: Annotated[
        Path | None,
        typer.Option("--study", help="Study file, if it has moved.", show_default=False),
    ] = None,
    trust_plugins: TrustPlugins = False,
    n_sets: NumberOfSets = None,
    go_on: GoOn = False,
    fork: ForkTo = None,
    trust: Trust = None,
    tables: Tables = False,
    as_json: AsJson = False,
) -> None:
    """Continue a run; finished simulations are kept, and the tables equal those of an uninterrupted run."""
    from palpate.run.directory import RunDirectory
    from palpate.study.reading import study_plugins

    folder = find_run(run)
    manifest = RunDirectory(folder).manifest()
    file = study or study_file_of(folder, manifest, f"name it: palpate resume {folder} --study FILE")
    named = [*plugins_of(folder, manifest), *([] if study else study_plugins(file))]
    session = session_of_run(Session.of(context), folder, named, trust=trust_plugins)
    checked = _extended(session.study(file), manifest, n_sets)
    go(
        session,
        checked,
        folder,
        go_on=go_on,
        fork=fork,
        trust=trust or (),
        tables=tables,
        as_json=as_json,
        adopt=study is not None,
    )


def _extended(study: "Study", manifest: dict[str, Any], n_sets: int | None) -> "Study":
    """The study with as many sets as the run has, or more."""
    n_before = manifest["n_total"]
    if not n_before and n_sets is not None and n_sets <= study.n_sets:
        return study
    return replace(study, n_total=max(n_sets or 0, n_before))
