"""Rates of the tractions at an equilibrium state, as nodes, history, law and indenter change."""

from collections.abc import Mapping

import numpy as np

from palpate.api import FloatArray
from palpate_jax.contact import Answer, Change, ContactState, Motion
from palpate_jax.model import Model

PROBE_MM = 1e-5
"""Largest displacement of the central difference for the forces of the bonded nodes."""


class Rates:
    """Rates at one state of a model.

    Parameters
    ----------
    displacements : (n_nodes, 3) array
    """

    def __init__(self, model: Model, displacements: FloatArray, load: ContactState) -> None:
        self._model, self._displacements, self._load = model, displacements, load
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
        motion: Motion | None = None,
    ) -> Change:
        """Rates at all points, if the nodes move by ``moved`` (n_nodes, 3) and the indenter by ``motion``."""
        at_points = self._model.contact.at_points(moved)
        if motion is not None:
            at_points = at_points - self._with_indenter(self._every, motion)
        return Change(at_points @ self._turn, anchors, penalty, friction)

    def _with_indenter(self, positions: FloatArray, motion: Motion) -> FloatArray:
        """Velocities (n, 3) of points that move with the indenter."""
        return np.asarray(np.cross(motion.spin, positions - self._load.pose.tip) + motion.tip)

    def force(self, change: Change, motion: Motion | None = None) -> FloatArray:
        """Change of the nodal forces (n_nodes, 3)."""
        traction, _ = self.touched.points.rates(change.of(self.touched.where))
        return self._model.contact.to_nodes(self.touched, self._turned(traction, motion))

    def _turned(self, traction: FloatArray, motion: Motion | None) -> FloatArray:
        """Rates (k, 3) of tractions in the limb's frame, from those in the indenter's."""
        rate = traction @ self._turn.T
        if motion is not None:
            rate = rate + np.cross(motion.spin, self.touched.points.traction @ self._turn.T)
        return np.asarray(rate)

    def answer(
        self, change: Change, motion: Motion | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Change of force and moment (3,) of the contact, as in ``Answer``, and of the friction (k, 3)."""
        at = change.of(self.touched.where)
        traction, friction = self.touched.points.rates(at)
        d_loads, d_arms = self._areas * self._turned(traction, motion), at.positions @ self._turn.T
        if motion is not None:
            d_arms = d_arms + self._with_indenter(self._arms, motion)
        moment = np.cross(d_arms, self._loads) + np.cross(self._arms, d_loads)
        return -d_loads.sum(axis=0), moment.sum(axis=0), friction

    def at_rest(self, thetas: Mapping[str, FloatArray]) -> Answer:
        """Force and moment at the state itself."""
        return self._model.answer(self._displacements, thetas, self._load)

    def carried(self, moved: FloatArray, motion: Motion) -> FloatArray:
        """Rates of the nodes with those of the bonded ones, which move with the indenter."""
        model, result = self._model, moved.copy()
        places = (model.points + self._displacements)[model.bonded]
        result[model.bonded] = self._with_indenter(places, motion)
        return result

    def of_bonded(
        self, thetas: Mapping[str, FloatArray], moved: FloatArray, body: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Change of force and moment (3,) by the bonded nodes, as nodes move by ``moved`` (n_nodes, 3).

        ``body`` (n_nodes, 3), if given, is the change of the internal forces where no node moves.
        """
        model, size = self._model, float(np.abs(moved).max())
        pulls = np.zeros((model.bonded.size, 3)) if body is None else body[model.bonded].copy()
        if size > 0.0:
            probe = PROBE_MM / size
            ahead, _ = model.body.force(self._displacements + probe * moved, thetas)
            behind, _ = model.body.force(self._displacements - probe * moved, thetas)
            pulls += (ahead - behind)[model.bonded] / (2.0 * probe)
        moment = np.cross((model.points + self._displacements)[model.bonded], pulls).sum(axis=0)
        if moved[model.bonded].any():
            held, _ = model.body.force(self._displacements, thetas)
            moment = moment + np.cross(moved[model.bonded], held[model.bonded]).sum(axis=0)
        return -pulls.sum(axis=0), moment
