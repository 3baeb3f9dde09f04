"""Contact of the limb with a rigid indenter: penalty, and Coulomb friction with history.

At every quadrature point of the contact faces, with signed distance d to the
indenter and normal n = ∇d:

* normal pressure p = ε ⟨−d⟩ per reference area;
* tangential traction t = ε s, where s is the tangential distance from the
  point's anchor, returned to the Coulomb cone |t| ≤ μ p (return mapping).

The anchor is in the indenter's frame, so it turns with the indenter; it is stored from
step to step until slip moves it. This history makes the torque of a twist independent
of the number of steps. A point that touches for the first time is anchored where its
path within the step crossed the surface.

All positions, anchors and derivatives of this module are in the indenter's frame;
the results of a :class:`Contact` are in the limb's.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from palpate.api import BoolArray, FloatArray, Indenter, IntArray, Mesh
from palpate_jax.contact_surface import ContactSurface, contact_surfaces

NEAR = 0.5
"""Distance from the indenter [mm] within which a node is assumed to slide along it."""

LEAST_GAP = 1e-12
"""Smallest distance [mm] of a point that has not touched."""


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Pose of the indenter: its lowest point (3,) [mm] and its rotation matrix (3, 3)."""

    tip: FloatArray
    rotation: FloatArray

    def into(self, points: FloatArray) -> FloatArray:
        """Points (n, 3) of the limb's frame, in the indenter's."""
        return (points - self.tip) @ self.rotation


@dataclass(frozen=True, slots=True, eq=False)
class Velocity:
    """Velocity of the indenter's lowest point (..., 3) [mm], and its spin (..., 3) [radians]."""

    tip: FloatArray
    spin: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """History variables of the quadrature points.

    Parameters
    ----------
    anchors : (n, 3) array
        In the indenter's frame: the anchor of a point that touched, the last position of one that did not.
    anchored : (n,) array
        Which points touched.
    """

    anchors: FloatArray
    anchored: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class ContactLaw:
    """Indenter's shape, penalty ε [N/mm³] and Coulomb coefficient.

    Forces below ``least_force_N`` count as zero: the scale of a limb out of contact.
    """

    shape: Indenter
    penalty: float
    friction: float
    least_force_N: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class ContactState:
    """One position on the path: pose of the indenter, history of the contact, and its law.

    ``limits`` (n,), if given, are the largest tangential tractions [MPa] in place of the friction
    coefficient times the pressure: Tresca's friction, whose forces have a potential.
    """

    pose: Pose
    memory: Memory
    law: ContactLaw
    limits: FloatArray | None = None

    def is_same(self, other: "ContactState") -> bool:
        """Whether the tractions of any displacements are the same in both."""
        own, theirs = (self.memory, self.law, self.limits), (other.memory, other.law, other.limits)
        return all(a is b for a, b in zip(own, theirs, strict=True)) and (
            np.array_equal(self.pose.tip, other.pose.tip)
            and np.array_equal(self.pose.rotation, other.pose.rotation)
        )


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """Rates, per unit of some parameters (...), of all that the tractions at points depend on.

    Parameters
    ----------
    positions, anchors : (..., k, 3) array
        In the indenter's frame.
    penalty, friction : (..., 1) array
    """

    positions: FloatArray
    anchors: FloatArray
    penalty: FloatArray
    friction: FloatArray

    def of(self, where: IntArray) -> "Change":
        """The change of some of the points."""
        return replace(self, positions=self.positions[..., where, :], anchors=self.anchors[..., where, :])


def _outer(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[:, :, None] * b[:, None, :])


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray((a * b).sum(axis=-1))


def _times(factor: FloatArray, array: FloatArray) -> FloatArray:
    return np.asarray(factor[..., None] * array)


