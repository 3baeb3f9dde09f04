"""Text of a whole run: a few lines, and the tables where they are wanted."""

from typing import TYPE_CHECKING, Any

from palpate.cli.session import Session
from palpate.errors import NothingSelectableError

if TYPE_CHECKING:
    from palpate.cli.progress import StageProgress
    from palpate.plugins.sections import Summary
    from palpate.stages.pipeline import RunResult
    from palpate.study.reading import Study


def show_summary(
    session: Session,
    summary: "Summary",
    progress: "StageProgress",
    *,
    tables: bool,
    values: dict[str, Any] | None = None,
) -> None:
    """Print the lines of a summary with the time that it took, and its tables before them.

    Parameters
    ----------
    values : dict, optional
        What is printed instead, as JSON.

    Raises
    ------
    NothingSelectableError
        After the printing, where something could not be found.
    """
    if values is not None:
        session.json(values)
    else:
        for title, frame in summary.tables.items() if tables else ():
            session.frame(title, frame)
        for line in summary.lines:
            session.say(line)
        for word, text in (dict(summary.labelled) or {"Time": ""}).items():
            session.labelled(word, f"{progress.spent}. {text}".strip() if word == "Time" else text)
    if summary.missing:
        raise NothingSelectableError(summary.missing)


def run_values(study: "Study", result: "RunResult") -> dict[str, Any]:
    """Result of a run as ``--json`` prints it, with parameters in the units of the study."""
    from palpate.run.ledger import Ledger
    from palpate.study.display_units import with_units

    with Ledger(result.folder) as ledger:
        n_simulations = len(ledger.seconds())
    found, fit = result.selected, result.fit.estimates
    values = {"selection": found.selection, "generalisation": found.generalisation, "fit": fit}
    return {
        "study": study.name,
        "data": study.data,
        "folder": str(result.folder),
        "is_first_answer": result.is_first_answer,
        "n_sets": result.design.n_sets,
        "n_simulations": n_simulations,
        **{name: with_units(study, frame).to_dicts() for name, frame in values.items()},
        "verification": found.verification.to_dicts(),
        **result.summary.values,
    }


def data_notice(study: "Study") -> str:
    """Whether the experiment is real, as a phrase."""
    if study.data == "simulated":
        return "the 'measured' curves of this study are SIMULATED, not a real experiment"
    return "measured data"
