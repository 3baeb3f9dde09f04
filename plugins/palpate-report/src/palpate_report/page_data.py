"""What the page draws, as plain lists: names are values and never keys, so that any name will do."""

import math
from collections.abc import Mapping
from itertools import combinations
from typing import Any

import matplotlib as mpl
import numpy as np
import polars as pl

from palpate.api import Curve, FloatArray, Indentation, IntArray, Scenario
from palpate.api.runs import objectives
from palpate_report.contours import along, contours, paths
from palpate_report.figures import fits_at, residuals
from palpate_report.headline import draws_of
from palpate_report.report_data import ReportData, label_of
from palpate_report.scene import edge_of_contact, scene, skins
from palpate_report.space import MOST_PAIRS, colours
from palpate_report.tables import weighted_channels

MOST_SETS = 1000
"""Most sets that the page shows; of more, those that fit best somewhere."""

MOST_DOTS = 12_000
"""Most points in the panels of the parameter space together: more are slow to draw and to select."""

MOST_DRAWS = 400
"""Most draws of a fit in the parameter space."""

MOST_POINTS = 400
"""Most points of one measured or chosen curve."""

MOST_NUMBERS = 150_000
"""Most numbers of the curves of all sets together; they are thinned to it."""

MOST_MESH_TRIANGLES = 16_000
"""Triangles of all limbs together."""

N_COLOURS = 64

COLOUR_LIMIT = 2.5
"""NMSE up to which the parameter space is coloured; above it is black."""

DISTRIBUTION_LIMIT = 4.0
"""NMSE at which the distribution is cut."""


def page_data(data: ReportData) -> dict[str, Any]:
    """Everything that the page's figures are drawn from, fit for JSON."""
    sets = _shown_sets(data)
    return {
        "notice": data.notice,
        "is_fitted": data.is_fitted,
        "spots": list(data.spots),
        "scenarios": [{"name": s.name, "fitted": weighted_channels(s)} for s in data.study.scenarios],
        "generalising": [s.name for s in data.study.scenarios].index(data.generalising.name),
        "channels": [
            {"name": n, "x": data.channels[n].abscissa_label, "y": data.channels[n].ordinate_label}
            for n in data.measured_channels
        ],
        "parameters": [
            {
                "label": label_of(parameter),
                "log": parameter.scale == "log",
                "truth": data.study.truth.get(name),
            }
            for name, parameter in data.brief.items()
        ],
        "draws": [_draws(data, scenario) for scenario in data.study.scenarios],
        "contours": [_contours(data, scenario) for scenario in data.study.scenarios],
        "along": [_along(data, scenario) for scenario in data.study.scenarios],
        "limits": {"colour": COLOUR_LIMIT, "distribution": DISTRIBUTION_LIMIT, "pairs": MOST_PAIRS},
        "colours": [mpl.colors.to_hex(c) for c in colours()(np.linspace(0.0, 1.0, N_COLOURS))],
        "measured": [_curves(data, data.measured[spot].curves) for spot in data.spots],
        "fits": [_fits(data, spot) for spot in data.spots],
        "searches": [[_searches(data, spot, s) for s in data.study.scenarios] for spot in data.spots],
        "sets": _sets(data, sets),
        "swept": _swept(data, sets),
        "limbs": _limbs(data),
        "skins": skins(data),
        "edges": [_edges(data, spot) for spot in data.spots] if data.contact else [],
    }


# -------------------------------------------------------------------- curves


def _curves(data: ReportData, curves: Mapping[str, Curve]) -> list[dict[str, Any] | None]:
    """Curve of each channel, with its band; None where there is none."""
    return [_curve(curves[name]) if name in curves else None for name in data.measured_channels]


def _curve(curve: Curve) -> dict[str, Any]:
    kept = _spread_out(curve.abscissa.size, MOST_POINTS)
    x, y = curve.abscissa[kept], curve.ordinate[kept]
    drawn: dict[str, Any] = {"x": _digits(x), "y": _digits(y)}
    if curve.std is None:
        return drawn
    drawn["noise"] = {"x": _digits(x), "y": _digits(curve.std[kept])}
    low, high = y - curve.std[kept], y + curve.std[kept]
    branches = Curve(channel=curve.channel, abscissa=x, ordinate=y).branches
    # The outline of the band: along one branch of the curve and back.
    return drawn | {
        "bands": [
            {
                "x": _digits(np.concatenate([x[i:j], x[i:j][::-1]])),
                "y": _digits(np.concatenate([high[i:j], low[i:j][::-1]])),
            }
            for i, j in branches
        ]
    }


def _fits(data: ReportData, spot: str) -> list[dict[str, Any] | None]:
    """Best curves of each scenario, then those for all spots; with what they miss at measured points."""
    measured = data.measured[spot].curves

    def missed(curves: Mapping[str, Curve]) -> list[list[float | None] | None]:
        both = (name in curves and name in measured for name in data.measured_channels)
        return [
            _digits(
                residuals(measured[name], curves[name])[
                    _spread_out(measured[name].abscissa.size, MOST_POINTS)
                ]
            )
            if is_there
            else None
            for name, is_there in zip(data.measured_channels, both, strict=True)
        ]

    return [
        {"label": label, "curves": _curves(data, curves), "missed": missed(curves)} if curves else None
        for label, curves in fits_at(data, spot)
    ]