@dataclass(frozen=True, eq=False)
class Points:
    """Tractions at points that may touch, all arrays in the indenter's frame.

    Parameters
    ----------
    positions, anchors : (k, 3) array
    anchored : (k,) array
    limits : (k,) array, optional
        As in :class:`ContactState`.
    """

    positions: FloatArray
    anchors: FloatArray
    anchored: BoolArray
    law: ContactLaw
    limits: FloatArray | None = None

    @cached_property
    def depth(self) -> FloatArray:
        """Penetration ⟨−d⟩ (k,) [mm]."""
        return np.asarray(np.maximum(-self.law.shape.distance(self.positions), 0.0))

    @cached_property
    def pressure(self) -> FloatArray:
        """Normal pressure p (k,) [MPa] per reference area."""
        return self.law.penalty * self.depth

    @cached_property
    def _normals(self) -> tuple[FloatArray, FloatArray]:
        return self.law.shape.normals(self.positions)

    @cached_property
    def _held_share(self) -> tuple[FloatArray, FloatArray]:
        """Share φ of the path from the anchor that counts as slip, and ∂φ/∂depth.

        All of it for a point that has touched before; otherwise the part after
        it crossed the surface: the path is straight, so φ = depth / (depth + gap before).
        """
        before = np.maximum(self.law.shape.distance(self.anchors), LEAST_GAP)
        way = before + self.depth
        share = np.where(self.anchored, 1.0, self.depth / way)
        return share, np.where(self.anchored, 0.0, before / way**2)

    @cached_property
    def _trial(self) -> FloatArray:
        """ε (I − n nᵀ) s (k, 3): the traction of a point that sticks."""
        n, _ = self._normals
        slip = _times(self._held_share[0], self.positions - self.anchors)
        tangential = slip - _times((n * slip).sum(axis=1), n)
        return self.law.penalty * tangential

    @cached_property
    def _size(self) -> FloatArray:
        return np.asarray(np.sqrt((self._trial**2).sum(axis=1)))

    @cached_property
    def _limit(self) -> FloatArray:
        return self.law.friction * self.pressure if self.limits is None else self.limits

    @cached_property
    def sliding(self) -> BoolArray:
        """Mask (k,) of the points that have reached the limit of friction."""
        return np.asarray(self._size > self._limit)

    @cached_property
    def friction(self) -> FloatArray:
        """Tangential traction t (k, 3) of the tissue on the indenter [MPa]."""
        share = np.where(self.sliding, self._limit / np.maximum(self._size, 1e-300), 1.0)
        return _times(np.where(self.depth > 0.0, share, 0.0), self._trial)

    @cached_property
    def traction(self) -> FloatArray:
        """Traction p n − t (k, 3) of the indenter on the tissue [MPa]."""
        return _times(self.pressure, self._normals[0]) - self.friction

    def jacobian(self, *, coupled: bool) -> FloatArray:
        """∂traction/∂positions (k, 3, 3).

        Uncoupled, the Coulomb limit is fixed: the derivative of sliding friction in the
        pressure, which makes it unsymmetric, is left out.
        """
        (n, curvature), (share, share_slope) = self._normals, self._held_share
        way = self.positions - self.anchors
        slip = _times(share, way)
        d_slip = _times(share[:, None], np.eye(3)[None]) - _outer(_times(share_slope, way), n)
        along = (n * slip).sum(axis=1)[:, None]
        bent = (curvature @ slip[:, :, None])[:, :, 0]
        d_trial = (
            d_slip - _outer(n, (n[:, None, :] @ d_slip)[:, 0]) - _times(along, curvature) - _outer(n, bent)
        )
        d_trial *= self.law.penalty
        d_pressure = -self.law.penalty * n
        size = np.maximum(self._size, 1e-300)
        direction = self._trial / size[:, None]
        turning = d_trial - _outer(direction, (direction[:, None, :] @ d_trial)[:, 0])
        d_sliding = _times((self._limit / size)[:, None], turning)
        if coupled and self.limits is None:
            d_sliding += self.law.friction * _outer(direction, d_pressure)
        d_friction = np.where(self.sliding[:, None, None], d_sliding, d_trial)
        derivative = _outer(n, d_pressure) + _times(self.pressure[:, None], curvature) - d_friction
        return np.where((self.depth > 0.0)[:, None, None], derivative, 0.0)

    def rates(self, change: Change) -> tuple[FloatArray, FloatArray]:
        """Rates (..., k, 3) of the traction and of the friction in it."""
        touching, n = self.depth > 0.0, self._normals[0]
        d_depth = np.where(touching, -_dot(n, change.positions), 0.0)
        d_normal = (self._normals[1] @ change.positions[..., None])[..., 0]
        d_pressure = change.penalty * self.depth + self.law.penalty * d_depth
        d_trial = self._trial_rate(change, d_depth, d_normal)
        size = np.maximum(self._size, 1e-300)
        direction = self._trial / size[:, None]
        d_limit = change.friction * self.pressure + self.law.friction * d_pressure
        turning = d_trial - _times(_dot(direction, d_trial), direction)
        d_sliding = _times(self._limit / size, turning) + _times(d_limit, direction)
        d_friction = np.where(self.sliding[:, None], d_sliding, d_trial)
        d_friction = np.where(touching[:, None], d_friction, 0.0)
        return _times(d_pressure, n) + _times(self.pressure, d_normal) - d_friction, d_friction

    def _trial_rate(self, change: Change, d_depth: FloatArray, d_normal: FloatArray) -> FloatArray:
        (n, _), (share, share_slope) = self._normals, self._held_share
        way = self.positions - self.anchors
        slip = _times(share, way)
        d_share = share_slope * d_depth + self._share_rate(change.anchors)
        d_slip = _times(share, change.positions - change.anchors) + _times(d_share, way)
        along, d_along = _dot(n, slip), _dot(n, d_slip) + _dot(d_normal, slip)
        d_tangential = d_slip - _times(d_along, n) - _times(along, d_normal)
        stiffer = change.penalty[..., None] / self.law.penalty
        return self.law.penalty * d_tangential + stiffer * self._trial

    def _share_rate(self, anchors: FloatArray) -> FloatArray:
        """Rate of the share φ from the change of the initial gap with the anchors' rates."""
        gap = self.law.shape.distance(self.anchors)
        held = self.anchored | (gap <= LEAST_GAP)
        d_gap = _dot(self.law.shape.normals(self.anchors)[0], anchors)
        way = np.maximum(gap, LEAST_GAP) + self.depth
        return np.where(held, 0.0, -self.depth / way**2 * d_gap)


