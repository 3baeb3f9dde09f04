"""Fits that end elsewhere than those that were made."""

from dataclasses import replace

import polars as pl

from palpate.run.tables import OF_A_FIT


def with_tables(data, **frames):
    """The data with other rows in these tables of stages."""
    of_fit = {name: frame for name, frame in frames.items() if name in OF_A_FIT}
    return replace(data, fit=replace(data.fit, **of_fit), tables={**data.tables, **frames})


def at_end_of_range(data, *names):
    """The data with the values of these parameters at the upper end of their range, in every fit."""
    known = data.fit.intervals
    value = pl.col("value")
    for parameter in data.design.parameters:
        if parameter.name in names:
            value = pl.when(pl.col("parameter") == parameter.name).then(parameter.upper).otherwise(value)
    return with_tables(data, intervals=known.with_columns(value=value))


def refused(data):
    """The data whose model does not describe the force, in every fit."""
    is_force = (pl.col("check") == "discrepancy") & (pl.col("channel") == "force")
    checks = data.fit.adequacy.with_columns(
        verdict=pl.when(is_force).then(pl.lit("does not describe")).otherwise(pl.lit("describes")),
        message=pl.when(is_force).then(pl.lit("the force differs from the model")).otherwise(pl.lit("")),
    )
    words = data.fit.intervals.with_columns(identifiability=pl.lit("unclear"))
    return with_tables(data, adequacy=checks, intervals=words)