def _searches(data: ReportData, spot: str, scenario: Scenario) -> list[dict[str, Any]]:
    """Ways of the joint fit and of that of a spot."""
    return [
        {
            "fit": fit,
            "ways": [
                {
                    "fopt": _digits(way["fopt"].to_numpy()),
                    "values": [_digits(way[p.name].to_numpy()) for p in data.design.parameters],
                }
                for way in ways
            ],
        }
        for fit in dict.fromkeys((data.together, spot))
        if (ways := paths(data, fit, scenario.name, spot))
    ]


def _draws(data: ReportData, scenario: Scenario) -> list[list[float | None] | None]:
    """Draws of the fit that leads by parameter; None where a parameter differs from spot to spot."""
    found = draws_of(data, scenario.name, MOST_DRAWS)
    return [_digits(found[name].to_numpy()) if name in found.columns else None for name in data.brief]


def _contours(data: ReportData, scenario: Scenario) -> dict[str, list[dict[str, Any]]]:
    """Contour lines by plane, under the numbers of its parameters."""
    pairs = list(combinations(enumerate(data.brief), 2))[:MOST_PAIRS]
    found = {f"{i} {j}": contours(data, scenario.name, one, other) for (i, one), (j, other) in pairs}
    return {
        plane: [
            {"level": line.level, "x": _digits(line.x), "y": _digits(line.y), "label": line.label}
            for line in lines
        ]
        for plane, lines in found.items()
    }


def _along(data: ReportData, scenario: Scenario) -> list[dict[str, Any] | None]:
    """Fopt along each parameter, the others fitted again."""
    found = [along(data, scenario.name, name) for name in data.brief]
    return [None if each is None else {"x": _digits(each[0]), "y": _digits(each[1])} for each in found]


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
    shown = pl.DataFrame({"set_id": sets})

    def fopt(spot: str, scenario: str) -> list[float | None]:
        rows = ranked.filter(spot=spot, scenario=scenario)
        found = shown.join(rows, on="set_id", how="left", maintain_order="left")["fopt"]
        return _digits(found.to_numpy())

    return {
        "ids": sets.tolist(),
        "n_left_out": data.design.n_sets - len(sets),
        "values": [_digits(column) for column in data.design.values[sets].T],
        "fopt": [[fopt(spot, s.name) for s in data.study.scenarios] for spot in data.spots],
    }


def _swept(data: ReportData, sets: IntArray) -> list[list[dict[str, Any] | None]]:
    """Curves of every set shown at every spot in each channel, at few of the measured points."""
    n_points = min(60, MOST_NUMBERS // max(1, len(data.swept) * len(sets)))
    if not data.swept or n_points < 8:
        return []

    def curves(spot: str, channel: str) -> dict[str, Any] | None:
        values = data.swept.get((spot, channel))
        if values is None:
            return None
        abscissa = data.measured[spot][channel].abscissa
        kept = _spread_out(abscissa.size, n_points)
        return {"x": _digits(abscissa[kept]), "y": [_digits(row) for row in values[np.ix_(sets, kept)]]}

    return [[curves(spot, name) for name in data.measured_channels] for spot in data.spots]


# --------------------------------------------------------------------- limbs


def _limbs(data: ReportData) -> list[list[dict[str, Any]]]:
    if not data.limbs:
        return []
    most = MOST_MESH_TRIANGLES // len(data.spots)
    return [
        scene(data.limbs[spot], data.study.protocol_at(spot), most) if spot in data.limbs else []
        for spot in data.spots
    ]


def _edges(data: ReportData, spot: str) -> list[dict[str, Any] | None]:
    """Edge of the contact of the set that each scenario selected; None where the solver reported none."""
    sets = dict(data.selection.filter(spot=spot).select("scenario", "set_id").iter_rows())
    limb, protocol = data.limbs.get(spot), data.study.protocol_at(spot)

    def edge(set_id: int | None) -> dict[str, Any] | None:
        found = None if set_id is None else data.contact.get((spot, set_id))
        if found is None or limb is None or not isinstance(protocol, Indentation):
            return None
        return edge_of_contact(limb, protocol, found)

    return [edge(sets.get(scenario.name)) for scenario in data.study.scenarios]


# ------------------------------------------------------------------- numbers


def _spread_out(n: int, most: int) -> IntArray:
    """Indices of at most so many of n points, both ends among them."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.int64))


def _digits(values: FloatArray) -> list[float | None]:
    """Five digits, which is more than a screen shows; None for what is not finite."""
    return [float(f"{value:.5g}") if math.isfinite(value) else None for value in values.tolist()]