@dataclass(frozen=True, slots=True, eq=False)
class Touched:
    """Faces of each surface with a point inside the indenter (f',), and these faces' points."""

    faces: list[IntArray]
    where: IntArray
    points: Points


class Contact:
    """The contact faces of a mesh against a rigid indenter.

    Parameters
    ----------
    mesh : Mesh
        In the spot's frame: spot at the origin, outward normal +z.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.surfaces = contact_surfaces(mesh)
        self._rest = mesh.points_mm
        self.areas = np.concatenate([np.empty(0), *(s.areas.ravel() for s in self.surfaces)])
        self._nodes = np.unique(
            np.concatenate([np.empty(0, np.int64), *(s.nodes.ravel() for s in self.surfaces)])
        )
        ends = np.cumsum([0, *(s.areas.size for s in self.surfaces)])
        self._numbers = [
            np.arange(start, stop).reshape(s.areas.shape)
            for s, start, stop in zip(self.surfaces, ends[:-1], ends[1:], strict=True)
        ]
        self._last: tuple[FloatArray, ContactState, Touched] | None = None

    def no_memory(self, pose: Pose) -> Memory:
        """History of a limb at rest without contact."""
        positions = pose.into(self.positions(np.zeros_like(self._rest)))
        return Memory(positions, np.zeros(len(positions), dtype=bool))

    def positions(self, displacements: FloatArray) -> FloatArray:
        """Quadrature points (n, 3) in the limb's frame."""
        return self.at_points(self._rest + displacements)

    def at_points(self, nodal: FloatArray) -> FloatArray:
        """A nodal field (..., n_nodes, 3) at the quadrature points (..., n, 3)."""
        none = np.empty((*nodal.shape[:-2], 0, 3))
        return np.concatenate([none, *(s.positions(nodal) for s in self.surfaces)], axis=-2)

    def touched(self, displacements: FloatArray, load: ContactState) -> Touched:
        """The points of all faces that the indenter touches, kept for the next call with the same state."""
        if self._last is not None:
            known, before, found = self._last
            if before.is_same(load) and np.array_equal(known, displacements):
                return found
        positions = load.pose.into(self.positions(displacements))
        inside = load.law.shape.distance(positions) < 0.0
        faces = [np.flatnonzero(inside[numbers].any(axis=1)) for numbers in self._numbers]
        numbers = [n[f].ravel() for n, f in zip(self._numbers, faces, strict=True)]
        where = np.concatenate([np.empty(0, dtype=np.int64), *numbers])
        anchors, anchored = load.memory.anchors[where], load.memory.anchored[where]
        limits = None if load.limits is None else load.limits[where]
        found = Touched(faces, where, Points(positions[where], anchors, anchored, load.law, limits))
        self._last = displacements.copy(), load, found
        return found

    def _by_surface(
        self, touched: Touched, per_point: FloatArray
    ) -> list[tuple[ContactSurface, IntArray, FloatArray]]:
        """Surfaces with their touched faces and an array of these faces' points, as (f', q, ...)."""
        ends = np.cumsum(
            [f.size * s.areas.shape[1] for s, f in zip(self.surfaces, touched.faces, strict=True)]
        )
        parts = np.split(per_point, ends[:-1]) if self.surfaces else []
        return [
            (surface, faces, part.reshape(-1, surface.areas.shape[1], *per_point.shape[1:]))
            for surface, faces, part in zip(self.surfaces, touched.faces, parts, strict=True)
        ]

    def along(self, start: FloatArray, end: FloatArray, load: ContactState) -> FloatArray:
        """Curve a straight step of the surface so that points slide along the indenter.

        A point that moves by s along a surface of curvature 1/R ends at a distance s²/2R,
        which may be more than its penetration: Newton's method would lose the contact.
        Near the indenter, nodes end at the distance that a flat indenter would give.
        """
        nodes = self._nodes
        before, after = (load.pose.into((self._rest + u)[nodes]) for u in (start, end))
        shape = load.law.shape
        distance = shape.distance(before)
        near = np.abs(distance) < NEAR
        nodes, before, after, distance = nodes[near], before[near], after[near], distance[near]
        flat = distance + (shape.normals(before)[0] * (after - before)).sum(axis=1)
        lift = np.clip(shape.distance(after) - flat, -NEAR, NEAR)
        result = end.copy()
        result[nodes] -= (lift[:, None] * shape.normals(after)[0]) @ load.pose.rotation.T
        return result

    def force(self, displacements: FloatArray, load: ContactState) -> FloatArray:
        """Nodal forces of the indenter on the tissue (n_nodes, 3) [N]."""
        touched = self.touched(displacements, load)
        return self.to_nodes(touched, touched.points.traction @ load.pose.rotation.T)

    def to_nodes(self, touched: Touched, tractions: FloatArray) -> FloatArray:
        """Nodal forces of tractions (k, 3) at the touched faces' points."""
        total = np.zeros_like(self._rest)
        for surface, faces, part in self._by_surface(touched, tractions):
            weighted = surface.areas[faces][:, :, None] * part
            np.add.at(total, surface.nodes[faces], surface.values.T @ weighted)
        return total

    def stiffness(
        self, displacements: FloatArray, load: ContactState, *, coupled: bool = True
    ) -> list[tuple[IntArray, FloatArray]]:
        """−∂force/∂displacements by surface: faces (f',) and (f', 3n, 3n) [N/mm].

        It is unsymmetric where points slide. Uncoupled it is close to symmetric and
        makes a good preconditioner.
        """
        touched = self.touched(displacements, load)
        turn = load.pose.rotation
        jacobians = turn @ touched.points.jacobian(coupled=coupled) @ turn.T
        return [
            (faces, _face_stiffness(surface, faces, part))
            for surface, faces, part in self._by_surface(touched, jacobians)
        ]

    def drag(self, displacements: FloatArray, load: ContactState, motion: Velocity) -> FloatArray:
        """Change of the nodal forces (n_nodes, 3) [N] as the indenter moves and the tissue does not."""
        touched, turn = self.touched(displacements, load), load.pose.rotation
        jacobians = turn @ touched.points.jacobian(coupled=True) @ turn.T
        arms = self.positions(displacements)[touched.where] - load.pose.tip
        velocities = np.cross(motion.spin, arms) + motion.tip
        turned = np.cross(motion.spin, touched.points.traction @ turn.T)
        return self.to_nodes(touched, turned - (jacobians @ velocities[:, :, None])[:, :, 0])

    def held(self, displacements: FloatArray, load: ContactState) -> ContactState:
        """The load with friction limits from the pressures of these displacements."""
        distance = load.law.shape.distance(load.pose.into(self.positions(displacements)))
        limits = load.law.friction * load.law.penalty * np.maximum(-distance, 0.0)
        return replace(load, limits=limits)

    def remember(self, displacements: FloatArray, load: ContactState) -> Memory:
        """History after an equilibrium: anchors stay where points stick and move with slip."""
        anchors = load.pose.into(self.positions(displacements))
        touched, anchored = self.touched(displacements, load), np.zeros(len(anchors), dtype=bool)
        anchored[touched.where] = touched.points.depth > 0.0
        anchors[touched.where] -= touched.points.friction / load.law.penalty
        return Memory(anchors, anchored)

    def answer(self, displacements: FloatArray, load: ContactState) -> "Answer":
        """Force and moment of the indenter, and the state of the contact."""
        touched = self.touched(displacements, load)
        points, arms = touched.points, self.positions(displacements)[touched.where]
        loads = self.areas[touched.where, None] * (points.traction @ load.pose.rotation.T)
        touching = points.depth > 0.0
        radius = np.hypot(*(arms[:, :2] - load.pose.tip[:2]).T)
        return Answer(
            force_N=-loads.sum(axis=0),
            moment_Nmm=np.cross(arms, loads).sum(axis=0),
            contact_radius_mm=float(radius[touching].max(initial=0.0)),
            penetration_mm=float(points.depth.max(initial=0.0)),
            sticking=float((touching & ~points.sliding).sum() / max(touching.sum(), 1)),
        )


