"""Fits that end elsewhere than those that were made."""

from dataclasses import replace

import polars as pl


def at_end_of_range(data, *names):
    """The data with the values of these parameters at the upper end of their range, in every fit."""
    known = data.fit.certainty.intervals
    value = pl.col("value")
    for parameter in data.design.parameters:
        if parameter.name in names:
            value = pl.when(pl.col("parameter") == parameter.name).then(parameter.upper).otherwise(value)
    certainty = replace(data.fit.certainty, intervals=known.with_columns(value=value))
    return replace(data, fit=replace(data.fit, certainty=certainty))


def refused(data):
    """The data whose model does not describe the force, in every fit."""
    certainty = data.fit.certainty
    is_force = (pl.col("check") == "discrepancy") & (pl.col("channel") == "force")
    checks = certainty.adequacy.with_columns(
        verdict=pl.when(is_force).then(pl.lit("does not describe")).otherwise(pl.lit("describes")),
        message=pl.when(is_force).then(pl.lit("the force differs from the model")).otherwise(pl.lit("")),
    )
    words = certainty.intervals.with_columns(identifiability=pl.lit("unclear"))
    found = replace(certainty, adequacy=checks, intervals=words)
    return replace(data, fit=replace(data.fit, certainty=found))
