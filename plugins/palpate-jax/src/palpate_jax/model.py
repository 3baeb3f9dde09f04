"""Model of one limb: body, contact and their common sparse pattern."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from palpate.api import FloatArray, Limb, Material, Mesh, MeshError
from palpate.api.mesh import in_spot_frame, spot_axes
from palpate_jax.body import Body
from palpate_jax.contact import Answer, Contact, ContactState, Pose, Velocity
from palpate_jax.sparse import LinearSolver, Pattern


def _touched_region(mesh: Mesh, body: Body) -> str:
    """Region of the surface at the spot, which sets the scale of the contact penalty."""
    surface = mesh.node_sets["contact"]
    nearest = surface[np.argmin(np.linalg.norm(mesh.points_mm[surface], axis=1))]
    for block in body.blocks:
        if (block.nodes == nearest).any():
            return block.region
    raise MeshError(f"contact node {nearest}, the nearest to the spot, belongs to no element; remove it")


@dataclass(frozen=True, slots=True, eq=False)
class Residual:
    """Imbalance of the free unknowns (n,) [N], the size of the forces in it, and the least J."""

    free: FloatArray
    scale: float
    least_jacobian: float

    @property
    def relative(self) -> float:
        """Size of the imbalance relative to the forces."""
        return float(np.linalg.norm(self.free)) / self.scale


class Model:
    """A limb, its materials by region, and the unknowns that are free to move.

    Nodes of the set ``fixed`` never move; nodes of the set ``bonded``, if the mesh
    has one, are glued to the indenter and move with it.
    """

    def __init__(
        self, limb: Limb, materials: Mapping[str, Material], mean_dilatation: bool | Collection[str]
    ) -> None:
        mesh = in_spot_frame(limb)
        self.body = Body(mesh, materials, mean_dilatation, spot_axes(limb.spot.normal, limb.spot.along))
        self.contact = Contact(mesh)
        self.points = mesh.points_mm
        self.touched_region = _touched_region(mesh, self.body)
        unknowns = np.zeros((mesh.n_nodes, 3), dtype=np.int64)
        self.bonded = np.asarray(mesh.node_sets.get("bonded", ()), dtype=np.int64)
        unknowns[mesh.node_sets["fixed"]] = -1
        unknowns[self.bonded] = -1
        self._free = unknowns.ravel() >= 0
        unknowns.reshape(-1)[self._free] = np.arange(self._free.sum())
        nodes = [b.nodes for b in self.body.blocks] + [s.nodes for s in self.contact.surfaces]
        groups = [unknowns[each].reshape(len(each), -1) for each in nodes]
        self.pattern = Pattern(groups, int(self._free.sum()))
        places = [self.pattern.places(k) for k in range(len(self.body.blocks))]
        self.body.bind(places, len(self.pattern.indices))
        self.linear = LinearSolver(self.pattern)
        self._last: Linearised | None = None

    def rest(self) -> FloatArray:
        """Displacements (n_nodes, 3) of the unloaded limb."""
        return np.zeros(self.points.shape)

    def moved(self, displacements: FloatArray, step: FloatArray, load: ContactState) -> FloatArray:
        """Displacements after a step of the free unknowns, curved along a nearby indenter."""
        result = self.contact.along(displacements, self.straight(displacements, step), load)
        result.reshape(-1)[~self._free] = displacements.reshape(-1)[~self._free]
        return result

    def straight(self, displacements: FloatArray, step: FloatArray) -> FloatArray:
        """Displacements after a straight step of the free unknowns."""
        result = displacements.copy()
        result.reshape(-1)[self._free] += step
        return result

    def carried(self, displacements: FloatArray, pose: Pose) -> FloatArray:
        """Displacements with the bonded nodes moved by the indenter."""
        result = displacements.copy()
        rest = self.points[self.bonded]
        result[self.bonded] = rest @ pose.rotation.T + pose.tip - rest
        return result

    def answer(
        self, displacements: FloatArray, thetas: Mapping[str, FloatArray], load: ContactState
    ) -> Answer:
        """Load on the indenter at an equilibrium state: contact tractions and forces of the bonded nodes."""
        answer = self.contact.answer(displacements, load)
        if not self.bonded.size:
            return answer
        internal, _ = self.body.force(displacements, thetas)
        pulls, arms = internal[self.bonded], (self.points + displacements)[self.bonded]
        return replace(
            answer,
            force_N=answer.force_N - pulls.sum(axis=0),
            moment_Nmm=answer.moment_Nmm + np.cross(arms, pulls).sum(axis=0),
        )

    def along_arcs(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Curve a straight step so that its circumferential part follows arcs about the axis.

        Points that turn with the sphere stay on it; the straight step would
        lift them by r α²/2, which the penalty turns into a large force.
        """
        place = self.points[:, :2] + start[:, :2]
        step = end[:, :2] - start[:, :2]
        square = np.maximum((place**2).sum(axis=1), 1e-12)
        angle = (place[:, 0] * step[:, 1] - place[:, 1] * step[:, 0]) / square
        angle = np.clip(angle, -1.0, 1.0)
        cos, sin = np.cos(angle), np.sin(angle)
        bend = np.stack(
            [
                place[:, 0] * (cos - 1.0) - place[:, 1] * (sin - angle),
                place[:, 1] * (cos - 1.0) + place[:, 0] * (sin - angle),
            ],
            axis=1,
        )
        result = end.copy()
        result[:, :2] += bend
        result.reshape(-1)[~self._free] = end.reshape(-1)[~self._free]
        return result

    def forces(self, displacements: FloatArray, thetas: Mapping[str, FloatArray]) -> "Forces":
        """Internal forces of a state."""
        internal, least = self.body.force(displacements, thetas)
        return Forces(self, displacements, internal, least)

    def linearised(
        self, displacements: FloatArray, thetas: Mapping[str, FloatArray], *, nearly: bool = False
    ) -> "Linearised":
        """Derivative of the forces of a state, cached for the next call with the same state.

        If the state is ``nearly`` the last one, the body's tangent of that one serves, and the
        contact's is of this state. Not with bonded nodes, which need the internal forces too.
        """
        last = self._last
        if last is not None and last.thetas is thetas:
            if np.array_equal(last.displacements, displacements):
                return last
            if nearly and not self.bonded.size:
                return replace(last, displacements=displacements)
        internal, values, least = self.body.tangent(displacements, thetas)
        self._last = Linearised(self, displacements.copy(), internal, least, values, thetas)
        return self._last

    def free(self, nodal: FloatArray) -> FloatArray:
        """Free unknowns (n,) of a nodal field (n_nodes, 3)."""
        return nodal.reshape(-1)[self._free]


