"""What the page draws, as plain lists: names are values and never keys, so that any name will do."""

import math
from typing import Any

import matplotlib as mpl
import numpy as np
import polars as pl

from palpate.domain import Curve, FloatArray, Indentation, IntArray
from palpate.report.convergence import CONTACT
from palpate.report.figures import DISTRIBUTION_LIMIT, fit_of
from palpate.report.report_data import ReportData
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


def page_data(data: ReportData) -> dict[str, Any]:
    """Everything that the page's figures are drawn from, fit for JSON."""
    sets = _shown_sets(data)
    return {
        "notice": data.notice,
        "spots": list(data.spots),
        "scenarios": [{"name": s.name, "fitted": weighted_channels(s)} for s in data.study.scenarios],
        "generalising": [s.name for s in data.study.scenarios].index(data.generalising.name),
        "channels": [
            {"name": n, "x": data.channels[n].abscissa_label, "y": data.channels[n].ordinate_label}
            for n in data.measured_channels
        ],
        "parameters": [
            {"label": label_of(parameter), "log": parameter.scale == "log"}
            for parameter in named_briefly(data.design.parameters)
        ],
        "limits": {"colour": COLOUR_LIMIT, "distribution": DISTRIBUTION_LIMIT, "pairs": MOST_PAIRS},
        "colours": [mpl.colors.to_hex(c) for c in colours()(np.linspace(0.0, 1.0, N_COLOURS))],
        "measured": [_measured(data, spot) for spot in data.spots],
        "fits": [_fits(data, spot) for spot in data.spots],
        "sets": _sets(data, sets),
        "swept": _swept(data, sets),
        "limbs": _limbs(data),
        "contact": [_contacts(data, spot) for spot in data.spots] if data.contact else [],
        "contact_labels": list(CONTACT.values()),
    }


# -------------------------------------------------------------------- curves


def _measured(data: ReportData, spot: str) -> list[dict[str, Any] | None]:
    """Curve of each channel at a spot, with its band; None where it was not measured."""
    curves = data.measured[spot].curves
    return [_curve(curves[name]) if name in curves else None for name in data.measured_channels]


def _curve(curve: Curve) -> dict[str, Any]:
    kept = _spread_out(curve.abscissa.size, MOST_POINTS)
    x, y = curve.abscissa[kept], curve.ordinate[kept]
    drawn = {"x": _digits(x), "y": _digits(y)}
    if curve.std is None:
        return drawn
    std = curve.std[kept]
    thinned = Curve(channel=curve.channel, abscissa=x, ordinate=y)
    return drawn | {"bands": [_band(x[i:j], y[i:j], std[i:j]) for i, j in thinned.branches]}


def _band(x: FloatArray, y: FloatArray, std: FloatArray) -> dict[str, Any]:
    """Outline of one standard deviation to each side, along one branch of a curve and back."""
    return {
        "x": _digits(np.concatenate([x, x[::-1]])),
        "y": _digits(np.concatenate([y + std, (y - std)[::-1]])),
    }


def _fits(data: ReportData, spot: str) -> list[dict[str, Any] | None]:
    """Best curves of each scenario, then those of the set for all spots."""
    fits: list[dict[str, Any] | None] = []
    for scenario in data.study.scenarios:
        label, curves = fit_of(data, spot, scenario.name)
        fits.append(_fit(data, label, dict(curves)) if curves else None)
    if not data.generalisation.is_empty():
        set_id = data.generalisation["set_id"][0]
        response = data.responses.get((spot, set_id))
        label = f"one set for all spots, set {set_id}"
        fits.append(_fit(data, label, dict(response.curves)) if response else None)
    return fits


def _fit(data: ReportData, label: str, curves: dict[str, Curve]) -> dict[str, Any]:
    names = data.measured_channels
    return {"label": label, "curves": [_curve(curves[n]) if n in curves else None for n in names]}


# ---------------------------------------------------------------------- sets


