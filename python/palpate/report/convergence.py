"""How the simulations of a sweep ended, spot by spot."""

from collections.abc import Iterable, Mapping
from typing import Any

import polars as pl

from palpate.domain import Simulation, Status


def by_spot(simulations: Iterable[Simulation]) -> pl.DataFrame:
    """Count how simulations ended, and what they cost.

    Parameters
    ----------
    simulations : iterable of Simulation

    Returns
    -------
    DataFrame
        One row per spot: spot, simulations, a column per status that occurs, median_s and
        longest_s with the longest_set, and the median of every number that the solver told
        of those that are ok, such as median_n_iterations.
    """
    rows = [
        {"spot": s.job.spot, "set_id": s.job.set_id, "status": s.status.value, "seconds": s.seconds}
        | (_numbers(s.diagnostics) if s.status is Status.OK else {})
        for s in simulations
    ]
    if not rows:
        return pl.DataFrame()
    frame = pl.DataFrame(rows, infer_schema_length=None)
    told = [name for name in frame.columns if name not in ("spot", "set_id", "status", "seconds")]
    statuses = [s.value for s in Status if s.value in frame["status"].unique()]
    return frame.group_by("spot", maintain_order=True).agg(
        pl.len().cast(pl.Int64).alias("simulations"),
        *((pl.col("status") == name).sum().cast(pl.Int64).alias(name) for name in statuses),
        pl.col("seconds").median().alias("median_s"),
        pl.col("seconds").max().alias("longest_s"),
        pl.col("set_id").get(pl.col("seconds").arg_max()).alias("longest_set"),
        *(pl.col(name).median().alias(f"median_{name}") for name in told),
    )


def _numbers(diagnostics: Mapping[str, Any]) -> dict[str, float]:
    return {
        str(name): float(value)
        for name, value in diagnostics.items()
        if isinstance(value, (int, float)) and not isinstance(value, bool)
    }
