"""The paper's tables, and those that it argues from in prose."""

from collections.abc import Collection, Mapping
from types import MappingProxyType

import polars as pl

from palpate.api.fit import ALL_SPOTS, Adequacy, mark_of
from palpate.api.runs import Completeness, by_reason, failures, unranked
from palpate_report.data.best import weighted_channels
from palpate_report.data.display_units import shared_names
from palpate_report.data.marks import in_words
from palpate_report.data.report_data import ReportData

TITLES: Mapping[str, str] = MappingProxyType(
    {
        "table1_fit": "Coefficients of the fit by spot and scenario",
        "table2_fit": "NMSE of the fit by spot and scenario",
        "fit_mesh": "Values of the least Fopt without and with correction by finer meshes",
        "table1_coefficients": "Coefficients of the sweep by spot and scenario",
        "table2_nmse": "NMSE of the sweep by spot and scenario",
        "unfitted_channels": "Misfit of the channels left out of the fit",
        "cross_channel": "Error in every channel, fitted or not",
        "identifiability": "How well each parameter is identified",
        "generalised": "One set for all spots",
        "cost_of_one_set": "Fopt of one set for all spots, divided by the lowest Fopt at each spot",
        "fit": "The fits: errors, simulations, and why they ended",
        "intervals": "95 % intervals of the fit",
        "budget": "Error sources of each interval: shares of the variance in percent",
        "between_spots": "Mean of each parameter and its standard deviation between the spots",
        "parameter_combinations": "Combinations of parameters, the best known first",
        "posterior": "Posterior of the joint fits, by an emulator",
        "profile_ends": "Ends of the profiles, by the emulator and by the solver",
        "volumes": "Volume of the posterior relative to the search ranges",
        "emulator": "Errors of the emulated curves, over the measured peak",
        "inadequate": "Where the model does not describe the data",
        "distance_to_truth": "Distance to the true values",
        "convergence": "How the simulations ended",
        "verification": "Verification of the selected sets by their solver",
        "failures": "Sets that could not be ranked, by reason",
        "parameters": "Parameters of each run, with 95 % intervals where there was a fit",
        "errors": "Errors of each run; for several spots the mean, and the lowest R²",
        "criteria": "Information criteria at the least Fopt, the best first",
        "laws": "Material laws, the least AICc first",
    }
)
"""Captions of the tables by name; the last four are of several runs."""

EXACT = 1e-6
"""NMSE below which a curve is fitted to the accuracy of solvers."""


def make_tables(data: ReportData) -> dict[str, pl.DataFrame]:
    """Every table that has a row, by name.

    ``table1_fit`` and ``table2_fit`` are the paper's for the fit, ``table1_coefficients`` and
    ``table2_nmse`` for the sweep; ``unfitted_channels`` shows what a fit to some channels costs in
    the others, ``cross_channel`` the errors behind it; the others come where there is something to
    say. ``TITLES`` names them all.
    What simulations cost is not among them: the same study gives the same tables.
    In an incomplete sweep each has a column ``simulated``, of how many sets its rows are.
    """
    tables = {
        "table1_fit": coefficients(data, data.fit.ends),
        "table2_fit": nmse_by_scenario(data, data.fit.ends),
        "fit_mesh": _with_units(data, data.fit.mesh),
        "table1_coefficients": coefficients(data, data.selection),
        "table2_nmse": nmse_by_scenario(data, data.selection),
        "unfitted_channels": unfitted_channels(data),
        "cross_channel": cross_channel(data),
        "identifiability": data.table("identifiability"),
        "generalised": generalised(data),
        "cost_of_one_set": cost_of_one_set(data),
        "fit": data.fit.estimates,
        "intervals": data.fit.intervals,
        "budget": data.table("budget"),
        "between_spots": between_spots(data),
        "parameter_combinations": data.table("parameter_combinations"),
        "posterior": data.table("posterior"),
        "profile_ends": data.table("profile_ends"),
        "volumes": data.table("volumes"),
        "emulator": data.table("emulator"),
        "inadequate": inadequate(data),
        "distance_to_truth": distance_to_truth(data),
        "verification": data.verification.drop("key", strict=False),
        "failures": by_reason(failures(unranked(data.scores))),
    }
    found = data.completeness
    # Units stand in the heads where the study has others than the materials.
    units = _units(data) if data.factors else {}
    written = {name: f"{name} [{unit}]" for name, unit in units.items() if unit not in ("", "1")}
    return {
        name: (table if found.is_complete else _with_simulated(table, found)).rename(written, strict=False)
        for name, table in tables.items()
        if not table.is_empty()
    }


