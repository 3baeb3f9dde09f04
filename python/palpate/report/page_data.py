"""What the page draws, as plain lists: names are values and never keys, so that any name will do."""

import math
from typing import Any

import matplotlib as mpl
import numpy as np
import polars as pl

from palpate.domain import Curve, FloatArray, Indentation, IntArray
from palpate.report.content import Content
from palpate.report.convergence import CONTACT
from palpate.report.figures import DISTRIBUTION_LIMIT, fit_of
from palpate.report.scene import edge_of_contact, scene
from palpate.report.space import COLOUR_LIMIT, MOST_PAIRS, colours, label_of, named_briefly
from palpate.report.tables import weighted_channels
from palpate.stages.selection import objectives

MOST_SETS = 1000
"""Most sets that the page shows; of more, those that fit best somewhere."""

MOST_DOTS = 12_000
"""Most points in the panels of the parameter space together: more are slow to draw and to select."""

MOST_POINTS = 400
"""Most points of one measured or chosen curve."""

MOST_NUMBERS = 150_000
"""Most numbers of the curves of all sets together; they are thinned to it."""

MOST_MESH_TRIANGLES = 16_000
"""Triangles of all limbs together."""

N_COLOURS = 64


def page_data(content: Content) -> dict[str, Any]:
    """Everything that the page's figures are drawn from, fit for JSON."""
    sets = _shown_sets(content)
    brief = named_briefly(content.design.parameters)
    return {
        "notice": content.notice,
        "spots": list(content.spots),
        "scenarios": [
            {"name": s.name, "fitted": weighted_channels(s), "description": s.description}
            for s in content.study.scenarios
        ],
        "generalising": [s.name for s in content.study.scenarios].index(content.generalising.name),
        "channels": [
            {"name": n, "x": content.channels[n].abscissa_label, "y": content.channels[n].ordinate_label}
            for n in content.measured_channels
        ],
        "parameters": [
            {
                "label": label_of(short),
                "lower": full.lower,
                "upper": full.upper,
                "log": full.scale == "log",
                "truth": content.study.truth.get(full.name),
            }
            for full, short in zip(content.design.parameters, brief, strict=True)
        ],
        "limits": {"colour": COLOUR_LIMIT, "distribution": DISTRIBUTION_LIMIT, "pairs": MOST_PAIRS},
        "colours": [mpl.colors.to_hex(c) for c in colours()(np.linspace(0.0, 1.0, N_COLOURS))],
        "measured": [_measured(content, spot) for spot in content.spots],
        "fits": [_fits(content, spot) for spot in content.spots],
        "sets": _sets(content, sets),
        "swept": _swept(content, sets),
        "limbs": _limbs(content),
        "contact": [_contacts(content, spot) for spot in content.spots] if content.contact else [],
        "contact_labels": list(CONTACT.values()),
    }


# -------------------------------------------------------------------- curves


def _measured(content: Content, spot: str) -> list[dict[str, Any] | None]:
    """Curve of each channel at a spot, with its band; None where it was not measured."""
    curves = content.measured[spot].curves
    return [_curve(curves[name]) if name in curves else None for name in content.measured_channels]


def _curve(curve: Curve) -> dict[str, Any]:
    kept = _spread_out(curve.abscissa.size, MOST_POINTS)
    drawn = {"x": _digits(curve.abscissa[kept]), "y": _digits(curve.ordinate[kept])}
    return drawn if curve.std is None else drawn | {"std": _digits(curve.std[kept])}


def _fits(content: Content, spot: str) -> list[dict[str, Any] | None]:
    """Best curves of each scenario, then those of the set for all spots."""
    fits: list[dict[str, Any] | None] = []
    for scenario in content.study.scenarios:
        label, curves = fit_of(content, spot, scenario.name)
        fits.append(_fit(content, label, dict(curves)) if curves else None)
    if not content.generalisation.is_empty():
        set_id = content.generalisation["set_id"][0]
        response = content.responses.get((spot, set_id))
        label = f"one set for all spots, set {set_id}"
        fits.append(_fit(content, label, dict(response.curves)) if response else None)
    return fits


def _fit(content: Content, label: str, curves: dict[str, Curve]) -> dict[str, Any]:
    names = content.measured_channels
    return {"label": label, "curves": [_curve(curves[n]) if n in curves else None for n in names]}


# ---------------------------------------------------------------------- sets


