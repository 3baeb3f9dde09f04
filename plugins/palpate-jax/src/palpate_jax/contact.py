"""Contact of the skin with a rigid sphere: penalty, and Coulomb friction that remembers.

At every quadrature point of the contact faces, with gap g = |x − c| − R and
normal n = (x − c)/|x − c|:

* normal pressure p = ε ⟨−g⟩ per reference area;
* tangential traction t = ε s, where s is the tangential distance from the
  point's anchor, returned to the Coulomb cone |t| ≤ μ p (return mapping).

The anchor lives in the sphere's frame, so it turns with the sphere; it is kept
from step to step until slip moves it. That memory is what makes the torque of a
twist independent of the number of steps. A point has no anchor, and so no
tangential traction, in the step in which it first touches.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from palpate.domain import BoolArray, FloatArray, IntArray, Mesh
from palpate.errors import MeshError
from palpate_jax.elements import ELEMENTS

Jax = Any


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """Contact faces of one kind.

    Parameters
    ----------
    nodes : (f, n) array
    values : (q, n) array
        Shape functions at the face's quadrature points.
    areas : (f, q) array
        Reference area of each point [mm²].
    """

    nodes: IntArray
    values: FloatArray
    areas: FloatArray

    def positions(self, coordinates: FloatArray) -> FloatArray:
        """Quadrature points (f q, 3) of node coordinates (n_nodes, 3)."""
        points: FloatArray = np.einsum("qa,fai->fqi", self.values, coordinates[self.nodes])
        return points.reshape(-1, 3)


def skins(mesh: Mesh) -> tuple[Skin, ...]:
    """Boundary faces whose nodes all belong to the node set ``contact``.

    Raises
    ------
    MeshError
        There is none.
    """
    touchable = np.zeros(mesh.n_nodes, dtype=bool)
    touchable[mesh.node_sets["contact"]] = True
    found = []
    for kind, cells in mesh.cells.items():
        element = ELEMENTS[kind]
        faces = np.concatenate([cells[:, list(face)] for face in element.faces])
        corners = np.sort(faces[:, : element.n_face_corners], axis=1)
        _, first, counts = np.unique(corners, axis=0, return_index=True, return_counts=True)
        faces = faces[first[counts == 1]]
        faces = faces[touchable[faces].all(axis=1)]
        if len(faces):
            slopes = np.einsum("qak,fai->fqki", element.face.slopes, mesh.points_mm[faces])
            areas = np.linalg.norm(np.cross(slopes[:, :, 0], slopes[:, :, 1]), axis=2)
            found.append(Skin(faces, element.face.values, areas * element.face.weights))
    if not found:
        raise MeshError(
            "mesh: no boundary face has all its nodes in the node set 'contact'; "
            "mark every node of the outer surface"
        )
    return tuple(found)


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Where the sphere is: centre (3,) [mm] and rotation matrix (3, 3)."""

    centre: FloatArray
    rotation: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """Anchor of every quadrature point in the sphere's frame (n, 3), and which points have one (n,)."""

    anchors: FloatArray
    anchored: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class Law:
    """Sphere radius [mm], penalty [N/mm³] and Coulomb coefficient."""

    radius_mm: float
    penalty: float
    friction: float


def _traction(
    x: Jax, anchor: Jax, anchored: Jax, centre: Jax, law: Jax, coupled: bool = True
) -> tuple[Jax, Jax]:
    """Traction on the tissue per reference area at one point (3,), and its tangential part.

    Uncoupled, the derivative takes the Coulomb limit as given: it leaves out how
    sliding friction follows the pressure, which is what makes it unsymmetric.
    """
    radius, penalty, friction = law
    arm = x - centre
    distance = jnp.sqrt(arm @ arm)
    normal = arm / distance
    pressure = penalty * jnp.maximum(radius - distance, 0.0)
    offset = x - anchor
    trial = penalty * (offset - normal * (normal @ offset))
    size = jnp.sqrt(jnp.maximum(trial @ trial, 1e-300))
    limit = friction * (pressure if coupled else jax.lax.stop_gradient(pressure))
    tangential = jnp.where(size <= limit, trial, trial * (limit / size))
    tangential = jnp.where(anchored & (pressure > 0.0), tangential, 0.0)
    return pressure * normal - tangential, tangential


_tractions = jax.jit(jax.vmap(_traction, in_axes=(0, 0, 0, None, None)))
_jacobians = jax.jit(jax.vmap(jax.jacfwd(_traction, has_aux=True), in_axes=(0, 0, 0, None, None)))
_uncoupled_jacobians = jax.jit(
    jax.vmap(jax.jacfwd(partial(_traction, coupled=False), has_aux=True), in_axes=(0, 0, 0, None, None))
)


