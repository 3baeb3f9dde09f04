"""Numbers that the intervals assume, each with its evidence."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Assumptions:
    """Numbers of the error budget that no study states, chosen on worlds other than those that test them.

    ``benchmarks/README.md`` ("Coverage", "Error by the mesh") has the evidence.

    Parameters
    ----------
    extrapolation : float
        Standard deviation of an extrapolation by two meshes, over its change of the finer mesh's curve. All
        curves of all spots share one amplitude: their meshes are made alike.
    mesh_shared : float
        Share of the variance of a mesh's other errors that all presses have in common.
    mesh_along : float
        Part of these errors that varies along the path, over the part in proportion to the curve.
    unseen_length : float
        Correlation length, in ranges of the abscissa, of a model error that the residuals do not show.
    scale_freedom : float
        Degrees of freedom of the inverse-gamma prior on the scale of all stated errors, which is 1.
    """

    extrapolation: float = 0.5
    mesh_shared: float = 0.8
    mesh_along: float = 0.5
    unseen_length: float = 0.25
    scale_freedom: float = 5.0


ASSUMED = Assumptions()
