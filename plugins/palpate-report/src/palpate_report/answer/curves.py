"""Curves of a run with the values that it reports: of each scenario, spot and of all spots."""

from collections.abc import Mapping

import numpy as np

from palpate.api import Curve, CurveError, FloatArray
from palpate.api.fit import ALL_SPOTS
from palpate.api.scores import interpolate
from palpate_report.data.report_data import ReportData


def residuals(measured: Curve, simulated: Curve) -> FloatArray:
    """Simulated minus measured ordinates (n,) at the measured abscissae, NaN where there are none."""
    try:
        values, _ = interpolate(simulated.abscissa, simulated.ordinate, measured.abscissa)
    except CurveError:
        return np.full(measured.abscissa.size, np.nan)
    return values - measured.ordinate


def fits_at(data: ReportData, spot: str) -> list[tuple[str, Mapping[str, Curve]]]:
    """Label and curves at a spot: the best of each scenario shown, then the joint ones of several spots."""
    fits = [fit_of(data, spot, scenario) for scenario in data.shown_scenarios]
    return [*fits, for_all_spots(data, spot)] if len(data.spots) > 1 else fits


def for_all_spots(data: ReportData, spot: str) -> tuple[str, Mapping[str, Curve]]:
    """Label and curves at a spot of the joint fit, else of the set for all spots; of one spot, its own."""
    if len(data.spots) == 1:
        return fit_of(data, spot, data.generalising.name)
    joint = data.fit.curves.get((ALL_SPOTS, data.generalising.name, spot))
    if joint is not None:
        return f"all spots, scenario {data.generalising.name}, fit", joint.curves
    for set_id in data.generalisation["set_id"][:1]:
        response = data.responses.get((spot, set_id))
        return f"one set for all spots, set {set_id}", response.curves if response else {}
    return "", {}


def fit_of(data: ReportData, spot: str, scenario: str) -> tuple[str, Mapping[str, Curve]]:
    """Label and curves of a scenario at a spot: the fitted ones, else the curves of the selected set."""
    if (fitted := data.fit.curves.get((spot, scenario, spot))) is not None:
        return f"scenario {scenario}, fit", fitted.curves
    for set_id in data.selection.filter(spot=spot, scenario=scenario)["set_id"]:
        if (response := data.responses.get((spot, set_id))) is not None:
            return f"scenario {scenario}, set {set_id}", response.curves
    return scenario, {}


def same_curves(runs: Mapping[str, ReportData]) -> bool:
    """Whether all runs are fitted to the same measured curves in the same channels."""
    first, *others = runs.values()
    return all(
        data.spots == first.spots
        and data.generalising.weighed == first.generalising.weighed
        and all(_is_same(data, first, spot) for spot in first.spots)
        for data in others
    )


def _is_same(one: ReportData, other: ReportData, spot: str) -> bool:
    a, b = one.measured[spot].curves, other.measured[spot].curves
    return a.keys() == b.keys() and all(
        np.array_equal(a[name].abscissa, b[name].abscissa)
        and np.array_equal(a[name].ordinate, b[name].ordinate)
        for name in a
    )
