"""Error of curves by the mesh: stated by the study, noted with a mesh, shown by two meshes, or as usual."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from palpate.api import FloatArray
from palpate.api.fit import left_over

FORCE = "force"
"""The channel whose error by the mesh is the least."""

AT_RATIO = 0.3
"""Edge under the indenter over its radius for which the errors of :data:`USUAL` are."""

USUAL = {True: 0.03, False: 0.07}
"""Relative error of the normal force, and of other channels, as meshes of the forearm's phantom and of real
limbs show it against meshes with edges of 1.3 mm."""

SCATTER = {True: 0.003, False: 0.012}
"""Relative scatter between extrapolated meshes, of the normal force and of others: no single pair shows it.

Independent meshes of the forearm's phantom differ so much at four spots, and torque by up to twice of it
where the material varies too (``benchmarks/study_stated_mesh.py``).
"""

DOUBT = 0.5
"""Standard deviation of an extrapolation over itself."""

SHARED = 0.8
"""Share of its variance that the meshes of all presses have in common, since they are made alike.

Over four spots of the forearm's phantom it is 0.9 and 0.96 of force and torque on meshes as they are, 0.75
and 0.9 of extrapolated ones (benchmarks/README.md, "Coverage by finite elements").
"""

SHAPE = 0.5
"""Part that varies along the path, over that in proportion to the curve: there 0.26 and 0.56, and 0.5."""

N_SHAPES = 2
"""Cosines of the path of which that part is made."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SpotMesh:
    """Mesh of a spot, as far as its error goes.

    Parameters
    ----------
    edge_over_radius : float
        Mean edge under the indenter over its radius; as :data:`AT_RATIO` if unknown.
    noted : mapping of channel to float
        Relative errors of the note that comes with the mesh.
    refinement : float
        Element size under the indenter over that of the finer mesh; 1 without one.
    locking : float
        Relative error by elements of the solver that lock, added to the error of the mesh.
    """

    edge_over_radius: float = AT_RATIO
    noted: Mapping[str, float] = field(default_factory=dict)
    refinement: float = 1.0
    locking: float = 0.0

    def error(self, channel: str, stated: Mapping[str, float]) -> float:
        """Relative error of a channel: stated by the study, else noted, else as usual for such edges.

        Below :data:`AT_RATIO` it is proportional to the edge, the order that torque shows.

        Parameters
        ----------
        channel : str
        stated : mapping of channel to float
            An empty name is of all channels.
        """
        if (given := stated.get(channel, stated.get(""))) is not None:
            return given
        usual = usual_error(channel, {}) * min(1.0, self.edge_over_radius / AT_RATIO)
        return self.noted.get(channel, usual) + self.locking

    def remainder(self, channel: str, added: FloatArray, fitted: FloatArray) -> FloatArray:
        """Error (n,) that an extrapolated correction leaves, where it adds ``added`` (n,) to a coarse curve.

        :data:`DOUBT` of what is extrapolated; a share of the fitted curve (n,), if that is more: another
        mesh of the same size differs by so much.
        """
        share = left_over(channel, self.refinement)
        left = DOUBT * share / (1.0 + share) * added * (1.0 if added @ fitted > 0.0 else -1.0)
        scattered = SCATTER[channel == FORCE] * fitted
        return left if np.linalg.norm(left) > np.linalg.norm(scattered) else scattered


def independent_parts(error: FloatArray, along: FloatArray) -> list[FloatArray]:
    """Independent parts (n,) of a mesh's error (n,): in its proportion, and varying along the path.

    Parameters
    ----------
    error : (n,) array
        One standard deviation; the squares of the parts sum to its square norm.
    along : (n,) array
        Place on the path, from 0 to 1.
    """
    shapes = [error * np.cos(np.pi * k * along) for k in range(1, N_SHAPES + 1)]
    sizes = [float(np.linalg.norm(shape)) for shape in shapes]
    each = SHAPE * float(np.linalg.norm(error)) / np.sqrt(N_SHAPES)
    parts = [error, *(each / size * shape for shape, size in zip(shapes, sizes, strict=True) if size)]
    return [part / np.sqrt(1.0 + SHAPE**2) for part in parts]


def usual_error(channel: str, stated: Mapping[str, float]) -> float:
    """Relative error of a channel by any mesh: as the study states it, else the usual one."""
    return stated.get(channel, stated.get("", USUAL[channel == FORCE]))


def is_stated(channel: str, stated: Mapping[str, float]) -> bool:
    """True if a study states the mesh's error of a channel."""
    return channel in stated or "" in stated


def noted_errors(note: Mapping[str, object] | None) -> dict[str, float]:
    """Relative errors by channel of a mesh's note; empty where it has none."""
    found = (note or {}).get("mesh_error")
    if not isinstance(found, Mapping):
        return {}
    return {
        str(name): float(value)
        for name, value in found.items()
        if name != "edge_over_radius" and isinstance(value, float) and 0.0 < value < 1.0
    }
