"""Checks of a solver's answers; anything else is a failed simulation with a reason, never a number."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.domain import Curve, Indentation, Response, Simulation, Status, SurfaceStates
from palpate.errors import CurveError


class UnreadableError(CurveError):
    """A solver answered with something that can be neither kept nor scored."""


def checked(answer: object) -> Simulation:
    """Copy of a solver's answer in values that any process and any file can hold.

    An UnreadableError where it is no :class:`Simulation`, or a part of it is not of its type.
    """
    if not isinstance(answer, Simulation):
        raise UnreadableError(f"the solver answered with a {type(answer).__name__}, not a Simulation")
    if not isinstance(answer.diagnostics, Mapping):
        raise UnreadableError(
            f"the diagnostics are a {type(answer.diagnostics).__name__}; give a mapping of names to values"
        )
    if answer.status not in tuple(Status):
        raise UnreadableError(f"no status {answer.status!r} (known: {', '.join(Status)})")
    return replace(
        answer,
        status=Status(answer.status),
        response=None if answer.response is None else _checked_curves(answer.response),
        message=storable(answer.message),
        diagnostics=plain(answer.diagnostics),
        surface=_checked_surface(answer),
        n_crashes=0,
    )


def _checked_surface(answer: Simulation) -> SurfaceStates | None:
    """States of the skin, made again since arrays may have been replaced; none that nobody asked for."""
    if not answer.job.surface or (answer.surface is None and answer.status is not Status.OK):
        return None
    if not isinstance(answer.surface, SurfaceStates):
        raise UnreadableError(f"the surface is a {type(answer.surface).__name__}; give SurfaceStates")
    return replace(answer.surface)


def _checked_curves(response: object) -> Response:
    if not isinstance(response, Response):
        raise UnreadableError(f"the response is a {type(response).__name__}, not a Response or None")
    curves = {}
    for channel, curve in response.curves.items():
        if not isinstance(curve, Curve):
            raise UnreadableError(f"channel '{channel}' is a {type(curve).__name__}, not a Curve")
        if curve.channel != channel:
            raise UnreadableError(f"channel '{channel}' holds a curve of channel '{curve.channel}'")
        # Made again, since its arrays may have been replaced after it was checked.
        curves[channel] = replace(curve)
    return Response(curves=curves)


def reject_nonphysical(simulation: Simulation) -> Simulation:
    """Return the simulation, or one that is ``unreadable`` where ``ok`` cannot be true.

    A solver that is ``ok`` has answered curves, and not every one of them is zero throughout where
    the job deforms the body: nothing touches nothing then.
    """
    if simulation.status is not Status.OK:
        return simulation
    curves = () if simulation.response is None else tuple(simulation.response.curves.values())
    if not curves:
        return _unreadable(simulation, "the solver answered ok without a curve")
    press = simulation.job.protocol
    deforms = not isinstance(press, Indentation) or np.any(press.path[:, 0])
    if deforms and not any(np.any(curve.ordinate) for curve in curves):
        names = ", ".join(curve.channel for curve in curves)
        return _unreadable(
            simulation,
            f"no contact: {names} zero at every point of a path that deforms the body; check the mesh "
            "(unit, spot, elements that occur twice)",
        )
    return simulation


def _unreadable(simulation: Simulation, why: str) -> Simulation:
    return replace(simulation, status=Status.UNREADABLE, message=why)


def storable(message: object, longest: int = 4000) -> str:
    """Text without what no file can hold, and without the middle of one that is longer than ``longest``."""
    text = str(message)
    if len(text) > longest:
        text = f"{text[: longest // 2]} … {text[-longest // 2 :]}"
    return text.encode(errors="backslashreplace").decode().replace("\0", "\\0")


def plain(value: Any) -> Any:  # noqa: ANN401 - whatever a solver reports
    """Turn a solver's diagnostics into JSON: numbers, text, lists, tables; anything else as its text."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not (abs(value) < float("inf")):
        return str(value)
    return value if value is None or isinstance(value, (str, bool, int, float)) else repr(value)
