"""Measured curves: read by the study's loader, and checked against its protocol."""

from collections.abc import Iterator, Mapping

import numpy as np

from palpate import _core
from palpate.domain import (
    Channel,
    Curve,
    FloatArray,
    Indentation,
    Response,
    moving_span,
)
from palpate.errors import CurveError, PalpateError
from palpate.plugins import answering_for
from palpate.study import Study, StudySpot

COVERED_SHARE = 0.98
"""Share of the protocol's travel that a measured curve must reach."""

_PATH_COLUMNS = {"depth_mm": (0, "mm"), "rotation_deg": (1, "degrees")}


def load_measured(study: Study, channels: Mapping[str, Channel]) -> dict[str, Response]:
    """Measured response of each spot.

    Parameters
    ----------
    study : Study
    channels : mapping of name to Channel
        What each channel is measured over.

    Raises
    ------
    CurveError
        A file cannot be read, a channel that a scenario weights is missing, or a
        curve does not cover the protocol.
    """
    return {spot.spot.name: _load_spot(study, spot, channels) for spot in study.spots}


def _load_spot(study: Study, spot: StudySpot, channels: Mapping[str, Channel]) -> Response:
    curves: dict[str, Curve] = {}
    for only, path in spot.measured.items():
        with answering_for(study.loader, f"reading {path}"):
            response = study.loader.load(path, only)
            if not isinstance(response, Response):
                raise TypeError(f"it returned a {type(response).__name__} and not a Response")
        for name, curve in response.curves.items():
            if name in curves:
                raise CurveError(
                    f"{path}: channel '{name}' of spot '{spot.spot.name}' is already read from "
                    "another file; name each channel once"
                )
            try:
                _check_known(name, channels)
                if isinstance(study.protocol, Indentation):
                    check_covers(curve, channels[name], study.protocol, study.minimum_coverage)
            except PalpateError as error:
                raise CurveError(f"{path}: spot '{spot.spot.name}': {error}") from error
            curves[name] = curve
    _check_weighted(study, spot, curves)
    return Response(curves=curves)


def _check_known(name: str, channels: Mapping[str, Channel]) -> None:
    if name not in channels:
        raise CurveError(
            f"channel '{name}' is declared by no plugin (known: {', '.join(channels) or 'none'}); "
            "declare it in a palpate_channels hook"
        )


def _check_weighted(study: Study, spot: StudySpot, curves: Mapping[str, Curve]) -> None:
    for scenario in study.scenarios:
        for channel, weight in scenario.weights.items():
            if weight > 0.0 and channel not in curves:
                files = ", ".join(str(path) for path in spot.measured.values())
                raise CurveError(
                    f"{files}: spot '{spot.spot.name}' has no channel '{channel}', which scenario "
                    f"'{scenario.name}' weights (found: {', '.join(curves) or 'none'}); measure it or "
                    "leave the scenario out"
                )


def check_covers(
    curve: Curve, channel: Channel, protocol: Indentation, minimum_coverage: float = 0.0
) -> None:
    """Refuse a measured curve that does not follow the protocol.

    It must run through ``COVERED_SHARE`` of the protocol's travel, turn no more often
    than the protocol does, and lie within it for at least ``minimum_coverage`` of its
    points. A channel over anything but depth or rotation is not checked.

    Raises
    ------
    CurveError
        Saying what is covered and what the protocol asks for.
    """
    if channel.abscissa not in _PATH_COLUMNS:
        return
    column, unit = _PATH_COLUMNS[channel.abscissa]
    asked = protocol.path[:, column]
    if not np.ptp(asked) > 0.0:
        raise CurveError(
            f"channel '{curve.channel}' is measured over {channel.abscissa}, which the protocol never "
            "moves; add it to the protocol's path or leave the channel out"
        )
    for problem in _departures(curve, asked, unit, minimum_coverage):
        raise CurveError(f"channel '{curve.channel}' {problem}")


def _departures(curve: Curve, asked: FloatArray, unit: str, minimum_coverage: float) -> Iterator[str]:
    low, high = float(asked.min()), float(asked.max())
    least, most = float(curve.abscissa.min()), float(curve.abscissa.max())
    covered = f"covers {least:g} to {most:g} {unit} where the protocol runs from {low:g} to {high:g} {unit}"
    slack = (1.0 - COVERED_SHARE) * (high - low)
    if least > low + slack or most < high - slack:
        yield f"{covered}; measure the whole path or shorten the protocol"
    outside = (curve.abscissa < low - slack) | (curve.abscissa > high + slack)
    if 1.0 - outside.mean() < minimum_coverage:
        yield f"{covered}; cut the curve or extend the protocol"
    turns = len(curve.branches) - 1
    allowed = len(_core.branches(np.ascontiguousarray(asked[moving_span(asked)]))) - 1
    if turns > allowed:
        turning_point = curve.branches[allowed + 1][0]
        yield (
            f"turns {turns} times where the protocol turns {allowed} times (first at row "
            f"{turning_point}, {curve.abscissa[turning_point]:g} {unit}); smooth its abscissa"
        )
