"""How a whole run is shown: tables, distance to a known truth, where the figures lie."""

from typing import TYPE_CHECKING

from palpate.cli.session import Session

if TYPE_CHECKING:
    import polars as pl

    from palpate.cli.output import RunOutput
    from palpate.pipeline import RunResult
    from palpate.study import Study


def show_run(session: Session, study: "Study", result: "RunResult") -> None:
    """Print what a run found, for people."""
    from palpate.report import finding

    session.say(f"{study.name}: {data_notice(study)}")
    for name, frame in result.report.tables.items():
        if frame.height:
            session.frame(name.replace("_", " "), _side_by_side(name, frame))
    if sentence := finding(result.report.tables):
        session.say(sentence)
    for page in result.report.files:
        if page.suffix == ".html":
            session.say(f"Tables and figures: {page}")


def _side_by_side(name: str, frame: "pl.DataFrame") -> "pl.DataFrame":
    """One row per spot and scenario, with a column per parameter, as the paper prints them."""
    import polars as pl

    if name == "table1_coefficients":
        heads = pl.format("{}.{} [{}]", "region", "parameter", "unit")
        index = ["spot", "scenario"]
        return frame.with_columns(head=heads).pivot("head", index=index, values="value")
    if name == "distance_to_truth":
        heads = pl.format("{} [%]", "parameter")
        index = ["search", "spot", "scenario"]
        return frame.with_columns(head=heads).pivot("head", index=index, values="difference_percent")
    if name == "determination":
        return frame.pivot("parameter", index=["spot", "scenario"], values="determined")
    return frame


def run_as_json(study: "Study", result: "RunResult") -> "RunOutput":
    """Collect what a run found, for a script."""
    return {
        "study": study.name,
        "data": study.data,
        "folder": str(result.folder),
        "n_sets": result.design.n_sets,
        "n_simulations": len(result.simulations),
        "selection": result.selected.selection.to_dicts(),
        "generalisation": result.selected.generalisation.to_dicts(),
        "refinement": result.selected.refinement.to_dicts(),
        "rays": result.selected.rays.to_dicts(),
        "proofs": result.selected.proofs.to_dicts(),
        "tables": {name: frame.to_dicts() for name, frame in result.report.tables.items()},
        "files": [str(file) for file in result.report.files],
    }


def data_notice(study: "Study") -> str:
    """Sentence that says whether the experiment is real."""
    if study.data == "simulated":
        return "the 'measured' curves of this study are SIMULATED, not a real experiment"
    return "measured data"
