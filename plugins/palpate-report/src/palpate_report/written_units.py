"""Results in the units in which a study gives its ranges; the stages have those of the materials."""

from collections.abc import Mapping
from dataclasses import replace

import polars as pl

from palpate.api import Design
from palpate.api.fit import FitResult
from palpate.api.runs import Study, in_units, unit_factors
from palpate_report.report_data import ReportData


def in_written_units(data: ReportData) -> ReportData:
    """Convert every value of a parameter; the study's space alone stays as it is."""
    units, parameters = data.study.units, data.design.parameters
    factors = unit_factors(data.study)
    if not factors:
        return data
    fit, every = data.fit, [factors.get(p.name, 1.0) for p in parameters]
    converted = in_units(data.study, parameters)
    truth = {name: value * factors.get(name, 1.0) for name, value in data.study.truth.items()}
    ends = ("value", "lower", "upper")
    optima = ("first_optimum", "second_optimum")
    return replace(
        data,
        factors=factors,
        study=replace(data.study, truth=truth),
        design=Design(
            parameters=converted,
            values=data.design.values * every,
            seed=data.design.seed,
            n_drawn=data.design.n_drawn,
            n_kept=data.design.n_kept,
        ),
        selection=_wide(data.selection, factors),
        generalisation=_wide(data.generalisation, factors),
        fit=FitResult(
            table=_wide(fit.table, factors),
            trace=_wide(fit.trace, factors),
            mesh=_long(fit.mesh, ("coarse", "fine", "extrapolated"), factors),
            responses=fit.responses,
            certainty=replace(
                fit.certainty,
                intervals=_long(
                    fit.certainty.intervals, (*ends, "noise_lower", "noise_upper"), factors, units
                ),
                budget=_long(fit.certainty.budget, ("sd",), factors),
                draws=_wide(fit.certainty.draws, factors),
                planes=_planes(fit.certainty.planes, factors),
            ),
        ),
        posterior=replace(
            data.posterior,
            posterior=_long(
                data.posterior.posterior, ("mean", "sd", "lower", "upper", "mean_solved"), factors, units
            ),
            posterior_draws=_wide(data.posterior.posterior_draws, factors),
            profiles=_long(data.posterior.profiles, ("value",), factors, units),
            profile_ends=_long(data.posterior.profile_ends, ("value", "value_solved"), factors, units),
            posterior_planes=_planes(data.posterior.posterior_planes, factors),
        ),
        identifiability=_long(data.identifiability, (*ends, "optimum"), factors, units),
        disagreements=_long(data.disagreements, optima, factors, units),
    )


def rows_in_written_units(study: Study, frame: pl.DataFrame, columns: tuple[str, ...]) -> pl.DataFrame:
    """Convert columns of rows that each name their parameter and its unit."""
    return _long(frame, columns, unit_factors(study), study.units) if study.units else frame


def _wide(frame: pl.DataFrame, factors: Mapping[str, float]) -> pl.DataFrame:
    """Convert columns of parameters, those by spot too."""
    heads = {column: column.partition("@")[0] for column in frame.columns}
    return frame.with_columns(pl.col(c) * factors[head] for c, head in heads.items() if head in factors)


def _planes(frame: pl.DataFrame, factors: Mapping[str, float]) -> pl.DataFrame:
    """Convert both values of rows that each name two parameters, or one."""
    if frame.is_empty():
        return frame
    pairs = (("parameter", "value"), ("other", "other_value"))
    return frame.with_columns(
        pl.col(value) * pl.col(name).replace_strict(factors, default=1.0, return_dtype=pl.Float64)
        for name, value in pairs
    )


def _long(
    frame: pl.DataFrame,
    columns: tuple[str, ...],
    factors: Mapping[str, float],
    units: Mapping[str, str] | None = None,
) -> pl.DataFrame:
    """Convert columns of rows that each name their parameter."""
    if frame.is_empty():
        return frame
    names = pl.col("parameter").str.split("@").list.first()
    factor = names.replace_strict(factors, default=1.0, return_dtype=pl.Float64)
    changed = {column: pl.col(column) * factor for column in columns}
    if units:
        changed["unit"] = names.replace_strict(units, default=pl.col("unit"), return_dtype=pl.String)
    return frame.with_columns(**changed)
