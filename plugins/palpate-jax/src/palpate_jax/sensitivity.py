"""Exact derivatives of force and moment in the materials' parameters, the friction and the contact.

Direct differentiation along the path. An equilibrium state satisfies r(u, a, θ) = 0 with the
anchors a of the contact; its derivative is one linear system per parameter,

    K du = −∂f_body/∂θ + ∂f_contact/∂a da + ∂f_contact/∂ε dε + ∂f_contact/∂μ dμ,

with the exact tangent K, and the new anchors' derivative follows from du as the
anchors follow from u. So da is the history of the derivative. Stresses that relax have
one of the same kind (:mod:`palpate_jax.viscoelasticity`). The
penalty ε counts too: it is proportional to the initial shear modulus of the touched
region, and its reciprocal is one of the parameters. Another is the depth of the press: the
prescribed position changes with it, and the right-hand side has what this motion of the
indenter adds. (Kleiber, Antúnez, Hien & Kowalczyk, Parameter Sensitivity in Nonlinear
Mechanics, 1997, treat path dependence in this way.)

Where a point just begins to touch or to slide, the response has a kink; the
derivative is one-sided, on the side of the state.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import jax
import numpy as np

from palpate.api import COMPLIANCE, DEEPER, FRICTION, FloatArray, Material, ParameterName
from palpate.api.mechanics import Array, moduli_at_rest
from palpate_jax.contact import Answer, Change, ContactLaw, ContactState, Velocity
from palpate_jax.model import Linearised, Model
from palpate_jax.schedule import Aim, motion, tip_at, wrench_rates


class Rates:
    """Rates at one state of a model.

    Parameters
    ----------
    displacements : (n_nodes, 3) array
    """

    def __init__(
        self, model: Model, displacements: FloatArray, load: ContactState, thetas: Mapping[str, FloatArray]
    ) -> None:
        self._model, self._displacements, self._load, self._thetas = model, displacements, load, thetas
        self.touched = model.contact.touched(displacements, load)
        self._turn, where = load.pose.rotation, self.touched.where
        self._every = model.contact.positions(displacements)
        self._arms = self._every[where]
        self._areas = model.contact.areas[where, None]
        self._loads = self._areas * (self.touched.points.traction @ self._turn.T)

    def change(
        self,
        moved: FloatArray,
        anchors: FloatArray,
        penalty: float | FloatArray = 0.0,
        friction: float | FloatArray = 0.0,
        motion: Velocity | None = None,
    ) -> Change:
        """Rates at all points, if nodes move by ``moved`` (..., n_nodes, 3) and the indenter by ``motion``.

        The points are in ``anchors`` (..., n, 3), ``penalty`` and ``friction`` of shape (...).
        """
        at_points = self._model.contact.at_points(moved)
        if motion is not None:
            at_points = at_points - self._with_indenter(self._every, motion)
        law = (np.asarray(each)[..., None] for each in (penalty, friction))
        return Change(at_points @ self._turn, anchors, *law)

    def _with_indenter(self, positions: FloatArray, motion: Velocity) -> FloatArray:
        """Velocities (..., n, 3) of points (n, 3) that move with the indenter."""
        arms, spin = positions - self._load.pose.tip, motion.spin[..., None, :]
        return np.asarray(np.cross(spin, arms) + motion.tip[..., None, :])

    def forces(self, change: Change) -> FloatArray:
        """Changes of the nodal forces (m, n_nodes, 3), where the indenter stays."""
        tractions, _ = self.touched.points.rates(change.of(self.touched.where))
        in_limb = tractions @ self._turn.T
        return np.stack([self._model.contact.to_nodes(self.touched, each) for each in in_limb])

    def _turned(self, traction: FloatArray, motion: Velocity | None) -> FloatArray:
        """Rates (..., k, 3) of tractions in the limb's frame, from those in the indenter's."""
        rate = traction @ self._turn.T
        if motion is not None:
            rate = rate + np.cross(motion.spin[..., None, :], self.touched.points.traction @ self._turn.T)
        return np.asarray(rate)

    def answer(
        self,
        change: Change,
        moved: FloatArray,
        motion: Velocity | None = None,
        body: FloatArray | float = 0.0,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Changes of force and moment (..., 3), as in ``Answer``, and of the contact's friction (..., k, 3).

        Nodes move by ``moved`` (..., n_nodes, 3); ``body`` of this shape is the change of the internal forces
        where no node moves.
        """
        traction, friction = self.touched.points.rates(change.of(self.touched.where))
        d_loads = self._areas * self._turned(traction, motion)
        d_arms = self._model.contact.at_points(moved)[..., self.touched.where, :]
        moments = np.cross(d_arms, self._loads) + np.cross(self._arms, d_loads)
        force, moment = -d_loads.sum(axis=-2), moments.sum(axis=-2)
        if self._model.bonded.size:
            of, shape = np.broadcast_to(body, moved.shape), (-1, *moved.shape[-2:])
            rows = zip(moved.reshape(shape), of.reshape(shape), strict=True)
            bonded = np.array([self._of_bonded(*row) for row in rows])
            force = force + bonded[:, 0].reshape(force.shape)
            moment = moment + bonded[:, 1].reshape(force.shape)
        return force, moment, friction

    def at_rest(self) -> Answer:
        """Force and moment at the state itself."""
        return self._model.answer(self._displacements, self._thetas, self._load)

    def carried(self, moved: FloatArray, motion: Velocity) -> FloatArray:
        """Rates (..., n_nodes, 3) of all nodes; the bonded nodes move with the indenter."""
        model, result = self._model, moved.copy()
        places = (model.points + self._displacements)[model.bonded]
        result[..., model.bonded, :] = self._with_indenter(places, motion)
        return result

    def _of_bonded(self, moved: FloatArray, body: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Change of force and moment (3,) by the bonded nodes."""
        model, size = self._model, float(np.abs(moved).max())
        pulls = body[model.bonded]
        if size > 0.0:
            # Largest displacement of the central difference for the forces of the bonded nodes.
            probe = 1e-5 / size
            ahead, _ = model.body.force(self._displacements + probe * moved, self._thetas)
            behind, _ = model.body.force(self._displacements - probe * moved, self._thetas)
            pulls += (ahead - behind)[model.bonded] / (2.0 * probe)
        moment = np.cross((model.points + self._displacements)[model.bonded], pulls).sum(axis=0)
        if moved[model.bonded].any():
            held, _ = model.body.force(self._displacements, self._thetas)
            moment = moment + np.cross(moved[model.bonded], held[model.bonded]).sum(axis=0)
        return -pulls.sum(axis=0), moment


@dataclass(frozen=True, slots=True, eq=False)
class Slopes:
    """Derivatives of an equilibrium state's force and moment.

    Parameters
    ----------
    names : tuple of m str
        ``region.parameter`` of each parameter, then ``friction``, ``contact_compliance``, and perhaps
        ``depth_mm``.
    force_N, moment_Nmm : (m, 3) array
        As in :class:`palpate_jax.contact.Answer`, per unit of the parameter; NaN from the first state with a
        singular tangent on.
    position : (m, 6) array
        Of the indenter, where a load moves it, or the press is deeper.
    """

    names: tuple[str, ...]
    force_N: FloatArray
    moment_Nmm: FloatArray
    position: FloatArray

    @property
    def finite(self) -> bool:
        """Whether every derivative is a number."""
        return bool(np.isfinite(np.hstack([self.force_N, self.moment_Nmm, self.position])).all())


@partial(jax.jit, static_argnums=0)
def _shear_modulus_slopes(material: Material, theta: Array) -> tuple[Array, Array]:
    return jax.value_and_grad(lambda t: moduli_at_rest(material, t)[0])(theta)


def _motions(at: FloatArray, ways: FloatArray) -> Velocity | None:
    """The indenter's velocities (k, 3) at a position (6,) by its rates (k, 6); None where it always stays."""
    if not ways.any():
        return None
    each = [motion(at, way) for way in ways]
    return Velocity(np.array([m.tip for m in each]), np.array([m.spin for m in each]))


class Sensitivity:
    """Sensitivities along load stepping: an observer of its equilibrium states.

    Parameters
    ----------
    contact_penalty : float
        Factor of the protocol that the law's penalty has.
    tolerance : float
        Imbalance relative to the forces at which a point counts as balanced.
    penalty_per_mm : float, optional
        Derivative of the law's penalty in the depth of the press, in which there are slopes then.

    Attributes
    ----------
    slopes : Slopes
        At the last equilibrium state.
    """

    def __init__(
        self,
        model: Model,
        materials: Mapping[str, Material],
        thetas: Mapping[str, FloatArray],
        law: ContactLaw,
        contact_penalty: float,
        tolerance: float,
        penalty_per_mm: float | None = None,
    ) -> None:
        # Residual of the linear systems. At 2e-4 slopes in moduli err by up to 1e-3 of the largest, in the
        # contact's compliance by 5e-3, in the depth by 2e-2.
        self._accuracy = min(max(2.0 * tolerance, 1e-8), 2e-4)
        own = [(region, k, p.name) for region in thetas for k, p in enumerate(materials[region].parameters)]
        self._names = (*(str(ParameterName(region, name)) for region, _, name in own), FRICTION, COMPLIANCE)
        self._names += () if penalty_per_mm is None else (DEEPER,)
        self._model, self._law = model, law
        n = len(self._names)
        self._friction = np.eye(n)[self._names.index(FRICTION)]
        modulus, slopes = _shear_modulus_slopes(
            materials[model.touched_region], np.asarray(thetas[model.touched_region], dtype=np.float64)
        )
        shares = np.asarray(slopes) / float(modulus)
        rates = [law.penalty * shares[k] if region == model.touched_region else 0.0 for region, k, _ in own]
        by_depth = [] if penalty_per_mm is None else [penalty_per_mm]
        self._penalty = np.array([*rates, 0.0, -law.penalty * contact_penalty, *by_depth])
        self._moved = np.zeros((n, *model.points.shape))
        n_points = len(model.contact.positions(model.rest()))
        self._anchors = np.zeros((n, n_points, 3))
        self._position, self._loads = np.zeros((n, 6)), np.zeros((n, 6))
        self._histories = model.body.at_rest(n)
        self.slopes = Slopes(self._names, np.zeros((n, 3)), np.zeros((n, 3)), self._position)

    def start(self) -> None:
        """Begin a load step: what it keeps of position and loads is kept of those here."""
        self._origin = self._position, self._loads

    def balanced(
        self,
        displacements: FloatArray,
        load: ContactState,
        thetas: Mapping[str, FloatArray],
        reached: Aim | None = None,
    ) -> None:
        """Advance the derivatives from the last equilibrium state to this one.

        Parameters
        ----------
        thetas : mapping of region to array
            Materials in the load step.
        reached : Aim, optional
            What was prescribed, with the position that was found; given where positions have slopes.
        """
        if not self.slopes.finite:
            return
        model = self._model
        here = model.linearised(displacements, thetas)
        rates = Rates(model, displacements, load, thetas)
        body = self._body_rates(displacements, thetas)
        held = np.zeros_like(self._moved)
        rhs = np.stack([model.free(each) for each in rates.forces(self._change(rates, held)) - body])
        if reached is None:
            self._moved = self._solved(here, load, rhs)
        else:
            self._controlled(here, load, rates, rhs, body, reached)
        self._follow(rates, load, body, reached)
        if self.slopes.finite:
            moved, histories = self._moved, self._histories
            self._histories = model.body.slopes_after(displacements, thetas, histories, moved)

    def _body_rates(self, displacements: FloatArray, thetas: Mapping[str, FloatArray]) -> FloatArray:
        """∂f_body/∂θ (m, n_nodes, 3) with the history's part; that alone for friction and contact."""
        body, rates = self._model.body, self._model.body.rates(displacements, thetas)
        n = self._names.index(FRICTION)
        found = np.concatenate([*(rates[region] for region in thetas), np.zeros_like(self._moved[n:])])
        body.add_rates_of_history(displacements, thetas, self._histories, found)
        return found

    def _change(self, rates: Rates, moved: FloatArray, motions: Velocity | None = None) -> Change:
        """Rates at all points for each parameter, if nodes and indenter move by rows of these."""
        return rates.change(moved, self._anchors, self._penalty, self._friction, motions)

    def _solved(self, here: Linearised, load: ContactState, rhs: FloatArray) -> FloatArray:
        """Solutions (m, n_nodes, 3) of right-hand sides (m, n)."""
        model, moved = self._model, np.zeros((len(rhs), *self._model.points.shape))
        try:
            steps = model.linear.solve_all(
                here.matrix(load), partial(here.preconditioner, load), rhs, self._accuracy
            )
        except np.linalg.LinAlgError:
            return np.full_like(moved, np.nan)
        return np.stack([model.straight(u, step) for u, step in zip(moved, steps, strict=True)])

    def _controlled(
        self,
        here: Linearised,
        load: ContactState,
        rates: Rates,
        rhs: FloatArray,
        body: FloatArray,
        reached: Aim,
    ) -> None:
        """Solve where positions change with the parameters too: with loads, and with the depth of a press.

        At given positions first; then the free components move so that the loads change as prescribed.
        """
        position, loads = reached.kept_position * self._origin[0], reached.kept_loads * self._origin[1]
        free, at = reached.free, reached.position
        if DEEPER in self._names:
            position[self._names.index(DEEPER)] += reached.deeper
        position[:, free] = 0.0
        ways, n = np.eye(6)[free], len(self._names)
        motions, by_ways = _motions(at, position), _motions(at, ways)
        dragged = [here.rate(load, motion(at, way)) if way.any() else 0.0 for way in position]
        pulled = [-here.rate(load, motion(at, way)) for way in ways]
        solved = self._solved(here, load, np.stack([*(rhs[k] - dragged[k] for k in range(n)), *pulled]))
        moved = solved[:n] if motions is None else rates.carried(solved[:n], motions)
        if by_ways is not None:
            with_free = rates.carried(solved[n:], by_ways)
            found = self._loads_rates(rates, moved, self._change(rates, moved, motions), position, at, body)
            change = rates.change(with_free, np.zeros((free.size, *self._anchors.shape[1:])), motion=by_ways)
            by_free = self._loads_rates(rates, with_free, change, ways, at)
            try:
                steps = np.linalg.solve(by_free[:, free].T, (loads - found)[:, free].T).T
            except np.linalg.LinAlgError:
                steps = np.full((n, free.size), np.nan)
            moved = moved + np.einsum("kj,jni->kni", steps, with_free)
            position[:, free] = steps
        self._moved, self._position = moved, position

    def _loads_rates(
        self,
        rates: Rates,
        moved: FloatArray,
        change: Change,
        position: FloatArray,
        at: FloatArray,
        body: FloatArray | float = 0.0,
    ) -> FloatArray:
        """Change of the loads (k, 6) as nodes, points and the indenter's position (k, 6) change."""
        force, moment, _ = rates.answer(change, moved, _motions(at, position), body)
        return wrench_rates(force, moment, rates.at_rest(), tip_at(at), position)

    def _follow(self, rates: Rates, load: ContactState, body: FloatArray, reached: Aim | None) -> None:
        """Store the derivatives of force, moment and anchors; compare ``Contact.remember``."""
        slip = rates.touched.points.friction / load.law.penalty
        motions = None if reached is None else _motions(reached.position, self._position)
        change = self._change(rates, self._moved, motions)
        force, moment, friction = rates.answer(change, self._moved, motions, body)
        slipped = (friction - self._penalty[:, None, None] * slip) / load.law.penalty
        self._anchors = change.positions
        self._anchors[:, rates.touched.where] -= slipped
        if reached is not None:
            self._loads = wrench_rates(force, moment, rates.at_rest(), load.pose.tip, self._position)
        self.slopes = Slopes(self._names, force, moment, self._position)
