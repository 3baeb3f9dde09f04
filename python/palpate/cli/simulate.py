"""``palpate simulate``: every set at every spot."""

from collections import Counter

import typer

from palpate.cli.options import AsJson, OutFolder, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session, run_folder


def simulate(
    context: typer.Context, study: StudyPath, out: OutFolder = None, as_json: AsJson = False
) -> None:
    """Simulate every set at every spot, keeping each result as it comes."""
    from palpate import pipeline

    session = Session.of(context)
    checked = session.study(study)
    folder = run_folder(checked, out)
    with StageProgress(session, folder) as progress:
        simulations = pipeline.simulate(checked, folder, session.plugins, progress)
    counts = Counter(str(simulation.status) for simulation in simulations)
    if as_json:
        session.json(counts)
        return
    session.table("Simulations", ["status", "number"], [[s, str(n)] for s, n in counts.most_common()])
    session.next(f"score {study} --out {folder}", f"written to {folder}; ")
