"""``palpate sample``: the parameter sets of a study."""

import typer

from palpate.cli.options import AsJson, OutFolder, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session, run_folder


def sample(context: typer.Context, study: StudyPath, out: OutFolder = None, as_json: AsJson = False) -> None:
    """Draw the parameter sets into design.parquet."""
    from palpate import pipeline

    session = Session.of(context)
    checked = session.study(study)
    folder = run_folder(checked, out)
    with StageProgress(session) as progress:
        design = pipeline.sample(checked, folder, session.plugins, progress)
    if as_json:
        names = [parameter.name for parameter in design.parameters]
        sets = [dict(zip(names, map(float, row), strict=True)) for row in design.values]
        session.json({"n_drawn": design.n_drawn, "n_sets": design.n_sets, "seed": design.seed, "sets": sets})
        return
    session.say(f"{design.n_drawn} sets drawn, {design.n_sets} kept by the filters (seed {design.seed})")
    if design.n_kept:
        session.say(f"the first {design.n_kept} are of an earlier design with wider ranges")
    session.next(f"simulate {study} --out {folder}", f"written to {folder}; ")
