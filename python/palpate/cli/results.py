"""How a whole run is shown: five lines, and the tables where they are wanted."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from palpate.cli.session import Session
from palpate.errors import NothingSelectableError

if TYPE_CHECKING:
    import polars as pl

    from palpate.cli.progress import StageProgress
    from palpate.run.result import SelectionResult
    from palpate.study.reading import Study
    from palpate_report.report_warnings import ReportWarning
    from palpate_report.result import Report, RunResult

NOTHING = "no set fits all spots"
"""Verdict where nothing leads."""

OF_INTERVALS = ("parameter", "unit", "value", "lower", "upper", "identifiability", "verdict", "level")
"""What JSON has of each value that leads."""


def show_run(
    session: Session,
    study: "Study",
    result: "RunResult",
    progress: "StageProgress",
    *,
    tables: bool,
    as_json: bool,
) -> None:
    """Print what a run found.

    Raises
    ------
    NothingSelectableError
        After the printing, where a scenario has no set at a spot.
    """
    if as_json:
        session.json(_as_json(study, result))
        check_results(result.report.verdict.without_result)
        return
    show_report(session, study, result.report, progress, tables=tables)


def show_report(
    session: Session, study: "Study", report: "Report", progress: "StageProgress", *, tables: bool
) -> None:
    """Print five lines: verdict, parameters, warnings, time and where the page is; tables before them.

    Raises
    ------
    NothingSelectableError
        After the printing, where a scenario has no set at a spot.
    """
    for name, frame in report.tables.items() if tables else ():
        if frame.height:
            session.frame(name.replace("_", " "), _side_by_side(name, frame))
    verdict = report.verdict
    data = "SIMULATED curves, not a real experiment" if study.data == "simulated" else data_notice(study)
    session.labelled("Verdict", f"{study.name} ({data}): {verdict.headline or NOTHING}")
    found = "; ".join(map(str, (*verdict.estimates, *verdict.moduli)))
    missing = (
        f". NOT included in intervals: {', '.join(verdict.not_included)}" if verdict.not_included else ""
    )
    session.labelled("Parameters", f"{found}{missing}" if found else "none, for the reason above")
    session.labelled("Warnings", _warnings(verdict.warnings))
    session.labelled("Time", f"{progress.spent}. {verdict.spent}".strip())
    pages = [page for page in report.files if page.suffix == ".html"]
    session.labelled("Page", " ".join(page.resolve().as_uri() for page in pages))
    check_results(verdict.without_result)


def _warnings(warnings: Sequence["ReportWarning"]) -> str:
    if not warnings:
        return "none"
    worst = ", the worst first" if len(warnings) > 1 else ""
    return f"{len(warnings)}{worst}: {'; '.join(warning.what for warning in warnings)}"


def check_results(missing: Mapping[tuple[str, str], str]) -> None:
    """Raise NothingSelectableError where a scenario of the study has no set at a spot."""
    from palpate.scoring.completeness import described

    if missing:
        raise NothingSelectableError(f"no set could be selected at {described(missing)}")


def _side_by_side(name: str, frame: "pl.DataFrame") -> "pl.DataFrame":
    """One row per spot and scenario, with a column per parameter, as the paper prints them."""
    import polars as pl

    from palpate.run.result import ALL_SPOTS
    from palpate_report.marks import mark_of
    from palpate_report.table_files import shown

    if name.startswith("table1_"):
        heads = pl.format("{}.{} [{}]", "region", "parameter", "unit")
        texts = [f"{shown(row['value'])}{mark_of(row['verdict'])}" for row in frame.iter_rows(named=True)]
        index = ["spot", "scenario"]
        return frame.with_columns(head=heads, text=pl.Series(texts)).pivot("head", index=index, values="text")
    if name == "distance_to_truth":
        heads = pl.format("{} [%]", "parameter")
        index = ["search", "spot", "scenario"]
        return frame.with_columns(head=heads).pivot("head", index=index, values="difference_percent")
    if name == "fit":
        return frame.select(pl.col("^(fit|scenario|spot|fopt|n_runs|n_fine|at_bound|message|verdict)$"))
    if name == "identifiability":
        return frame.pivot("parameter", index=["spot", "scenario"], values="verdict")
    if name == "intervals":
        return _intervals(frame)
    if name in ("budget", "directions") and ALL_SPOTS in frame["fit"]:
        frame = frame.filter(fit=ALL_SPOTS)
    if name == "budget":
        percent = frame.with_columns((pl.col("share") * 100.0).round(0), cause=pl.col("cause") + " [%]")
        return percent.pivot("cause", index=["fit", "scenario", "parameter"], values="share")
    return frame


def _intervals(frame: "pl.DataFrame") -> "pl.DataFrame":
    """One row per fit and scenario: value, interval and word of each parameter."""
    import polars as pl

    rows = [
        {
            "fit": row["fit"],
            "scenario": row["scenario"],
            "parameter": f"{row['parameter']} [{row['unit']}]",
            "text": f"{row['value']:.3g} ({row['lower']:.3g} to {row['upper']:.3g}) {row['verdict']}",
        }
        for row in frame.iter_rows(named=True)
    ]
    return pl.from_dicts(rows).pivot("parameter", index=["fit", "scenario"], values="text")


def _as_json(study: "Study", result: "RunResult") -> dict[str, Any]:
    """Collect what a run found, for a script."""
    return {
        "study": study.name,
        "data": study.data,
        "folder": str(result.folder),
        "n_sets": result.design.n_sets,
        "n_simulations": len(result.simulations),
        **{name: frame.to_dicts() for name, frame in tables_of(result.selected).items()},
        **verdict_json(result.report),
        "fit": result.fit.table.to_dicts(),
        "tables": {name: frame.to_dicts() for name, frame in result.report.tables.items()},
    }


def verdict_json(report: "Report") -> dict[str, Any]:
    """What a report amounts to, its warnings and files, for a script."""
    verdict = report.verdict
    return {
        "verdict": verdict.sentences,
        "intervals": [{name: getattr(each, name) for name in OF_INTERVALS} for each in verdict.estimates],
        "warnings": list(map(str, verdict.warnings)),
        "files": report.files,
    }


def tables_of(selected: "SelectionResult") -> dict[str, "pl.DataFrame"]:
    """Tables of what identification chose, by name."""
    names = ("selection", "generalisation", "verification")
    return {name: getattr(selected, name) for name in names}


def data_notice(study: "Study") -> str:
    """Whether the experiment is real, as a phrase."""
    if study.data == "simulated":
        return "the 'measured' curves of this study are SIMULATED, not a real experiment"
    return "measured data"
