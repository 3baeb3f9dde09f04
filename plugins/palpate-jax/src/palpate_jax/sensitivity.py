"""Exact derivatives of force and moment in the materials' parameters and in the friction.

Direct differentiation along the path. A balanced state satisfies r(u, a, θ) = 0 with the
anchors a of the contact; its derivative is one linear system per parameter,

    K du = −∂f_body/∂θ + ∂f_contact/∂a da + ∂f_contact/∂ε dε + ∂f_contact/∂μ dμ,

with the exact tangent K, and the new anchors' derivative follows from du as the
anchors follow from u. So da is the history of the derivative. The
penalty ε counts too: it is proportional to the initial shear modulus of the touched
region. (Kleiber, Antúnez, Hien & Kowalczyk, Parameter Sensitivity in Nonlinear
Mechanics, 1997, treat path dependence in this way.)

Where a point just begins to touch or to slide, the response has a kink; the
derivative is one-sided, on the side of the state.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import jax
import numpy as np

from palpate.api import Array, FloatArray, Material
from palpate.mechanics import moduli_at_rest
from palpate_jax.contact import Change, ContactLaw, ContactState, Touched
from palpate_jax.model import Linearised, Model

ACCURACY = 1e-8
"""Residual, relative to the right-hand side, of the linear systems."""

PROBE_MM = 1e-5
"""Largest displacement of the central difference for the forces of the bonded nodes."""

FRICTION = "friction"
"""Name of the friction coefficient among the parameters."""


@dataclass(frozen=True, slots=True, eq=False)
class Slopes:
    """Derivatives of a balanced state's force and moment.

    Parameters
    ----------
    names : tuple of m str
        ``region.parameter`` of each parameter, then ``friction``.
    force_N, moment_Nmm : (m, 3) array
        As in :class:`palpate_jax.contact.Answer`, per unit of the parameter; NaN from the first state with a
        singular tangent on.
    """

    names: tuple[str, ...]
    force_N: FloatArray
    moment_Nmm: FloatArray

    @property
    def finite(self) -> bool:
        """Whether every derivative is a number."""
        return bool(np.isfinite([self.force_N, self.moment_Nmm]).all())


@partial(jax.jit, static_argnums=0)
def _shear_modulus_slopes(material: Material, theta: Array) -> tuple[Array, Array]:
    return jax.value_and_grad(lambda t: moduli_at_rest(material, t)[0])(theta)


class Sensitivity:
    """Sensitivities along load stepping: an observer of its balanced states.

    Parameters
    ----------
    model : Model
    materials : mapping of region to Material
    thetas : mapping of region to parameters
    law : ContactLaw

    Attributes
    ----------
    slopes : Slopes
        At the last balanced state.
    """

    def __init__(
        self,
        model: Model,
        materials: Mapping[str, Material],
        thetas: Mapping[str, FloatArray],
        law: ContactLaw,
    ) -> None:
        own = [(region, k, p.name) for region in thetas for k, p in enumerate(materials[region].parameters)]
        self._names = (*(f"{region}.{name}" for region, _, name in own), FRICTION)
        self._model, self._thetas, self._law = model, thetas, law
        n = len(self._names)
        self._friction = np.eye(n)[-1]
        modulus, slopes = _shear_modulus_slopes(
            materials[model.touched_region], np.asarray(thetas[model.touched_region], dtype=np.float64)
        )
        shares = np.asarray(slopes) / float(modulus)
        rates = [law.penalty * shares[k] if region == model.touched_region else 0.0 for region, k, _ in own]
        self._penalty = np.array([*rates, 0.0])
        self._moved = np.zeros((n, *model.points.shape))
        n_points = len(model.contact.positions(model.rest()))
        self._anchors = np.zeros((n, n_points, 3))
        self.slopes = Slopes(self._names, np.zeros((n, 3)), np.zeros((n, 3)))

    def balanced(self, displacements: FloatArray, load: ContactState) -> None:
        """Advance the derivatives from the last balanced state to this one."""
        if not self.slopes.finite:
            return
        model = self._model
        here = model.linearised(displacements, self._thetas)
        touched = model.contact.touched(displacements, load)
        body = self._body_rates(displacements)
        held = np.zeros_like(self._moved)
        external = [self._force_rate(touched, load, change) for change in self._changes(held, load)]
        rhs = np.stack([model.free(e - b) for e, b in zip(external, body, strict=True)])
        self._moved = self._solved(here, load, rhs)
        self._follow(displacements, load, touched, body)

    def _body_rates(self, displacements: FloatArray) -> FloatArray:
        """∂f_body/∂θ (m, n_nodes, 3), none for the friction."""
        rates = self._model.body.rates(displacements, self._thetas)
        return np.concatenate([*(rates[region] for region in self._thetas), np.zeros_like(self._moved[:1])])

    def _changes(self, moved: FloatArray, load: ContactState) -> list[Change]:
        """Rates at all points for each parameter, if the nodes move by rows of ``moved``."""
        contact, turn = self._model.contact, load.pose.rotation
        rows = zip(moved, self._anchors, self._penalty, self._friction, strict=True)
        return [Change(contact.at_points(u) @ turn, a, float(e), float(f)) for u, a, e, f in rows]

    def _force_rate(self, touched: Touched, load: ContactState, change: Change) -> FloatArray:
        traction, _ = touched.points.rates(change.of(touched.where))
        return self._model.contact.to_nodes(touched, traction @ load.pose.rotation.T)

    def _solved(self, here: Linearised, load: ContactState, rhs: FloatArray) -> FloatArray:
        """Solutions (m, n_nodes, 3) of right-hand sides (m, n)."""
        model, moved = self._model, np.zeros_like(self._moved)
        try:
            steps = model.linear.solve_all(here.matrix(load), here.preconditioner(load), rhs, ACCURACY)
        except np.linalg.LinAlgError:
            return np.full_like(moved, np.nan)
        return np.stack([model.straight(u, step) for u, step in zip(moved, steps, strict=True)])

    def _follow(
        self, displacements: FloatArray, load: ContactState, touched: Touched, body: FloatArray
    ) -> None:
        """Store the derivatives of force, moment and anchors; compare ``Contact.remember``."""
        model, turn, where = self._model, load.pose.rotation, touched.where
        arms = model.contact.positions(displacements)[where]
        areas = model.contact.areas[where, None]
        loads = areas * (touched.points.traction @ turn.T)
        slip = touched.points.friction / load.law.penalty
        force, moment = np.zeros((2, len(self._names), 3))
        for k, change in enumerate(self._changes(self._moved, load)):
            at = change.of(where)
            traction, friction = touched.points.rates(at)
            d_loads, d_arms = areas * (traction @ turn.T), at.positions @ turn.T
            force[k] = -d_loads.sum(axis=0)
            moment[k] = (np.cross(d_arms, loads) + np.cross(arms, d_loads)).sum(axis=0)
            anchors = change.positions.copy()
            anchors[where] -= (friction - change.penalty * slip) / load.law.penalty
            self._anchors[k] = anchors
        if model.bonded.size:
            pulls = self._pull_rates(displacements, body)
            force -= pulls.sum(axis=1)
            moment += np.cross((model.points + displacements)[model.bonded], pulls).sum(axis=1)
        self.slopes = Slopes(self._names, force, moment)

    def _pull_rates(self, displacements: FloatArray, body: FloatArray) -> FloatArray:
        """Derivative (m, n_bonded, 3) of the internal forces at the bonded nodes."""
        model, rates = self._model, body[:, self._model.bonded].copy()
        for rate, moved in zip(rates, self._moved, strict=True):
            size = np.abs(moved).max()
            if size == 0.0:
                continue
            probe = PROBE_MM / size
            ahead, _ = model.body.force(displacements + probe * moved, self._thetas)
            behind, _ = model.body.force(displacements - probe * moved, self._thetas)
            rate += (ahead - behind)[model.bonded] / (2.0 * probe)
        return rates
