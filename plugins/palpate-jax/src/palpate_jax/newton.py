"""Equilibrium at one position of the sphere: Newton's method with line search."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from palpate.api import FloatArray
from palpate_jax.contact import ContactState
from palpate_jax.model import Model, Residual

MOST_ITERATIONS = 16

MOST_GROWTH = 2.0
"""Growth of the imbalance above which a step is shortened, against cycles of stick and slip."""


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """First guess (n_nodes, 3) [mm] of the displacements, and its residual where that is known."""

    displacements: FloatArray
    residual: Residual | None = None

    @property
    def imbalance(self) -> float:
        """Imbalance relative to the forces; infinite where it is unknown."""
        return np.inf if self.residual is None else self.residual.relative


@dataclass(frozen=True, slots=True, eq=False)
class Balance:
    """End of Newton's method; ``reason`` is empty when it converged.

    ``held``: with fixed friction limits.
    """

    displacements: FloatArray
    n_iterations: int
    reason: str
    held: bool = False


# A trial of the line search may have forces of an exponential beyond 1e154, whose norm is infinite.
@np.errstate(over="ignore")
def equilibrium(
    model: Model,
    thetas: Mapping[str, FloatArray],
    load: ContactState,
    start: Start,
    tolerance: float,
    most_iterations: int | None = None,
) -> Balance:
    """Displacements at which internal and contact forces balance.

    With much friction Newton's method may cycle between stick and slip: more pressure lets slipping
    points stick, and the other way round. Then friction limits are fixed, and updated until they agree
    with the pressures: with fixed limits there is a potential, in which the line search always descends,
    also from a saddle where the tissue buckles. The imbalance after the last update is small, and reported.

    Parameters
    ----------
    tolerance : float
        Imbalance relative to the forces.
    most_iterations : int, optional
        Iterations in all, by default as many as the updates take.
    """
    failed = _newton(model, thetas, load, start, tolerance, most_iterations)
    if not failed.reason or not load.law.friction > 0.0:
        return failed
    displacements, n_iterations = failed.displacements, failed.n_iterations
    # Updates of fixed friction limits before a position counts as unreachable. Few if points cycle; many if
    # a part of the contact opens and the tissue slides.
    for _ in range(60):
        held = model.contact.held(displacements, load)
        left = None if most_iterations is None else most_iterations - n_iterations
        balance = _newton(model, thetas, held, Start(displacements), tolerance, left)
        n_iterations += balance.n_iterations
        if balance.reason:
            break
        displacements = balance.displacements
        # Accepted imbalance, in tolerances, if Newton's method finds no balance because of friction.
        if model.forces(displacements, thetas).residual(load).relative <= 10.0 * tolerance:
            return Balance(displacements, n_iterations, "", held=True)
    return Balance(failed.displacements, n_iterations, failed.reason)


def _newton(
    model: Model,
    thetas: Mapping[str, FloatArray],
    load: ContactState,
    start: Start,
    tolerance: float,
    most_iterations: int | None,
) -> Balance:
    most = MOST_ITERATIONS if most_iterations is None else min(MOST_ITERATIONS, most_iterations)
    displacements = start.displacements
    residual = start.residual or model.forces(displacements, thetas).residual(load)
    for iteration in range(most):
        if not np.isfinite(residual.free).all() or residual.least_jacobian <= 0.0:
            return Balance(displacements, iteration, "inverted element")
        if residual.relative <= tolerance:
            return Balance(displacements, iteration, "")
        # The imbalance below which the body's tangent of the iteration before serves once more.
        nearly = iteration > 0 and residual.relative <= min(100.0 * tolerance, 1e-2)
        here = model.linearised(displacements, thetas, nearly=nearly)
        try:
            step = model.linear.solve(
                here.matrix(load),
                partial(here.preconditioner, load),
                -residual.free,
                # What keeps Newton's convergence and ends within tolerance.
                float(np.clip(0.1 * residual.relative, 0.1 * tolerance / residual.relative, 0.03)),
            )
        except np.linalg.LinAlgError as error:
            return Balance(displacements, iteration, str(error))
        moved = _line_search(model, thetas, load, displacements, step, residual)
        if moved is None:
            return Balance(displacements, iteration, "no step reduces the imbalance or an element inverts")
        displacements, residual = moved
    if residual.relative <= tolerance:
        return Balance(displacements, most, "")
    return Balance(displacements, most, f"no balance after {most} iterations")


def _line_search(
    model: Model,
    thetas: Mapping[str, FloatArray],
    load: ContactState,
    start: FloatArray,
    step: FloatArray,
    before: Residual,
) -> tuple[FloatArray, Residual] | None:
    """Length of the step at which the imbalance has no component along it.

    r·d is the slope of the energy if there is one. A full step is
    used if it reduces the imbalance; otherwise the root of the slope is
    bracketed and found by regula falsi, which ends the cycles of points
    that go in and out of contact.
    """

    def at(length: float) -> tuple[FloatArray, Residual, float]:
        moved = model.moved(start, length * step, load)
        residual = model.forces(moved, thetas).residual(load)
        return moved, residual, float(residual.free @ step)

    if load.limits is not None and before.free @ step > 0.0:
        step = -step  # up the potential, towards a saddle
    slope, reference = float(before.free @ step), float(np.linalg.norm(before.free))
    length, low, low_slope, high = 1.0, 0.0, slope, 1.0
    best, smallest = None, np.inf
    for _ in range(8):
        moved, residual, pull = at(length)
        if not np.isfinite(pull) or residual.least_jacobian <= 0.0:
            high, length = length, 0.5 * (low + length)
            continue
        size = float(np.linalg.norm(residual.free))
        if size < smallest:
            best, smallest = (moved, residual), size
        tame = size < MOST_GROWTH * reference
        full_step_pays = length == 1.0 and (size < 0.7 * reference or pull * slope > 0.0)
        if tame and (full_step_pays or abs(pull) < 0.3 * abs(slope)):
            return moved, residual
        if tame and pull * slope > 0.0:
            low, low_slope, length = length, pull, 0.5 * (length + high)
        else:
            high = length
            length = low + (high - low) * float(np.clip(low_slope / (low_slope - pull), 0.1, 0.9))
    return best if smallest < MOST_GROWTH * reference else None