class Contact:
    """The contact faces of a mesh against a sphere.

    Parameters
    ----------
    mesh : Mesh
        In the spot's frame: spot at the origin, outward normal +z.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.skins = skins(mesh)
        self._points = mesh.points_mm
        self._areas = np.concatenate([s.areas.ravel() for s in self.skins])

    def no_memory(self) -> Memory:
        """Nothing has touched yet."""
        n = len(self._areas)
        return Memory(np.zeros((n, 3)), np.zeros(n, dtype=bool))

    def _positions(self, displacements: FloatArray) -> FloatArray:
        coordinates = self._points + displacements
        return np.concatenate([s.positions(coordinates) for s in self.skins])

    def _arguments(self, displacements: FloatArray, pose: Pose, memory: Memory, law: Law) -> tuple[Any, ...]:
        anchors = memory.anchors @ pose.rotation.T + pose.centre
        numbers = (law.radius_mm, law.penalty, law.friction)
        return self._positions(displacements), anchors, memory.anchored, pose.centre, numbers

    def force(self, displacements: FloatArray, pose: Pose, memory: Memory, law: Law) -> FloatArray:
        """Nodal forces of the sphere on the tissue (n_nodes, 3) [N]."""
        tractions, _ = _tractions(*self._arguments(displacements, pose, memory, law))
        return self._to_nodes(np.asarray(tractions))

    def _split(self, per_point: FloatArray) -> list[FloatArray]:
        ends = np.cumsum([s.areas.size for s in self.skins])[:-1]
        return [
            part.reshape(*s.areas.shape, *per_point.shape[1:])
            for s, part in zip(self.skins, np.split(per_point, ends), strict=True)
        ]

    def _to_nodes(self, tractions: FloatArray) -> FloatArray:
        total = np.zeros_like(self._points)
        for skin, part in zip(self.skins, self._split(tractions), strict=True):
            np.add.at(total, skin.nodes, np.einsum("fq,qa,fqi->fai", skin.areas, skin.values, part))
        return total

    def stiffness(
        self, displacements: FloatArray, pose: Pose, memory: Memory, law: Law, *, coupled: bool = True
    ) -> list[FloatArray]:
        """−∂force/∂displacements by skin, (f, 3n, 3n) [N/mm]; unsymmetric where points slide.

        Uncoupled it is close to symmetric and makes a good preconditioner.
        """
        derivative = _jacobians if coupled else _uncoupled_jacobians
        jacobians, _ = derivative(*self._arguments(displacements, pose, memory, law))
        return [
            -np.einsum("fq,qa,qb,fqij->faibj", s.areas, s.values, s.values, part, optimize=True).reshape(
                len(s.nodes), 3 * s.nodes.shape[1], -1
            )
            for s, part in zip(self.skins, self._split(np.asarray(jacobians)), strict=True)
        ]

    def remember(self, displacements: FloatArray, pose: Pose, memory: Memory, law: Law) -> Memory:
        """Anchors after an equilibrium: kept where the point sticks, moved by slip, new at first touch."""
        arguments = self._arguments(displacements, pose, memory, law)
        positions = arguments[0]
        _, tangential = _tractions(*arguments)
        distance = np.linalg.norm(positions - pose.centre, axis=1)
        touching = distance < law.radius_mm
        world = positions - np.asarray(tangential) / law.penalty
        return Memory(np.where(touching[:, None], (world - pose.centre) @ pose.rotation, 0.0), touching)

    def answer(self, displacements: FloatArray, pose: Pose, memory: Memory, law: Law) -> "Answer":
        """What the sphere feels, and how the contact stands."""
        arguments = self._arguments(displacements, pose, memory, law)
        tractions, tangential = (np.asarray(a) for a in _tractions(*arguments))
        arms = arguments[0]
        loads = self._areas[:, None] * tractions
        penetration = law.radius_mm - np.linalg.norm(arms - pose.centre, axis=1)
        touching = penetration > 0.0
        pressure = law.penalty * penetration
        sliding = np.linalg.norm(tangential, axis=1) >= (1.0 - 1e-9) * law.friction * pressure
        radius = np.linalg.norm(arms[:, :2], axis=1)
        n_touching = max(int(touching.sum()), 1)
        return Answer(
            force_N=-loads.sum(axis=0),
            moment_Nmm=np.cross(arms, loads).sum(axis=0),
            contact_radius_mm=float(radius[touching].max(initial=0.0)),
            penetration_mm=float(penetration.max(initial=0.0)),
            sticking=float((touching & memory.anchored & ~sliding).sum() / n_touching),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What the sphere feels.

    Parameters
    ----------
    force_N : (3,) array
        Force of the tissue on the sphere; z is positive in compression.
    moment_Nmm : (3,) array
        Moment that the sphere applies to the tissue about the spot.
    contact_radius_mm, penetration_mm : float
        Farthest touching point from the axis; deepest overlap.
    sticking : float
        Share of the touching points that stick.
    """

    force_N: FloatArray
    moment_Nmm: FloatArray
    contact_radius_mm: float
    penetration_mm: float
    sticking: float