def _face_stiffness(surface: ContactSurface, faces: IntArray, jacobians: FloatArray) -> FloatArray:
    """−Σ_q area N_a J N_b, shape (f', 3n, 3n), of Jacobians (f', q, 3, 3)."""
    n = surface.nodes.shape[1]
    weighted = (surface.areas[faces][:, :, None, None] * jacobians).reshape(*jacobians.shape[:2], 9)
    pairs = (surface.values[:, :, None] * surface.values[:, None, :]).reshape(len(surface.values), n * n)
    blocks = (pairs.T @ weighted).reshape(-1, n, n, 3, 3)
    return -blocks.transpose(0, 1, 3, 2, 4).reshape(-1, 3 * n, 3 * n)


CONTACT = {"contact_radius_mm": "contact_radius_mm", "sticking_1": "sticking"}
"""Columns of the equilibrium states besides pose, wrench and time, and what of an answer they hold."""


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """Force and moment of the contact, with the signs of :mod:`palpate.api.mesh`.

    Parameters
    ----------
    force_N : (3,) array
        Force of the tissue on the indenter; z is positive in compression.
    moment_Nmm : (3,) array
        Moment that the indenter applies to the tissue about the spot.
    contact_radius_mm, penetration_mm : float
        Largest distance of a touching point from the normal through the indenter's origin; largest
        penetration.
    sticking : float
        Share of the touching points that stick.
    """

    force_N: FloatArray
    moment_Nmm: FloatArray
    contact_radius_mm: float
    penetration_mm: float
    sticking: float
