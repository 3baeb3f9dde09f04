"""One set for all spots: the smallest mean of Fopt over every spot of the study.

Fopt_G = (1/n_spots) Σ Fopt_ij over the spots i, for each set j. The standard
deviation next to the mean is the sample's (n − 1 in the denominator), the default
of the paper's software. Its 0.1724 ± 0.0392 does not show which one it printed,
because the four terms are not published.
"""

from collections.abc import Sequence

import polars as pl

from palpate.domain import Design, Scenario
from palpate.scoring.selection import objectives, weighed_spots, with_parameters


def generalise(
    scores: pl.DataFrame, scenario: Scenario, design: Design, spots: Sequence[str]
) -> pl.DataFrame:
    """Find the set with the least mean Fopt over all spots.

    Parameters
    ----------
    scores : DataFrame
        As :func:`palpate.scoring.scores.score` returns it.
    scenario : Scenario
        Whose Fopt is averaged.
    spots : sequence of str
        Every spot of the study; a set without a score at one of them is not considered. A spot
        that measures no channel of the scenario does not count.

    Returns
    -------
    DataFrame
        One row per spot: spot, scenario, set_id, fopt, nmse_<channel>, r2_<channel>,
        fopt_mean, fopt_sd (null with one spot) and <region.parameter>. Empty when no set
        can be ranked at every spot. Ties go to the lower set_id.
    """
    rows = objectives(scores, [scenario]).filter(pl.col("spot").is_in(list(spots)))
    means = (
        rows.group_by("set_id", maintain_order=True)
        .agg(
            pl.len().alias("n_spots"),
            pl.col("fopt").mean().alias("fopt_mean"),
            pl.col("fopt").std(ddof=1).alias("fopt_sd"),
        )
        .filter(pl.col("n_spots") == len(weighed_spots(scores, scenario, spots)))
        .sort("fopt_mean", "set_id")
        .head(1)
        .drop("n_spots")
    )
    return with_parameters(rows.join(means, on="set_id", how="inner", maintain_order="left"), design)
