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

from collections.abc import Mapping, Sequence
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
        penalty: float = 0.0,
        friction: float = 0.0,
        motion: Velocity | None = None,
    ) -> Change:
        """Rates at all points, if the nodes move by ``moved`` (n_nodes, 3) and the indenter by ``motion``."""
        at_points = self._model.contact.at_points(moved)
        if motion is not None:
            at_points = at_points - self._with_indenter(self._every, motion)
        return Change(at_points @ self._turn, anchors, penalty, friction)

    def _with_indenter(self, positions: FloatArray, motion: Velocity) -> FloatArray:
        """Velocities (n, 3) of points that move with the indenter."""
        return np.asarray(np.cross(motion.spin, positions - self._load.pose.tip) + motion.tip)

    def force(self, change: Change, motion: Velocity | None = None) -> FloatArray:
        """Change of the nodal forces (n_nodes, 3)."""
        traction, _ = self.touched.points.rates(change.of(self.touched.where))
        return self._model.contact.to_nodes(self.touched, self._turned(traction, motion))

    def _turned(self, traction: FloatArray, motion: Velocity | None) -> FloatArray:
        """Rates (k, 3) of tractions in the limb's frame, from those in the indenter's."""
        rate = traction @ self._turn.T
        if motion is not None:
            rate = rate + np.cross(motion.spin, self.touched.points.traction @ self._turn.T)
        return np.asarray(rate)

    def answer(
        self,
        change: Change,
        moved: FloatArray,
        motion: Velocity | None = None,
        body: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Change of force and moment (3,), as in ``Answer``, and of the friction (k, 3) of the contact.

        Nodes move by ``moved`` (n_nodes, 3); ``body`` (n_nodes, 3), if given, is the change of the internal
        forces where no node moves.
        """
        at = change.of(self.touched.where)
        traction, friction = self.touched.points.rates(at)
        d_loads, d_arms = self._areas * self._turned(traction, motion), at.positions @ self._turn.T
        if motion is not None:
            d_arms = d_arms + self._with_indenter(self._arms, motion)
        moments = np.cross(d_arms, self._loads) + np.cross(self._arms, d_loads)
        force, moment = -d_loads.sum(axis=0), moments.sum(axis=0)
        if self._model.bonded.size:
            pull, turn = self._of_bonded(moved, body)
            force, moment = force + pull, moment + turn
        return force, moment, friction

    def at_rest(self) -> Answer:
        """Force and moment at the state itself."""
        return self._model.answer(self._displacements, self._thetas, self._load)

    def carried(self, moved: FloatArray, motion: Velocity) -> FloatArray:
        """Rates of all nodes; the bonded nodes move with the indenter."""
        model, result = self._model, moved.copy()
        places = (model.points + self._displacements)[model.bonded]
        result[model.bonded] = self._with_indenter(places, motion)
        return result

    def _of_bonded(self, moved: FloatArray, body: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Change of force and moment (3,) by the bonded nodes."""
        model, size = self._model, float(np.abs(moved).max())
        pulls = np.zeros((model.bonded.size, 3)) if body is None else body[model.bonded].copy()
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


def _motions(at: FloatArray, ways: FloatArray) -> list[Velocity | None]:
    """The indenter's velocity at a position (6,) by each of its rates (k, 6); None where it stays."""
    return [motion(at, way) if way.any() else None for way in ways]


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
        # With this residual of the linear systems the slopes err by less than by a state that is not exact.
        self._accuracy = max(0.2 * tolerance, 1e-8)
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
        external = [rates.force(change) for change in self._changes(rates, held, [None] * len(held))]
        rhs = np.stack([model.free(e - b) for e, b in zip(external, body, strict=True)])
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

    def _changes(self, rates: Rates, moved: FloatArray, motions: Sequence[Velocity | None]) -> list[Change]:
        """Rates at all points for each parameter, if nodes and indenter move by rows of these."""
        rows = zip(moved, self._anchors, self._penalty, self._friction, motions, strict=True)
        return [rates.change(u, a, float(e), float(f), m) for u, a, e, f, m in rows]

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
        motions = _motions(at, position)
        units = [motion(at, way) for way in np.eye(6)[free]]
        dragged = [0.0 if each is None else here.rate(load, each) for each in motions]
        pulled = [-here.rate(load, each) for each in units]
        rhs = np.stack([*(r - d for r, d in zip(rhs, dragged, strict=True)), *pulled])
        solved = self._solved(here, load, rhs)
        n = len(self._names)
        moved = np.stack([rates.carried(u, m) if m else u for u, m in zip(solved[:n], motions, strict=True)])
        with_free = [rates.carried(u, m) for u, m in zip(solved[n:], units, strict=True)]
        if free.size:
            none = np.zeros_like(self._anchors[0])
            found = self._loads_rates(rates, moved, self._changes(rates, moved, motions), position, at, body)
            changes = [rates.change(u, none, motion=m) for u, m in zip(with_free, units, strict=True)]
            by_free = self._loads_rates(rates, np.stack(with_free), changes, np.eye(6)[free], at)
            try:
                steps = np.linalg.solve(by_free[:, free].T, (loads - found)[:, free].T).T
            except np.linalg.LinAlgError:
                steps = np.full((n, free.size), np.nan)
            moved = moved + np.einsum("kj,jni->kni", steps, np.stack(with_free))
            position[:, free] = steps
        self._moved, self._position = moved, position

    def _loads_rates(
        self,
        rates: Rates,
        moved: FloatArray,
        changes: Sequence[Change],
        position: FloatArray,
        at: FloatArray,
        body: FloatArray | None = None,
    ) -> FloatArray:
        """Change of the loads (k, 6) as nodes, points and the indenter's position (k, 6) change."""
        answer = rates.at_rest()
        force, moment = np.zeros((2, len(moved), 3))
        for k, change in enumerate(changes):
            internal = None if body is None else body[k]
            force[k], moment[k], _ = rates.answer(change, moved[k], motion(at, position[k]), internal)
        return wrench_rates(force, moment, answer, tip_at(at), position)

    def _follow(self, rates: Rates, load: ContactState, body: FloatArray, reached: Aim | None) -> None:
        """Store the derivatives of force, moment and anchors; compare ``Contact.remember``."""
        where = rates.touched.where
        slip = rates.touched.points.friction / load.law.penalty
        force, moment = np.zeros((2, len(self._names), 3))
        motions = [None] * len(force) if reached is None else _motions(reached.position, self._position)
        for k, change in enumerate(self._changes(rates, self._moved, motions)):
            force[k], moment[k], friction = rates.answer(change, self._moved[k], motions[k], body[k])
            anchors = change.positions.copy()
            anchors[where] -= (friction - change.penalty * slip) / load.law.penalty
            self._anchors[k] = anchors
        if reached is not None:
            self._loads = wrench_rates(force, moment, rates.at_rest(), load.pose.tip, self._position)
        self.slopes = Slopes(self._names, force, moment, self._position)
