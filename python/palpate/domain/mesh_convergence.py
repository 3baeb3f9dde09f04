"""Error of curves by the mesh: its fall with the element size, by Richardson's extrapolation."""

from dataclasses import dataclass


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
        ordinate reached so far.
    """

    rim_order: float = 1.8
    order: float = 1.5
    usual: float = 0.07
    scatter: float = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Refinement:
    """Difference of two meshes of one limb.

    Parameters
    ----------
    ratio : float
        Element size under the indenter, or at the contact's edge, over the finer mesh's; 1: there is none.
    at_rim : bool
        Whether the finer mesh is the first one, refined at the edge of the contact.
    """

    ratio: float = 1.0
    at_rim: bool = False

    def left_over(self, mesh: MeshConvergence) -> float:
        """Error of the finer mesh over the difference of both meshes (Richardson): 1 / (ratioᵖ − 1).

        0 without a finer mesh.
        """
        order = mesh.rim_order if self.at_rim else mesh.order
        return 1.0 / (self.ratio**order - 1.0) if self.ratio > 1.0 else 0.0