@dataclass(frozen=True, eq=False)
class Forces:
    """Internal forces (n_nodes, 3) [N] at some displacements, and the least J."""

    model: Model
    displacements: FloatArray
    internal: FloatArray
    least_jacobian: float

    def residual(self, load: ContactState) -> Residual:
        """Internal minus contact forces."""
        external = self.model.contact.force(self.displacements, load)
        sizes = (float(np.linalg.norm(external)), float(np.linalg.norm(self.internal)))
        scale = max(*sizes, load.law.least_force_N)
        return Residual(self.model.free(self.internal - external), scale, self.least_jacobian)


@dataclass(frozen=True, eq=False)
class Linearised(Forces):
    """Internal forces and their derivative in the order of the pattern [N/mm]."""

    values: FloatArray
    thetas: Mapping[str, FloatArray]

    def _values(self, load: ContactState, coupled: bool) -> FloatArray:
        model, values = self.model, self.values.copy()
        contact = model.contact.stiffness(self.displacements, load, coupled=coupled)
        for group, (faces, stiffness) in enumerate(contact, start=len(model.body.blocks)):
            model.pattern.add(values, group, faces, stiffness)
        return values

    def rate(self, load: ContactState, motion: Velocity) -> FloatArray:
        """Change of the residual (n,) [N] as the indenter moves and the free nodes do not."""
        model = self.model
        rate = model.free(-model.contact.drag(self.displacements, load, motion))
        if model.bonded.size:
            probe = 1e-6
            carried = self.displacements.copy()
            arms = (model.points + carried)[model.bonded] - load.pose.tip
            carried[model.bonded] += probe * (np.cross(motion.spin, arms) + motion.tip)
            ahead, _ = model.body.force(carried, self.thetas)
            rate += model.free(ahead - self.internal) / probe
        return rate

    def matrix(self, load: ContactState) -> FloatArray:
        """Values of the derivative of the residual, in the order of the pattern [N/mm]."""
        return self._values(load, coupled=True)

    def preconditioner(self, load: ContactState) -> FloatArray:
        """Values of a symmetric matrix close to it; see :meth:`Contact.stiffness`."""
        return self.model.pattern.symmetric_part(self._values(load, coupled=False))
