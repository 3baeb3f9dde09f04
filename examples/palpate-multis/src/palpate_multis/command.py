"""``palpate predict-press``: the compliance of presses from their thicknesses, probe and load."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.api import PalpateError
from palpate.api.cli import AsJson, Session

if TYPE_CHECKING:
    from palpate_multis.population import Population
    from palpate_multis.presses import Presses

SHOWN = ("compliance_mm_per_MPa", "lower", "upper")
VALUES = (*SHOWN, "fat_share")
HEADS = ("row", "status", "compliance [mm/MPa]", "95 % from", "to", "fat's share")


def predict_press(
    context: typer.Context,
    table: Annotated[
        Path,
        typer.Argument(
            help="CSV with max_force_N, area_mm2 (360 or 675), skin_mm, fat_mm and muscle_mm; with site too, "
            "each site has a factor."
        ),
    ],
    fitted_to: Annotated[
        Path | None,
        typer.Option(
            help="CSV of other presses with person, fat_compression_mm, muscle_compression_mm and "
            "stiffness_MPa_per_mm too: the moduli are fitted to these and not to the 70 people of MULTIS."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Predict presses of an ultrasound probe, by layered finite elements fitted to living limbs.

    A press outside of the simulated thicknesses has the status "outside", with its reason, and no prediction.
    """
    from palpate_multis.population import fit, fit_own, with_sites
    from palpate_multis.presses import read_presses

    session = Session.of(context)
    presses = read_presses(table, measured=False)
    known = read_presses(fitted_to)
    population = fit_own(known, str(fitted_to)) if fitted_to else fit(known)
    if presses.site.any():
        if not known.site.all():
            raise PalpateError(
                f"{table} has sites, {fitted_to} none: give both the column 'site', or neither"
            )
        population = with_sites(population, known)
    rows = _rows(population, presses)
    if all(row["reason"] for row in rows):
        raise PalpateError(f"{table}: no press can be predicted; the first: {rows[0]['reason']}")
    moduli = {name: getattr(population, name) for name in ("muscle_MPa", "fat_MPa", "load_exponent")}
    if as_json:
        session.json({"fit": moduli | {"sites": dict(population.sites)}, "presses": rows})
        return
    cells = [
        [str(number), row["status"], *(f"{row[name]:.0f}" for name in SHOWN), f"{row['fat_share']:.0%}"]
        if row["status"] == "predicted"
        else [str(number), f"{row['status']}: {row['reason']}", "", "", "", ""]
        for number, row in enumerate(rows, start=1)
    ]
    session.table("Fit", list(moduli), [[f"{value:.3g}" for value in moduli.values()]])
    if population.sites:
        factors = [f"{factor:.2f}" for factor in population.sites.values()]
        session.table("Factors of compliance", list(population.sites), [factors])
    session.table("Presses", list(HEADS), cells)


def _rows(population: Population, presses: Presses) -> list[dict[str, Any]]:
    """Rows of the output, one for each press; those outside of what was simulated have a reason alone."""
    reasons = population.outside(presses)
    within = [row for row, reason in enumerate(reasons) if not reason]
    chosen = presses[within]
    compliance, share = population.predict(chosen.layers_mm, chosen.width_mm, chosen.force_N)
    if population.sites:
        compliance = compliance * population.site_factor(chosen.site)
    columns = (compliance, *population.interval(compliance), share)
    values = dict(zip(within, zip(*(each.tolist() for each in columns), strict=True), strict=True))
    return [
        {
            "status": "outside" if reason else "predicted",
            "reason": reason,
            **dict(zip(VALUES, values.get(row, [None] * len(VALUES)), strict=True)),
        }
        for row, reason in enumerate(reasons)
    ]
