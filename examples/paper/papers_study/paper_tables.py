"""The paper's two tables, and the same tables of a reproduction."""

from collections.abc import Mapping
from importlib.resources import files

import polars as pl

from palpate.api import ParameterName
from palpate.api.runs import RunResult

GENERALISED = {"c1": 0.0129, "c2": -2.016e-3, "c3": 2.7623e-4}
"""The paper's one set for all spots: Yeoh in FEBio 4's convention, MPa."""

GENERALISED_FOPT = (0.1724, 0.0392)
"""Its mean Fopt and standard deviation over the spots, as printed."""

SETS_KEPT = {"ogden": 250, "yeoh": 140, "neo_hookean": 250}
"""Sets that the paper simulates, of 250 drawn."""


def table1() -> pl.DataFrame:
    """Coefficients as printed: material, point, scenario, parameter, value, unit."""
    return _printed("table1_coefficients.csv")


def table2() -> pl.DataFrame:
    """Fopt as printed, under the name nmse: material, point, scenario, nmse."""
    return _printed("table2_nmse.csv")


def _printed(name: str) -> pl.DataFrame:
    return pl.read_csv((files("papers_study") / "printed" / name).read_bytes())


def side_by_side(results: Mapping[str, RunResult]) -> dict[str, pl.DataFrame]:
    """The tables of the paper next to the tables of a reproduction.

    Parameters
    ----------
    results : mapping of material name to RunResult
        Their spots are p1, p2 … in the order of the paper's points. They are other spots of
        another limb: compare the pattern of the rows, not the numbers.

    Returns
    -------
    dict of DataFrame
        ``sets``: material, n_drawn, kept_paper, kept_here, n_simulations, n_ok;
        ``table1``: material, spot, scenario, parameter, unit, paper, here;
        ``table2``: material, spot, scenario, paper, here;
        ``generalised``: material, quantity, unit, paper, here.
    """
    return {
        "sets": pl.DataFrame([_sets(name, result) for name, result in results.items()]),
        "table1": pl.concat([_coefficients(name, result) for name, result in results.items()]),
        "table2": pl.concat([_errors(name, result) for name, result in results.items()]),
        "generalised": pl.concat([_generalised(name, result) for name, result in results.items()]),
    }


def _sets(material: str, result: RunResult) -> dict[str, object]:
    return {
        "material": material,
        "n_drawn": result.design.n_drawn,
        "kept_paper": SETS_KEPT[material],
        "kept_here": result.design.n_sets,
        "n_simulations": len(result.simulations),
        "n_ok": sum(s.status.value == "ok" for s in result.simulations),
    }


def _spots(printed: pl.DataFrame, material: str) -> pl.DataFrame:
    of_material = printed.filter(pl.col("material") == material)
    return of_material.with_columns(spot=pl.format("p{}", "point")).drop("point")


def _coefficients(material: str, result: RunResult) -> pl.DataFrame:
    names = {p.name: ParameterName.parse(p.name).name for p in result.design.parameters}
    here = (
        result.selected.selection.select("spot", "scenario", *names)
        .rename(names)
        .unpivot(index=["spot", "scenario"], variable_name="parameter", value_name="here")
    )
    printed = _spots(table1(), material)
    joined = printed.join(here, on=["spot", "scenario", "parameter"], how="left", maintain_order="left")
    return joined.select(
        "material", "spot", "scenario", "parameter", "unit", pl.col("value").alias("paper"), "here"
    )


def _errors(material: str, result: RunResult) -> pl.DataFrame:
    here = result.selected.selection.select("spot", "scenario", here=pl.col("fopt"))
    printed = _spots(table2(), material)
    joined = printed.join(here, on=["spot", "scenario"], how="left", maintain_order="left")
    return joined.select("material", "spot", "scenario", pl.col("nmse").alias("paper"), "here")


def _generalised(material: str, result: RunResult) -> pl.DataFrame:
    found = result.selected.generalisation
    row = found.row(0, named=True) if found.height else {}
    paper: dict[str, float] = {}
    if material == "yeoh":
        paper = {"mean Fopt": GENERALISED_FOPT[0], "sd of Fopt": GENERALISED_FOPT[1], **GENERALISED}
    here = {"mean Fopt": row.get("fopt_mean"), "sd of Fopt": row.get("fopt_sd")}
    units = {}
    for parameter in result.design.parameters:
        name = ParameterName.parse(parameter.name).name
        here[name], units[name] = row.get(parameter.name), parameter.unit or "1"
    rows = [(material, key, units.get(key, "1"), paper.get(key), value) for key, value in here.items()]
    schema = {
        "material": pl.String,
        "quantity": pl.String,
        "unit": pl.String,
        "paper": pl.Float64,
        "here": pl.Float64,
    }
    return pl.DataFrame(rows, schema=schema, orient="row")
