"""The way of each search: its evaluations that were better than all before them."""

import polars as pl

from palpate.api import Scenario
from palpate.api.fit import ALL_SPOTS
from palpate.api.runs import objectives
from palpate_report.report_data import ReportData


def paths(data: ReportData, fit: str, scenario: str, spot: str) -> list[pl.DataFrame]:
    """Way of each search of a fit, that with the best end last.

    Returns
    -------
    list of DataFrame
        Columns correction, objective, n_runs, fopt, and the design's parameters as they are at a spot.
    """
    trace = data.fit.trace
    if trace.is_empty():
        return []
    names = {
        p.name: p.name if p.name in trace.columns else f"{p.name}@{spot}" for p in data.design.parameters
    }
    rows = trace.filter(fit=fit, scenario=scenario).drop_nulls("fopt")
    ways = (
        of_search.filter(pl.col("objective") == pl.col("objective").cum_min())
        .unique("objective", keep="first", maintain_order=True)
        .select(
            "correction", "objective", "n_runs", "fopt", **{name: pl.col(at) for name, at in names.items()}
        )
        for _, of_search in rows.group_by("search", maintain_order=True)
    )
    # Ends under different corrections cannot be compared: the last is the best known.
    return sorted(ways, key=lambda way: (way["correction"][-1], -way["objective"][-1]))


def least_of_sweep(data: ReportData, fit: str, scenario: Scenario) -> float | None:
    """Least Fopt of the sweep at a spot, or of one set for all of them; None where no set was ranked."""
    spots = [spot for spot in data.spots if fit in (spot, ALL_SPOTS)]
    ranked = objectives(data.scores, [scenario]).filter(pl.col("spot").is_in(spots))
    means = ranked.group_by("set_id").agg(pl.len(), pl.col("fopt").mean())
    least = means.filter(pl.col("len") == ranked["spot"].n_unique())["fopt"].min()
    return None if least is None else float(least)  # type: ignore[arg-type]
