"""How far a channel is off because of a spot's mesh, as palpate has measured it or a study states it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from palpate.api import FloatArray
from palpate.api.fit import ORDER

FORCE = "force"
"""The one channel whose error falls with the square of the edges; that of torque and lateral force has a
front of the contact in it, where stresses are singular."""

AT_RATIO = 0.3
"""Edge under the indenter over its radius for which the errors of :data:`USUAL` are."""

USUAL = {True: 0.03, False: 0.07}
"""Relative error of the normal force, and of other channels, as meshes of the forearm's phantom and of real
limbs show it against meshes with edges of 1.3 mm."""

SCATTER = {True: 0.01, False: 0.015}
"""Relative scatter between meshes of one size, of the normal force and of others: no single pair shows it."""


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
    """

    edge_over_radius: float = AT_RATIO
    noted: Mapping[str, float] = field(default_factory=dict)
    refinement: float = 1.0

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
        return self.noted.get(channel, usual)

    def remainder(self, channel: str, added: FloatArray, fitted: FloatArray) -> FloatArray:
        """What the finer mesh leaves of the error (n,), where it adds ``added`` (n,) to the coarse curve.

        By Richardson's extrapolation, of order 1 where it is not the normal force; a share of the fitted
        curve (n,), if that is more: another mesh of the same size differs by so much.
        """
        is_force = channel == FORCE
        left = added / (self.refinement ** (ORDER if is_force else 1) - 1.0)
        scattered = SCATTER[is_force] * fitted
        return left if np.linalg.norm(left) > np.linalg.norm(scattered) else scattered


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
