"""One set for all spots: the least mean of Fopt over the spots.

Fopt_G = (1/n_spots) Σ Fopt_ij over the spots i, for each set j. The standard
deviation beside the mean is the sample's (n − 1 in the denominator), the default
of the paper's own tool; its 0.1724 ± 0.0392 cannot settle which it printed,
because the four terms are not given.
"""

import polars as pl

from palpate.domain import Design, Scenario
from palpate.selection import objectives, with_parameters


def generalise(scores: pl.DataFrame, scenario: Scenario, design: Design) -> pl.DataFrame:
    """Find the set with the least mean Fopt over all spots.

    Parameters
    ----------
    scores : DataFrame
        As :func:`palpate.scoring.score` returns it.
    scenario : Scenario
        Whose Fopt is averaged.
    design : Design

    Returns
    -------
    DataFrame
        One row per spot: spot, scenario, set_id, fopt, nmse_<channel>, r2_<channel>,
        fopt_mean, fopt_sd (null with one spot) and <region.parameter>. Empty when no set
        can be ranked at every spot. Ties go to the lower set_id.
    """
    n_spots = scores["spot"].n_unique()
    rows = objectives(scores, [scenario])
    means = (
        rows.group_by("set_id", maintain_order=True)
        .agg(
            pl.len().alias("n_spots"),
            pl.col("fopt").mean().alias("fopt_mean"),
            pl.col("fopt").std(ddof=1).alias("fopt_sd"),
        )
        .filter(pl.col("n_spots") == n_spots)
        .sort("fopt_mean", "set_id")
        .head(1)
        .drop("n_spots")
    )
    return with_parameters(rows.join(means, on="set_id", how="inner", maintain_order="left"), design)