def printed(name: str, table: pl.DataFrame) -> pl.DataFrame:
    """Rows as people read them: marks at the parameters; causes of an interval side by side, in percent."""
    if {"parameter", "verdict"} <= set(table.columns):
        marks = table["verdict"].map_elements(mark_of, return_dtype=pl.String)
        return table.with_columns(parameter=pl.col("parameter") + marks)
    if name != "budget":
        return table
    shares = table.with_columns(share=(100.0 * pl.col("share")).round(1))
    return shares.pivot("cause", index=["fit", "scenario", "parameter"], values="share")


def between_spots(data: ReportData) -> pl.DataFrame:
    """Means of parameters and their standard deviations between spots, with intervals."""
    return data.table("between_spots").rename({"lower": "sd_lower", "upper": "sd_upper"}, strict=False)


def _with_units(data: ReportData, mesh: pl.DataFrame) -> pl.DataFrame:
    units = {name: p.unit for name, p in data.searched.items()}
    names = shared_names("parameter")
    return mesh.with_columns(unit=names.replace_strict(units, default="1", return_dtype=pl.String))


def _with_simulated(table: pl.DataFrame, found: Completeness) -> pl.DataFrame:
    everywhere = f"{found.n_everywhere} of {found.n_sets} at every spot"
    if "spot" not in table.columns:
        return table.with_columns(simulated=pl.lit(everywhere))
    by_spot = {spot: found.at(spot) for spot in found.simulated}
    return table.with_columns(simulated=pl.col("spot").replace_strict(by_spot, default=everywhere))


def inadequate(data: ReportData) -> pl.DataFrame:
    """Checks of the fits that failed."""
    return data.fit.adequacy.filter(pl.col("verdict") != Adequacy.DESCRIBES.value)


def coefficients(data: ReportData, best: pl.DataFrame) -> pl.DataFrame:
    """Table 1: searched and tied coefficients by material, spot and scenario, in the region's convention.

    Parameters
    ----------
    best : DataFrame
        The selection, or the ends of the fit.
    """
    units = _units(data)
    rows = [
        {
            "region": region.region,
            "material": region.material.name,
            "convention": region.convention,
            "spot": row["spot"],
            "scenario": row["scenario"],
            "parameter": parameter.name,
            "value": row[region.name_of(parameter.name)],
            "unit": units[region.name_of(parameter.name)],
        }
        for region in data.study.space.regions
        for parameter in region.material.parameters
        if parameter.name not in region.fixed
        for row in best.iter_rows(named=True)
    ]
    return pl.DataFrame(rows)


def _units(data: ReportData) -> dict[str, str]:
    """Units of the values here, by full name, of what is searched, tied and fixed."""
    space = data.study.space
    own = {r.name_of(p.name): p.unit for r in space.regions for p in r.material.parameters}
    written = {name: data.study.units[name] for name in data.factors}
    return own | {p.name: p.unit for p in data.design.parameters} | written


def nmse_by_scenario(data: ReportData, best: pl.DataFrame) -> pl.DataFrame:
    """Table 2: Fopt by spot, with one column per scenario; of a joint fit the mean over the spots."""
    wide = best.pivot("scenario", index="spot", values="fopt")
    names = [s.name for s in data.study.scenarios if s.name in wide.columns]
    return wide.select("spot", *names)


def cross_channel(data: ReportData) -> pl.DataFrame:
    """Error in every channel of the set that each scenario selected, fitted to it or not."""
    fitted = {s.name: weighted_channels(s) for s in data.study.scenarios}
    fitted_to = pl.col("scenario").replace_strict(fitted, return_dtype=pl.String).alias("fitted_to")
    return data.selection.select("spot", "scenario", fitted_to, "set_id", pl.col("^(nmse|r2)_.*$"))


