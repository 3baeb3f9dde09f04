"""``palpate predict-press``: the compliance of presses from their thicknesses, probe and load."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.api import AsJson, PalpateError, Session

HEADS = ("row", "compliance [mm/MPa]", "95 %", "fat's share")


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
    """Predict presses of an ultrasound probe, by layered finite elements fitted to living limbs."""
    from palpate_multis.population import fit, fit_own, with_sites
    from palpate_multis.presses import read_presses

    session = Session.of(context)
    presses = read_presses(table, measured=False)
    known = read_presses(fitted_to)
    population = fit_own(known, str(fitted_to)) if fitted_to else fit(known)
    compliance, share = population.predict(presses.layers_mm, presses.width_mm, presses.force_N)
    if presses.site.any():
        if not known.site.all():
            raise PalpateError(
                f"{table} has sites, {fitted_to} none: give both the column 'site', or neither"
            )
        population = with_sites(population, known)
        compliance = compliance * population.site_factor(presses.site)
    lower, upper = population.interval(compliance)
    columns = (compliance.tolist(), lower.tolist(), upper.tolist(), share.tolist())
    rows = list(zip(*columns, strict=True))
    moduli = {name: getattr(population, name) for name in ("muscle_MPa", "fat_MPa", "load_exponent")}
    if as_json:
        names = ("compliance_mm_per_MPa", "lower", "upper", "fat_share")
        session.json(
            {
                "fit": moduli | {"sites": dict(population.sites)},
                "presses": [dict(zip(names, row, strict=True)) for row in rows],
            }
        )
        return
    cells = [
        [str(number), f"{middle:.0f}", f"{low:.0f}–{high:.0f}", f"{fat:.0%}"]
        for number, (middle, low, high, fat) in enumerate(rows, start=1)
    ]
    session.table("Fit", list(moduli), [[f"{value:.3g}" for value in moduli.values()]])
    if population.sites:
        factors = [f"{factor:.2f}" for factor in population.sites.values()]
        session.table("Factors of compliance", list(population.sites), [factors])
    session.table("Presses", list(HEADS), cells)