def _shown_sets(data: ReportData) -> IntArray:
    """Ids of the sets that the page shows, in order."""
    n_sets, n_parameters = data.design.n_sets, len(data.design.parameters)
    n_panels = min(math.comb(n_parameters, 2), MOST_PAIRS) + n_parameters
    most = min(MOST_SETS, MOST_DOTS // n_panels)
    if n_sets <= most:
        return np.arange(n_sets)
    best = objectives(data.scores, data.study.scenarios).group_by("set_id").agg(pl.col("fopt").min())
    return np.sort(best.sort("fopt", "set_id").head(most)["set_id"].to_numpy())


def _sets(data: ReportData, sets: IntArray) -> dict[str, Any]:
    """Values by parameter, and Fopt by spot and scenario: lists over the sets, null where not ranked."""
    ranked = objectives(data.scores, data.study.scenarios)
    place = {int(set_id): i for i, set_id in enumerate(sets)}
    fopt = [[_fopt(ranked, spot, s.name, place) for s in data.study.scenarios] for spot in data.spots]
    return {
        "ids": sets.tolist(),
        "n_left_out": data.design.n_sets - len(sets),
        "values": [_digits(column) for column in data.design.values[sets].T],
        "fopt": fopt,
    }


def _fopt(ranked: pl.DataFrame, spot: str, scenario: str, place: dict[int, int]) -> list[float | None]:
    rows = ranked.filter((pl.col("spot") == spot) & (pl.col("scenario") == scenario))
    found: list[float | None] = [None] * len(place)
    for set_id, fopt in rows.select("set_id", "fopt").iter_rows():
        if set_id in place:
            found[place[set_id]] = _four(fopt)
    return found


def _swept(data: ReportData, sets: IntArray) -> list[list[dict[str, Any] | None]]:
    """Curves of every set shown at every spot in each channel, at few of the measured points."""
    n_curves = len(data.swept) * len(sets)
    if not n_curves:
        return []
    n_points = min(60, MOST_NUMBERS // n_curves)
    if n_points < 8:
        return []
    return [
        [_swept_at(data, spot, name, sets, n_points) for name in data.measured_channels]
        for spot in data.spots
    ]


def _swept_at(
    data: ReportData, spot: str, channel: str, sets: IntArray, n_points: int
) -> dict[str, Any] | None:
    values = data.swept.get((spot, channel))
    if values is None:
        return None
    abscissa = data.measured[spot][channel].abscissa
    kept = _spread_out(abscissa.size, n_points)
    return {"x": _digits(abscissa[kept]), "y": [_digits(row) for row in values[np.ix_(sets, kept)]]}


# --------------------------------------------------------------------- limbs


def _limbs(data: ReportData) -> list[list[dict[str, Any]]]:
    if not data.limbs:
        return []
    most = MOST_MESH_TRIANGLES // len(data.spots)
    return [
        scene(data.limbs[spot], data.study.protocol_at(spot), most) if spot in data.limbs else []
        for spot in data.spots
    ]


def _contacts(data: ReportData, spot: str) -> list[dict[str, Any] | None]:
    """Contact along the path of the set that each scenario selected; None where the solver reported none."""
    chosen = data.selection.filter(pl.col("spot") == spot)
    sets = dict(chosen.select("scenario", "set_id").iter_rows())
    return [_contact(data, spot, sets.get(scenario.name)) for scenario in data.study.scenarios]


def _contact(data: ReportData, spot: str, set_id: int | None) -> dict[str, Any] | None:
    contact = None if set_id is None else data.contact.get((spot, set_id))
    if contact is None:
        return None
    limb, protocol = data.limbs.get(spot), data.study.protocol_at(spot)
    edge = edge_of_contact(limb, protocol, contact) if limb and isinstance(protocol, Indentation) else None
    rounded = {name: [_four(value) for value in values] for name, values in contact.items()}
    series = [rounded.get(name) for name in CONTACT]
    return {
        "set_id": set_id,
        "depth": rounded["depth_mm"],
        "rotation": rounded["rotation_deg"],
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