def unfitted_channels(data: ReportData) -> pl.DataFrame:
    """Misfits of each fit to part of the channels in those that it leaves out.

    One row per search, spot, scenario and channel that the scenario leaves out: its NMSE
    and R² there; ``nmse_fitted``, the least NMSE there of the scenarios that do fit the
    channel, null where none does; and ``times``, how many times further off it is than that.
    """
    rows = [
        {
            "search": search,
            "spot": row["spot"],
            "scenario": row["scenario"],
            "fitted_to": weighted_channels(data.scenario(row["scenario"])),
            "unfitted": channel,
            "nmse": row[f"nmse_{channel}"],
            "r2": row[f"r2_{channel}"],
            "nmse_fitted": _least(data, table, row["spot"], channel),
        }
        for search, table in (("sweep", data.selection), ("fit", data.fit.of_each_spot))
        for row in table.iter_rows(named=True)
        for channel in (name.removeprefix("nmse_") for name in table.columns if name.startswith("nmse_"))
        if not data.scenario(row["scenario"]).fits(channel) and row[f"nmse_{channel}"] is not None
    ]
    if not rows:
        return pl.DataFrame()
    # A fit and its reference that are both exact have no ratio.
    both_exact = (pl.col("nmse") <= pl.col("nmse_fitted")) & (pl.col("nmse_fitted") == 0.0)
    times = pl.when(~both_exact).then(pl.col("nmse") / pl.col("nmse_fitted"))
    return pl.DataFrame(rows, schema_overrides={"nmse_fitted": pl.Float64}).with_columns(times=times)


def _least(data: ReportData, table: pl.DataFrame, spot: str, channel: str) -> float | None:
    """Least NMSE of a channel at a spot in the scenarios that fit it; None where none does."""
    fitting = [s.name for s in data.study.scenarios if s.fits(channel)]
    rows = table.filter(pl.col("spot") == spot, pl.col("scenario").is_in(fitting))
    return min(rows[f"nmse_{channel}"].drop_nulls().to_list(), default=None)


def finding(tables: Mapping[str, pl.DataFrame], scenarios: Collection[str] | None = None) -> str:
    """Sentence on the partial fit that is worst in a channel left out of it; empty where none is worse.

    Parameters
    ----------
    scenarios : collection of str, optional
        Whose fits count; all when left out.
    """
    table = tables.get("unfitted_channels", pl.DataFrame({"times": []})).drop_nulls("times")
    if scenarios is not None and "scenario" in table.columns:
        table = table.filter(pl.col("scenario").is_in(list(scenarios)))
    if table.is_empty():
        return ""
    last = table.filter(pl.col("search") == table["search"][-1])
    worst = last.sort("times", descending=True, maintain_order=True).row(0, named=True)
    if worst["times"] <= 1.0 or worst["nmse"] < EXACT:
        return ""
    channel = in_words(worst["unfitted"])
    against = f"{worst['nmse_fitted']:.3g} by a fit to {channel}"
    if worst["nmse_fitted"] < EXACT:
        against = f"about 0 by a fit to {channel}"
    r2 = "" if worst["r2"] is None else f", R² {worst['r2']:.3f}"
    return (
        f"Misfit of the channels left out of the fit: a fit to {worst['fitted_to']} alone predicts {channel} "
        f"less well ({worst['spot']}, scenario {worst['scenario']}: NMSE {worst['nmse']:.3g} against "
        f"{against}{r2})."
    )


def generalised(data: ReportData) -> pl.DataFrame:
    """Lay out the one set for all spots: mean ± sd of Fopt, and coefficients."""
    names = [p.name for p in data.design.parameters]
    return data.generalisation.head(1).select("scenario", "set_id", "fopt_mean", "fopt_sd", *names)


def cost_of_one_set(data: ReportData) -> pl.DataFrame:
    """Fopt of the set for all spots, the least at each spot, and their ratio; empty for one spot."""
    if len(data.spots) < 2:
        return pl.DataFrame()
    best = data.selection.filter(pl.col("scenario") == data.generalising.name)
    best = best.select("spot", best_set="set_id", best_fopt="fopt")
    one = data.generalisation.select("spot", "set_id", "fopt")
    return one.join(best, on="spot", maintain_order="left").with_columns(
        times=pl.when(pl.col("best_fopt") > 0.0).then(pl.col("fopt") / pl.col("best_fopt"))
    )


def distance_to_truth(data: ReportData) -> pl.DataFrame:
    """Distances of the found coefficients from the known ones of a simulated experiment."""
    all_spots = data.generalisation.head(1).with_columns(spot=pl.lit("all spots"))
    found = {
        "sweep": data.selection,
        "generalised": all_spots,
        "joint fit": data.fit.ends.filter(spot=ALL_SPOTS),
        "fit": data.fit.of_each_spot,
    }
    units = _units(data)
    rows = [
        {
            "search": search,
            "spot": row["spot"],
            "scenario": row["scenario"],
            "parameter": name,
            "value": row[name],
            "truth": truth,
            "unit": units[name],
            "difference_percent": 100.0 * (row[name] - truth) / abs(truth) if truth else None,
        }
        for search, table in found.items()
        for row in table.iter_rows(named=True)
        for name, truth in data.study.truth.items()
        if row.get(name) is not None
    ]
    return pl.DataFrame(rows)
