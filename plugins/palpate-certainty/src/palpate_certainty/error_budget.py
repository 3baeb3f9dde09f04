"""What the known causes make of the residuals of a fit."""

from collections.abc import Mapping, Sequence

import numpy as np

from palpate.api import BoolArray, FloatArray, Response
from palpate.api.fit import Correction, SpotTerm, channel_of, pieces
from palpate.api.runs import Study
from palpate_certainty.error_sources import Columns, drift_of
from palpate_certainty.mesh_error import SpotMesh
from palpate_certainty.residual_layout import path_of

MESH, ZERO = "mesh", "zero"
"""Causes besides those of :mod:`~palpate_certainty.error_sources`."""


def error_budget(
    study: Study,
    measured: Mapping[str, Response],
    terms: Sequence[SpotTerm],
    residuals: FloatArray,
    columns: Columns,
    meshes: Mapping[str, SpotMesh],
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
    meshes : mapping of spot name to SpotMesh
        Of the spots whose meshes are known.

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
        mesh = meshes.get(term.spot, SpotMesh())
        if mesh.refinement > 1.0 and channel in term.corrections:
            added = _added(term.corrections[channel], scale, inside, fitted)
            add(MESH, f"{term.spot} {channel}", at, mesh.remainder(channel, added, fitted))
        elif study.solver.provides.mesh:
            add(MESH, channel, at, mesh.error(channel, study.budget.mesh) * fitted)
    return found


def _added(correction: Correction, scale: FloatArray, inside: BoolArray, fitted: FloatArray) -> FloatArray:
    """What a finer mesh adds to the residuals of a fitted curve (n,)."""
    fine = (scale * (correction.coarse + correction.added))[inside]
    known = np.isfinite(fine)
    size = np.linalg.norm(fitted[known]) / max(float(np.linalg.norm(fine[known])), 1e-300)
    added: FloatArray = size * (scale * correction.added)[inside]
    return added


def _label(cause: str) -> str:
    kind, _, of = cause.partition(" ")
    return of if kind == "fixed" else kind
