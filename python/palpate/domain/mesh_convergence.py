"""Error of curves by the mesh: its fall with the element size, by Richardson's extrapolation."""

from dataclasses import dataclass

AT_REACH = 0.2
"""Edge of the finer mesh over the indenter's reach for which a channel's scatter is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshConvergence:
    """Error of a channel's curve by the mesh, and its fall with the element size under the indenter.

    The defaults are of a torque: no channel has a larger error.

    Parameters
    ----------
    rim_order : float
        Power of the element size with which the error falls, where a mesh is refined at the contact's edge.
    order : float
        The same for two meshes that were made apart.
    usual : float
        Relative error of one mesh with edges of 0.3 indenter radii.
    scatter : float
        Standard deviation of extrapolated curves between independent pairs of meshes, over the largest
        ordinate, where edges of the finer mesh are :data:`AT_REACH` of the indenter's reach.
    """

    rim_order: float = 1.7
    order: float = 1.5
    usual: float = 0.07
    scatter: float = 0.0095


@dataclass(frozen=True, slots=True, kw_only=True)
class Refinement:
    """Difference of two meshes of one limb.

    Parameters
    ----------
    ratio : float
        Element size under the indenter, or at the contact's edge, over the finer mesh's; 1: there is none.
    at_rim : bool
        Whether the finer mesh is the first one, refined at the edge of the contact.
    finer_over_reach : float
        Element size of the finer mesh there, over the distance from the spot that the indenter touches.
    """

    ratio: float = 1.0
    at_rim: bool = False
    finer_over_reach: float = AT_REACH

    def scatter(self, mesh: MeshConvergence) -> float:
        """Standard deviation of an extrapolated curve, over its largest ordinate."""
        return mesh.scatter * self.finer_over_reach / AT_REACH

    def left_over(self, mesh: MeshConvergence) -> float:
        """Error of the finer mesh over the difference of both meshes (Richardson): 1 / (ratioᵖ − 1).

        0 without a finer mesh.
        """
        order = mesh.rim_order if self.at_rim else mesh.order
        return 1.0 / (self.ratio**order - 1.0) if self.ratio > 1.0 else 0.0
