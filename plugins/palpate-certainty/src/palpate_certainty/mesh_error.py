"""Error of curves by the mesh: stated by the study, noted with a mesh, shown by two meshes, or as usual."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from palpate.api import FloatArray, MeshConvergence, Refinement
from palpate_certainty.assumptions import ASSUMED

AT_RATIO = 0.3
"""Edge under the indenter over its radius for which a channel's usual error by the mesh is."""

N_SHAPES = 2
"""Cosines of the path, of which the part of one mesh's error that varies along the path is made."""

N_SCATTER = 8
"""Cosines of the path, the constant first, of which the scatter of an extrapolated curve is made."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SpotMesh:
    """Mesh of a spot, as far as its error goes.

    Parameters
    ----------
    edge_over_radius : float
        Mean edge under the indenter over its radius; as :data:`AT_RATIO` if unknown.
    noted : mapping of channel to float
        Relative errors of the note that comes with the mesh.
    refinement : Refinement
        Difference of the finer mesh, if there is one.
    locking : float
        Relative error by elements of the solver that lock, added to the error of the mesh.
    """

    edge_over_radius: float = AT_RATIO
    noted: Mapping[str, float] = field(default_factory=dict)
    refinement: Refinement = field(default_factory=Refinement)
    locking: float = 0.0

    def error(self, channel: str, convergence: MeshConvergence, stated: Mapping[str, float]) -> float:
        """Relative error of a channel: stated by the study, else noted, else as usual for such edges.

        Below :data:`AT_RATIO` it is proportional to the edge.

        Parameters
        ----------
        channel : str
        convergence : MeshConvergence
            Of the channel.
        stated : mapping of channel to float
            An empty name is of all channels.
        """
        if (given := stated_error(channel, stated)) is not None:
            return given
        usual = convergence.usual * min(1.0, self.edge_over_radius / AT_RATIO)
        return self.noted.get(channel, usual) + self.locking

    def of_extrapolation(self, convergence: MeshConvergence, added: FloatArray) -> FloatArray:
        """Error (n,) of a correction that adds ``added`` (n,), a share of the extrapolation with its sign."""
        share = self.refinement.left_over(convergence)
        return ASSUMED.extrapolation * share / (1.0 + share) * added


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
    each = ASSUMED.mesh_along * float(np.linalg.norm(error)) / np.sqrt(N_SHAPES)
    parts = [error, *(each / size * shape for shape, size in zip(shapes, sizes, strict=True) if size)]
    return [part / np.sqrt(1.0 + ASSUMED.mesh_along**2) for part in parts]


def scattered_parts(size: FloatArray, along: FloatArray) -> list[FloatArray]:
    """Independent parts (n,) of the scatter of an extrapolated curve: waves along the path.

    Shorter ones are smaller, by 1 / (1 + (k/3)²) of k half waves; the mean square of all is the size's.

    Parameters
    ----------
    size : (n,) array
        One standard deviation: a share of the largest ordinate.
    along : (n,) array
        Place on the path, from 0 to 1.
    """
    # From three half waves on, a cosine of the scatter is smaller than half of the constant.
    shares = 1.0 / (1.0 + (np.arange(N_SCATTER) / 3.0) ** 2)
    shares /= np.linalg.norm(shares)
    waves = (np.cos(np.pi * k * along) * (np.sqrt(2.0) if k else 1.0) for k in range(N_SCATTER))
    return [share * size * wave for share, wave in zip(shares, waves, strict=True)]


def usual_error(channel: str, convergence: MeshConvergence, stated: Mapping[str, float]) -> float:
    """Relative error of a channel by any mesh: as the study states it, else the usual one."""
    given = stated_error(channel, stated)
    return convergence.usual if given is None else given


def stated_error(channel: str, stated: Mapping[str, float]) -> float | None:
    """Relative error of a channel that a study states, by its name or for all channels; None: none."""
    return stated.get(channel, stated.get(""))


def is_stated(channel: str, stated: Mapping[str, float]) -> bool:
    """True if a study states the mesh's error of a channel."""
    return stated_error(channel, stated) is not None


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