def _shown_sets(content: Content) -> IntArray:
    """Ids of the sets that the page shows, in order."""
    n_sets, n_parameters = content.design.n_sets, len(content.design.parameters)
    n_panels = min(math.comb(n_parameters, 2), MOST_PAIRS) + n_parameters
    most = min(MOST_SETS, MOST_DOTS // n_panels)
    if n_sets <= most:
        return np.arange(n_sets)
    best = objectives(content.scores, content.study.scenarios).group_by("set_id").agg(pl.col("fopt").min())
    return np.sort(best.sort("fopt", "set_id").head(most)["set_id"].to_numpy())


def _sets(content: Content, sets: IntArray) -> dict[str, Any]:
    """Values by parameter, and Fopt by spot and scenario: lists over the sets, null where not ranked."""
    ranked = objectives(content.scores, content.study.scenarios)
    place = {int(set_id): i for i, set_id in enumerate(sets)}
    fopt = [[_fopt(ranked, spot, s.name, place) for s in content.study.scenarios] for spot in content.spots]
    return {
        "ids": sets.tolist(),
        "n_left_out": content.design.n_sets - len(sets),
        "values": [_digits(column) for column in content.design.values[sets].T],
        "fopt": fopt,
    }


def _fopt(ranked: pl.DataFrame, spot: str, scenario: str, place: dict[int, int]) -> list[float | None]:
    rows = ranked.filter((pl.col("spot") == spot) & (pl.col("scenario") == scenario))
    found: list[float | None] = [None] * len(place)
    for set_id, fopt in rows.select("set_id", "fopt").iter_rows():
        if set_id in place:
            found[place[set_id]] = _four(fopt)
    return found


def _swept(content: Content, sets: IntArray) -> list[list[dict[str, Any] | None]]:
    """Curves of every set shown at every spot in each channel, at few of the measured points."""
    n_curves = len(content.swept) * len(sets)
    if not n_curves:
        return []
    n_points = min(60, MOST_NUMBERS // n_curves)
    if n_points < 8:
        return []
    return [
        [_swept_at(content, spot, name, sets, n_points) for name in content.measured_channels]
        for spot in content.spots
    ]


def _swept_at(
    content: Content, spot: str, channel: str, sets: IntArray, n_points: int
) -> dict[str, Any] | None:
    values = content.swept.get((spot, channel))
    if values is None:
        return None
    abscissa = content.measured[spot][channel].abscissa
    kept = _spread_out(abscissa.size, n_points)
    return {"x": _digits(abscissa[kept]), "y": [_digits(row) for row in values[np.ix_(sets, kept)]]}


# --------------------------------------------------------------------- limbs


def _limbs(content: Content) -> list[list[dict[str, Any]]]:
    if not content.limbs:
        return []
    most = MOST_MESH_TRIANGLES // len(content.spots)
    return [
        scene(content.limbs[spot], content.study.protocol_at(spot), most) if spot in content.limbs else []
        for spot in content.spots
    ]


def _contacts(content: Content, spot: str) -> list[dict[str, Any] | None]:
    """Contact along the path of the set that each scenario selected; None where nobody told."""
    chosen = content.selection.filter(pl.col("spot") == spot)
    sets = dict(chosen.select("scenario", "set_id").iter_rows())
    return [_contact(content, spot, sets.get(scenario.name)) for scenario in content.study.scenarios]


def _contact(content: Content, spot: str, set_id: int | None) -> dict[str, Any] | None:
    contact = None if set_id is None else content.contact.get((spot, set_id))
    if contact is None:
        return None
    limb, protocol = content.limbs.get(spot), content.study.protocol_at(spot)
    edge = edge_of_contact(limb, protocol, contact) if limb and isinstance(protocol, Indentation) else None
    told = {name: [_four(value) for value in values] for name, values in contact.items()}
    series = [told.get(name) for name in CONTACT]
    return {
        "set_id": set_id,
        "depth": told["depth_mm"],
        "rotation": told["rotation_deg"],
        "series": series,
        "edge": edge,
    }


# ------------------------------------------------------------------- numbers


def _spread_out(n: int, most: int) -> IntArray:
    """Indices of at most so many of n points, both ends among them."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.int64))


def _digits(values: FloatArray) -> list[float | None]:
    return [_four(value) for value in values.tolist()]


def _four(value: float) -> float | None:
    """Five digits, which is more than a screen shows; None for what is not finite."""
    return float(f"{value:.5g}") if np.isfinite(value) else None
