"""Least Fopt by spot and scenario.

Fopt = Σ weight · NMSE over the channels, or phases of them, that a scenario weights: scenario I
sums force and torque, II takes torque alone, III force alone. One sweep serves all.
"""

from collections.abc import Mapping, Sequence

import polars as pl

from palpate.domain import Design, ParameterSpace, Scenario, Status
from palpate.errors import NothingSelectableError, ScoringError


def objectives(scores: pl.DataFrame, scenarios: Sequence[Scenario]) -> pl.DataFrame:
    """Fopt of every set at every spot in every scenario.

    Parameters
    ----------
    scores : DataFrame
        As :func:`palpate.scoring.scores.score` returns it.

    Returns
    -------
    DataFrame
        Columns spot, scenario, set_id, fopt, nmse_<channel>, r2_<channel>, in the order of
        spots in ``scores``, then scenarios, then sets. A set is left out of a scenario that
        weights a channel in which it has no NMSE. A spot that does not measure a channel has
        Fopt of those that it measures, and no row where the scenario weights none of them.

    Raises
    ------
    ScoringError
        A scenario weights a channel that was not scored.
    """
    if scores.is_empty():
        return _no_objectives(scenarios)
    wide = _wide(scores)
    frames = [_objective(wide, scenario) for scenario in scenarios]
    spots = scores["spot"].unique(maintain_order=True).to_list()
    names = [scenario.name for scenario in scenarios]
    return (
        pl.concat(frames)
        .with_columns(_place("spot", spots).alias("_spot"), _place("scenario", names).alias("_scenario"))
        .sort("_spot", "_scenario", "set_id")
        .drop("_spot", "_scenario")
    )


def _no_objectives(scenarios: Sequence[Scenario]) -> pl.DataFrame:
    channels = dict.fromkeys(channel for scenario in scenarios for channel in scenario.weights)
    numbers = [f"{measure}_{channel}" for measure in ("nmse", "r2") for channel in channels]
    texts = {"spot": pl.String, "scenario": pl.String, "set_id": pl.Int64}
    return pl.DataFrame(schema={**texts, **dict.fromkeys(["fopt", *numbers], pl.Float64)})


def _place(column: str, order: Sequence[str]) -> pl.Expr:
    return pl.col(column).replace_strict({name: i for i, name in enumerate(order)}, return_dtype=pl.Int64)


def _wide(scores: pl.DataFrame) -> pl.DataFrame:
    """One row per spot and set: columns per channel and measure, and the channels that there are."""
    channels = scores["channel"].unique(maintain_order=True).to_list()
    return scores.group_by("spot", "set_id", maintain_order=True).agg(
        *(
            pl.col(measure).filter(pl.col("channel") == channel).first().alias(f"{measure}_{channel}")
            for measure in ("nmse", "r2")
            for channel in channels
        ),
        pl.col("channel").alias(_MEASURED),
    )


_MEASURED = "_measured"


def _objective(wide: pl.DataFrame, scenario: Scenario) -> pl.DataFrame:
    for channel in scenario.weighed:
        if f"nmse_{channel}" not in wide.columns:
            raise ScoringError(
                f"scenario '{scenario.name}' weights channel '{channel}', which has no scores; "
                "score it or leave the scenario out"
            )
    has = {channel: pl.col(_MEASURED).list.contains(channel) for channel in scenario.weighed}
    parts = (
        pl.when(has[c]).then(pl.col(f"nmse_{c}") * weight).otherwise(0.0)
        for c, weight in scenario.weighed.items()
    )
    rest = [name for name in wide.columns if name not in ("spot", "set_id", _MEASURED)]
    return (
        wide.filter(pl.any_horizontal(*has.values()))
        .select(
            "spot",
            pl.lit(scenario.name).alias("scenario"),
            "set_id",
            pl.sum_horizontal(*parts, ignore_nulls=False).alias("fopt"),
            *rest,
        )
        .drop_nulls("fopt")
    )


def weighed_spots(scores: pl.DataFrame, scenario: Scenario, spots: Sequence[str]) -> list[str]:
    """Spots without those that measure no channel that a scenario weights."""
    has = scores.group_by("spot").agg(pl.col("channel").is_in(list(scenario.weighed)).any())
    without = set(has.filter(~pl.col("channel"))["spot"])
    return [spot for spot in spots if spot not in without]


def select(scores: pl.DataFrame, scenarios: Sequence[Scenario], design: Design) -> pl.DataFrame:
    """Choose the set with the least Fopt for each spot and scenario; ties go to the lower set_id.

    Returns
    -------
    DataFrame
        Columns spot, scenario, set_id, fopt, nmse_<channel>, r2_<channel> (of every channel,
        fitted or not) and <region.parameter>; one row per spot and scenario. A spot at which
        nothing can be ranked in a scenario has no row there. A column ``partial`` if
        partial curves were ranked.

    Raises
    ------
    NothingSelectableError
        No set can be ranked anywhere, though the design has some.
    """
    candidates = objectives(scores, scenarios)
    if candidates.is_empty() and design.n_sets:
        raise NothingSelectableError(_why_nothing(scores))
    return with_parameters(_with_partial(least_fopt(candidates), scores), design)


