"""What the known causes make of the residuals of a fit."""

from collections.abc import Mapping, Sequence

import numpy as np

from palpate.certainty.causes import Columns, drift_of
from palpate.certainty.rows import path_of, pieces
from palpate.domain import FloatArray, Response, channel_of
from palpate.fit.spot_term import SpotTerm
from palpate.fit.tables import ORDER
from palpate.study.reading import Study

MESH, ZERO = "mesh", "zero"
"""Causes besides those of :mod:`~palpate.certainty.causes`."""


def known_errors(
    study: Study,
    measured: Mapping[str, Response],
    terms: Sequence[SpotTerm],
    residuals: FloatArray,
    columns: Columns,
    refinement: Mapping[str, float],
) -> dict[str, dict[str, FloatArray]]:
    """What one standard deviation of each cause adds to the residuals.

    Parameters
    ----------
    study : Study
    measured : mapping of spot name to Response
        As the loader has read them.
    terms : sequence of SpotTerm
    residuals : (n,) array
        Simulated less measured.
    columns : Columns
        What it adds to the curves, of the causes that are simulated.
    refinement : mapping of spot name to float
        Element size under the indenter over that of the finer mesh, of each spot that has one.

    Returns
    -------
    mapping of label to mapping of name to (n,) array
        A label is an entry of the budget; curves that share a name share the error.
    """
    found: dict[str, dict[str, FloatArray]] = {}

    def add(label: str, name: str, at: slice, values: FloatArray) -> None:
        found.setdefault(label, {}).setdefault(name, np.zeros(residuals.size))[at] = values

    for term, name, at, scale in pieces(terms):
        channel = channel_of(name)
        inside = term.counted(name)
        curve = term.measured[channel]
        for cause, ordinates in columns.get((term.spot, channel), {}).items():
            add(_label(cause), cause, at, (scale * ordinates)[inside])
        along = path_of(curve.abscissa) / path_of(curve.abscissa)[-1]
        drift = drift_of(study, measured[term.spot], channel) * along
        add(ZERO, f"{term.spot} {channel}", at, (scale * drift)[inside])
        # Of the fitted curve: the noise of the measured one would bias the most likely values.
        fitted = residuals[at] + (scale * curve.ordinate)[inside]
        if term.spot in refinement and channel in term.corrections:
            correction = term.corrections[channel]
            known = (scale * (correction.coarse + correction.added))[inside]
            size = np.linalg.norm(fitted[np.isfinite(known)]) / np.linalg.norm(known[np.isfinite(known)])
            left = size * correction.added / (refinement[term.spot] ** ORDER - 1.0)
            add(MESH, "", at, (scale * left)[inside])
        elif study.solver.provides.mesh:
            add(MESH, channel, at, study.budget.mesh * fitted)
    return found


def _label(cause: str) -> str:
    kind, _, of = cause.partition(" ")
    return of if kind == "fixed" else kind
