"""Data that the page draws, as plain lists: names are values and never keys, so that any name will do."""

import math
from itertools import combinations
from typing import Any

import matplotlib as mpl
import numpy as np
import polars as pl

from palpate.api import IntArray, Scenario
from palpate.api.runs import objectives
from palpate_report.answer.headline import draws_of
from palpate_report.data.best import weighted_channels
from palpate_report.data.report_data import ReportData, label_of
from palpate_report.data.showable import plain
from palpate_report.figures.contours import along, contours, paths, reported
from palpate_report.figures.scene import scene, skins
from palpate_report.figures.space import MOST_PAIRS, colours

MOST_SETS = 1000
"""Most sets that the page shows; of more, those that fit best somewhere."""

N_COLOURS = 64


def page_data(data: ReportData) -> dict[str, Any]:
    """Everything that the page's figures are drawn from, fit for JSON."""
    sets = _shown_sets(data)
    # NMSE up to which the parameter space is coloured, and at which the panels over Fopt are cut.
    return {
        "spots": list(data.spots),
        "scenarios": [{"name": s.name, "fitted": weighted_channels(s)} for s in data.study.scenarios],
        "generalising": [s.name for s in data.study.scenarios].index(data.generalising.name),
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
        "limits": {"colour": 2.5, "fopt": 4.0, "pairs": MOST_PAIRS},
        "colours": [mpl.colors.to_hex(c) for c in colours()(np.linspace(0.0, 1.0, N_COLOURS))],
        "searches": [[_searches(data, spot, s) for s in data.study.scenarios] for spot in data.spots],
        "sets": _sets(data, sets),
        "limbs": [
            scene(data.limbs[spot], data.study.protocol_at(spot), 16_000 // len(data.spots))
            if spot in data.limbs
            else []
            for spot in data.spots
            if data.limbs
        ],
        "skins": skins(data),
    }


# ---------------------------------------------------------- fits in the planes


def _searches(data: ReportData, spot: str, scenario: Scenario) -> list[dict[str, Any]]:
    """Ways of the joint fit and of the fit of a spot."""
    return [
        {
            "fit": fit,
            "reported": {"fopt": at.get("fopt"), "values": [at.get(p.name) for p in data.design.parameters]}
            if (at := reported(data, fit, scenario.name))
            else None,
            "ways": [
                {
                    "fopt": plain(way["fopt"].to_numpy()),
                    "values": [plain(way[p.name].to_numpy()) for p in data.design.parameters],
                }
                for way in ways
            ],
        }
        for fit in dict.fromkeys((data.together, spot))
        if (ways := paths(data, fit, scenario.name, spot))
    ]


def _draws(data: ReportData, scenario: Scenario) -> list[list[float | None] | None]:
    """Some draws of the fit that leads by parameter; None where a parameter differs from spot to spot."""
    found = draws_of(data, scenario.name, 400)
    return [plain(found[name].to_numpy()) if name in found.columns else None for name in data.brief]


def _contours(data: ReportData, scenario: Scenario) -> dict[str, list[dict[str, Any]]]:
    """Contour lines by plane, under the numbers of its parameters."""
    pairs = list(combinations(enumerate(data.brief), 2))[:MOST_PAIRS]
    found = {f"{i} {j}": contours(data, scenario.name, one, other) for (i, one), (j, other) in pairs}
    return {
        plane: [
            {"level": line.level, "x": plain(line.x), "y": plain(line.y), "label": line.label}
            for line in lines
        ]
        for plane, lines in found.items()
    }


def _along(data: ReportData, scenario: Scenario) -> list[dict[str, Any] | None]:
    """Fopt along each parameter, the others fitted again."""
    found = [along(data, scenario.name, name) for name in data.brief]
    return [None if each is None else {"x": plain(each[0]), "y": plain(each[1])} for each in found]


# ---------------------------------------------------------------------- sets


def _shown_sets(data: ReportData) -> IntArray:
    """Ids of the sets that the page shows, in order."""
    n_sets, n_parameters = data.design.n_sets, len(data.design.parameters)
    n_panels = min(math.comb(n_parameters, 2), MOST_PAIRS) + n_parameters
    # Most points in the panels of the parameter space together: more are slow to draw and to select.
    most = min(MOST_SETS, 12_000 // n_panels)
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
        return plain(found.to_numpy())

    return {
        "ids": sets.tolist(),
        "n_left_out": data.design.n_sets - len(sets),
        "values": [plain(column) for column in data.design.values[sets].T],
        "fopt": [[fopt(spot, s.name) for s in data.study.scenarios] for spot in data.spots],
    }
