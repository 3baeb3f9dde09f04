"""The frame of a spot: the sign of torque, force and rotation is decided here.

The spot is the origin and z its outward normal. The three signs depend on z alone:

* force is the force of the tissue on the indenter along z: positive in compression;
* rotation is about z by the right-hand rule: positive is counter-clockwise, seen from outside;
* torque is the moment of the indenter on the tissue about z: positive with a positive rotation.

No force along z and no moment about it depends on x and y, but by the turn of an indenter that is not
round, and the direction of a tilt. :mod:`palpate.domain.equilibrium_states` has all six components of pose
and wrench.
"""

from dataclasses import dataclass, replace

import numpy as np

from palpate.domain import FloatArray, Indentation, Job, Limb, Mesh
from palpate.errors import MeshError, StudyError
from palpate.mesh.topology import surface_faces

NEAR = 1.2
"""Distance from the spot up to which edges count, over the indenter's radius."""
RIM = (0.733, 1.133)
"""Distances from the spot between which the edge of the contact is, over the reach of its deepest contact."""


def contact_edge_mm(limb: Limb, near_mm: float, beyond_mm: float = 0.0) -> float:
    """Mean length of the edges of contact faces near the spot; of the nearest six where none is near.

    Edges nearer than ``beyond_mm`` do not count.
    """
    mesh = limb.mesh
    pairs = []
    for faces, n in surface_faces(mesh):
        corners = faces[:, :n]
        corners = corners[np.isin(corners, mesh.node_sets["contact"]).all(axis=1)]
        pairs.append(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2))
    if not sum(map(len, pairs)):
        raise MeshError("mesh: node set 'contact' holds no face of the surface; mark all nodes of the skin")
    ends: FloatArray = mesh.points_mm[np.unique(np.sort(np.concatenate(pairs), axis=1), axis=0)]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    away = np.linalg.norm(ends.mean(axis=1) - limb.spot.position_mm, axis=1)
    near = (away >= beyond_mm) & (away <= near_mm)
    return float(lengths[near if near.any() else np.argsort(away)[:6]].mean())


def spot_axes(normal: FloatArray, along: FloatArray | None = None) -> FloatArray:
    """Axes of the spot's frame as columns (3, 3): right-handed, the third is the normal.

    Parameters
    ----------
    normal : (3,) array
        Of length 1, outward.
    along : (3,) array, optional
        The direction of x, as far as it is tangential; by default the x axis of the mesh, or its
        axis that is nearest to tangential where the normal is close to x.
    """
    if along is None:
        along = np.eye(3)[np.argmin(np.abs(normal)) if abs(normal[0]) > 0.9 else 0]
    x = along - normal * (normal @ along)
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal], axis=1)


def in_spot_frame(limb: Limb) -> Mesh:
    """The mesh in the frame of its spot; vectors in its ``cell_fields`` keep the limb's frame."""
    points = (limb.mesh.points_mm - limb.spot.position_mm) @ spot_axes(limb.spot.normal, limb.spot.along)
    return replace(limb.mesh, points_mm=points)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpotWrench:
    """Action of the tissue on the indenter, in the frame of the spot: arrays (n, 3).

    Parameters
    ----------
    force_N : (n, 3) array
    moment_Nmm : (n, 3) array
        About a point of the z axis.
    """

    force_N: FloatArray
    moment_Nmm: FloatArray

    @property
    def pressing(self) -> FloatArray:
        """Force [N] (n,), positive in compression."""
        return self.force_N[:, 2]

    @property
    def twisting(self) -> FloatArray:
        """Torque [N·mm] (n,) of the indenter on the tissue about the outward normal."""
        return -self.moment_Nmm[:, 2]

    def on_tissue(self, from_tip_mm: FloatArray) -> FloatArray:
        """Wrench (n, 6) of :class:`palpate.domain.equilibrium_states.EquilibriumStates`.

        Parameters
        ----------
        from_tip_mm : (n, 3) array
            From the indenter's point to the one that ``moment_Nmm`` is about.
        """
        moved = np.cross(from_tip_mm, self.force_N)
        # A zero is not added: it could change the sign of another.
        moment = np.where(moved == 0.0, self.moment_Nmm, self.moment_Nmm + moved)
        return np.column_stack([self.pressing, -self.force_N[:, :2], -moment])


def indentation_of(job: Job, limb: Limb | None, solver: str) -> tuple[Indentation, Limb]:
    """Protocol and limb of a job that presses an indenter into a limb.

    A tilt of the protocol becomes one of the limb's spot: its normal is the axis of press and twist.

    Raises
    ------
    StudyError
        The job has another protocol or no limb; ``solver`` names the one that needs them.
    """
    if not isinstance(job.protocol, Indentation):
        raise StudyError(
            f"spot '{job.spot}': solver '{solver}' simulates indentations; give the study a [protocol], "
            "or use the solver 'homogeneous'"
        )
    if limb is None:
        raise StudyError(f"spot '{job.spot}': solver '{solver}' needs a mesh; give the spot one in the study")
    return job.protocol, _tilted(limb, job.protocol)


def _tilted(limb: Limb, protocol: Indentation) -> Limb:
    """The limb with the frame of its spot rotated by a vector along x and y of that frame.

    The origin moves back along the new normal by what the tilt lets the indenter overlap the limb, such as
    at the edge of a punch: depth 0 is the first contact.
    """
    tilt_deg = protocol.tilt_deg
    if not any(tilt_deg):
        return limb
    from scipy.spatial.transform import Rotation  # here: slow to import, and few presses are tilted

    axes = spot_axes(limb.spot.normal, limb.spot.along)
    axes = axes @ Rotation.from_rotvec(np.radians([*tilt_deg, 0.0])).as_matrix()
    tilted = replace(limb, spot=replace(limb.spot, normal=axes[:, 2], along=axes[:, 0]))
    allowed, position_mm = _overlap_mm(limb, protocol), limb.spot.position_mm
    # Moves to first contact: a distance is at most the way along the normal, and nearly that at a face.
    for _ in range(3):
        more = _overlap_mm(tilted, protocol) - allowed
        position_mm = position_mm + max(0.0, more) * axes[:, 2]
        tilted = replace(tilted, spot=replace(tilted.spot, position_mm=position_mm))
    return tilted


def _overlap_mm(limb: Limb, protocol: Indentation) -> float:
    """Depth of the nodes of the contact surface inside the indenter at depth 0."""
    mesh = in_spot_frame(limb)
    gaps = protocol.indenter.distance(mesh.points_mm[mesh.node_sets["contact"]])
    return -float(np.min(gaps, initial=0.0))


def pose_of(depth_mm: FloatArray, rotation_deg: FloatArray) -> FloatArray:
    """Poses (n, 6) of a press along the normal and a twist about it (n,)."""
    pose = np.zeros((len(depth_mm), 6))
    pose[:, 0], pose[:, 5] = depth_mm, rotation_deg
    return pose