def least_fopt(candidates: pl.DataFrame) -> pl.DataFrame:
    """Row with the least ``fopt`` of each spot and scenario, in their order; ties go to the lower set_id."""
    least = candidates.sort("fopt", "set_id").group_by("spot", "scenario", maintain_order=True).first()
    keys = candidates.select("spot", "scenario").unique(maintain_order=True)
    return keys.join(least, on=["spot", "scenario"], maintain_order="left")


def _with_partial(chosen: pl.DataFrame, scores: pl.DataFrame) -> pl.DataFrame:
    """Mark the sets that are ranked by partial curves of a diverged simulation, if any."""
    ranked = scores.filter(pl.col("nmse").is_not_null())
    partial = ranked.filter(pl.col("status") != Status.OK.value).select("spot", "set_id").unique()
    if partial.is_empty():
        return chosen
    marked = partial.with_columns(partial=True)
    return chosen.join(marked, on=["spot", "set_id"], how="left", maintain_order="left").with_columns(
        pl.col("partial").fill_null(value=False)
    )


def with_parameters(frame: pl.DataFrame, design: Design) -> pl.DataFrame:
    """Add a column <region.parameter> for each parameter of the row's set_id."""
    columns: Mapping[str, object] = {
        "set_id": range(design.n_sets),
        **{p.name: design.values[:, i] for i, p in enumerate(design.parameters)},
    }
    values = pl.DataFrame(columns, schema_overrides={"set_id": pl.Int64})
    return frame.join(values, on="set_id", how="left", maintain_order="left")


def with_tied(frame: pl.DataFrame, space: ParameterSpace) -> pl.DataFrame:
    """Add a column <region.parameter> for each parameter that is tied to a parameter of the row."""
    rows = [space.complete(row) for row in frame.iter_rows(named=True)]
    return frame.with_columns(
        pl.Series(name, [row[name] for row in rows], dtype=pl.Float64) for name in space.ties
    )


def unranked(scores: pl.DataFrame) -> pl.DataFrame:
    """One row for each simulation that is not ranked, of its first channel without an NMSE."""
    return scores.filter(pl.col("nmse").is_null()).unique(
        ["spot", "set_id"], keep="first", maintain_order=True
    )


def failures(failed: pl.DataFrame) -> pl.DataFrame:
    """Reasons why simulations failed: status, message, n (simulations), an example, and what to try.

    Parameters
    ----------
    failed : DataFrame
        spot, set_id, status and message of each.

    Returns
    -------
    DataFrame
        Most frequent first.
    """
    remedies = {status.value: status.remedy for status in Status}
    remedies[Status.OK.value] = "check that the simulated path reaches as far as the measured one"
    return (
        failed.group_by("status", "message", maintain_order=True)
        .agg(
            pl.len().cast(pl.Int64).alias("n"),
            pl.format("{}/{}", pl.col("spot").first(), pl.col("set_id").first()).alias("example"),
        )
        .with_columns(pl.col("status").replace(remedies).alias("remedy"))
        .sort("n", descending=True, maintain_order=True)
    )


def by_reason(found: pl.DataFrame) -> pl.DataFrame:
    """Join failures whose messages differ in their numbers alone: status, reason, n, example, remedy.

    A number in a reason is the number of the messages, and … where the messages differ.
    """
    number, message = r"\d+(\.\d+)?([eE][+-]?\d+)?", pl.col("message")
    alike = message.str.replace_all(number, "…").alias("alike")
    masked = message.first().str.replace_all(number, "…")
    reason = pl.when(message.n_unique() == 1).then(message.first()).otherwise(masked)
    return (
        found.group_by("status", alike, maintain_order=True)
        .agg(reason.alias("reason"), pl.col("n").sum(), pl.col("example").first(), pl.col("remedy").first())
        .drop("alike")
        .sort("n", descending=True, maintain_order=True)
    )


def _why_nothing(scores: pl.DataFrame) -> str:
    n_simulations = scores.select("spot", "set_id").n_unique()
    reasons = failures(unranked(scores))
    if reasons.is_empty():
        return "no simulation was scored, so nothing can be selected; run the simulations first"
    status, message, n, example, remedy = reasons.row(0)
    return (
        f"none of {n_simulations} simulations can be ranked; most frequent reason ({n}, first {example}): "
        f"{status}: {message or 'no message'}; remedy: {remedy}"
    )
