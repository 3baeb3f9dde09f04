"""Results in the units in which a study gives its ranges; the stages have the units of the materials."""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, TypeVar

import polars as pl

from palpate.api import Design, ParameterName
from palpate.api.fit import FitResult
from palpate.api.runs import Study, in_units, unit_factors
from palpate_report.data.report_data import ReportData

Frames = TypeVar("Frames", ReportData, FitResult)

VALUES = (
    *("value", "lower", "upper", "optimum", "first_optimum", "second_optimum"),
    *("sd", "mean", "mean_solved", "value_solved", "coarse", "corrected", "mesh_bias"),
)
"""Columns in the unit of the parameter that their row names."""


def in_display_units(data: ReportData) -> ReportData:
    """Convert every value of a parameter; the study's space alone stays as it is."""
    study, design, factors = data.study, data.design, unit_factors(data.study)
    if not factors:
        return data
    return replace(
        _converted(data, study),
        factors=factors,
        study=replace(study, truth={name: factors.get(name, 1.0) * at for name, at in study.truth.items()}),
        design=Design(
            parameters=in_units(study, design.parameters),
            values=design.values * [factors.get(p.name, 1.0) for p in design.parameters],
            seed=design.seed,
            n_drawn=design.n_drawn,
            n_kept=design.n_kept,
        ),
        fit=_converted(data.fit, study),
        tables={name: rows_in_display_units(study, frame) for name, frame in data.tables.items()},
    )


def _converted(tables: Frames, study: Study) -> Frames:
    """Tables with every frame in the units of the study."""
    found = {each.name: getattr(tables, each.name) for each in fields(tables)}
    frames: dict[str, Any] = {
        name: rows_in_display_units(study, frame)
        for name, frame in found.items()
        if isinstance(frame, pl.DataFrame)
    }
    return replace(tables, **frames)


def rows_in_display_units(study: Study, frame: pl.DataFrame) -> pl.DataFrame:
    """Convert columns of parameters, and ``VALUES`` in rows that name their parameter."""
    if not study.units:
        return frame
    factors = unit_factors(study)
    heads = {column: ParameterName.parse(column).shared for column in frame.columns}
    changed = {c: pl.col(c) * factors[head] for c, head in heads.items() if head in factors}
    if "parameter" in heads:
        changed |= {c: pl.col(c) * _factor("parameter", factors) for c in VALUES if c in heads}
    if "other_value" in heads:
        changed["other_value"] = pl.col("other_value") * _factor("other", factors)
    if {"parameter", "unit"} <= heads.keys():
        changed["unit"] = shared_names("parameter").replace_strict(
            study.units, default=pl.col("unit"), return_dtype=pl.String
        )
    return frame.with_columns(**changed)


def shared_names(column: str) -> pl.Expr:
    """Full names in a column without their spots."""
    return pl.col(column).str.split("@").list.first()


def _factor(column: str, factors: Mapping[str, float]) -> pl.Expr:
    return shared_names(column).replace_strict(factors, default=1.0, return_dtype=pl.Float64)
