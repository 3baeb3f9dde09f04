"""Numerical kernels of palpate, compiled from the Rust in ``crates``, whose documentation says more.

Arrays are float64, of any memory layout; another dtype or number of dimensions is a ``TypeError``
that names the argument. Nothing here knows units: an abscissa may be in mm or degrees, an
ordinate in N or N·mm, as long as the simulated and the measured curve share them.
"""

from typing import Literal, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Deformation",
    "ElementBlock",
    "Measured",
    "SharedPath",
    "SparseFactor",
    "branches",
    "extend_latin_hypercube",
    "geometric",
    "interpolate",
    "latin_hypercube",
    "nmse",
    "normaliser",
    "optimise_design",
    "owen_scramble",
]

_Floats: TypeAlias = NDArray[np.float64]
_Normaliser: TypeAlias = Literal["mean_abs", "mean", "rms", "range", "std", "unit"]

# ------------------------------------------------------------------ curves

def branches(abscissa: _Floats) -> list[tuple[int, int]]:
    """Cut a path (n,), in the order travelled, into its maximal monotone branches.

    Returns ``(start, stop)`` of each branch, half open. Neighbours share their turning point, the last
    point of a plateau. ``CurveError`` for a path that has no two points, is not finite or never moves.
    """

def interpolate(sim_x: _Floats, sim_y: _Floats, at_x: _Floats) -> tuple[_Floats, NDArray[np.bool_]]:
    """Interpolate a simulated path (m,) linearly onto measured abscissae (n,), branch by branch.

    Returns ordinates (n,), NaN where not covered, and whether the simulated path reached each point.
    Nothing is extrapolated. ``CurveError`` also where the branches of the two paths do not correspond.
    """

def nmse(
    sim: _Floats, exp: _Floats, normaliser: _Normaliser = "mean_abs", weights: _Floats | None = None
) -> float:
    """Return Σ w (sim - exp)² / (Σ w · normaliser²) of two curves (n,) at the same points.

    The normaliser is of the whole ``exp``, without weights. ``ScoringError`` where it is degenerate
    (``mean`` below 0.1 rms, any other at most 1e-9 of max(abs(exp))), or a weight is negative.
    """

def normaliser(exp: _Floats, normaliser: _Normaliser = "mean_abs") -> float:
    """Return the normaliser of a measured curve, in the unit of ``exp``; errors as of `nmse`."""

@final
class Measured:
    """A measured curve (n,), in the order travelled, cut and weighted once for all comparisons.

    Normaliser, weights and errors are those of `branches` and `nmse`.
    """

    def __new__(
        cls,
        x: _Floats,
        y: _Floats,
        normaliser: _Normaliser = "mean_abs",
        *,
        weights: _Floats | None = None,
    ) -> Measured: ...
    def along(self, sim_x: _Floats) -> SharedPath:
        """Prepare for simulated curves that share the abscissae ``sim_x`` (m,); errors of `interpolate`."""

@final
class SharedPath:
    """A measured curve ready to score simulated curves that share their abscissae.

    A batch ``sim`` is (n_sets, m): one value for each of the m shared abscissae. A row may end in NaNs;
    then it is scored as the path that it reached. ``CurveError`` for other NaNs and infinite values.
    """

    def score(self, sim: _Floats) -> tuple[_Floats, _Floats]:
        """Score a batch: NMSE over the covered points (n_sets,), and the covered share of the weight.

        The NMSE is NaN for a row without any covered point.
        """

    def gradient(self, sim: _Floats) -> tuple[tuple[_Floats, _Floats], _Floats]:
        """Return the scores of a batch, as `score` does, and ∂NMSE/∂sim (n_sets, m), NaN where ``sim`` is."""

# ----------------------------------------------------------------- designs

def latin_hypercube(n: int, d: int, seed: int, *, centred: bool = False) -> _Floats:
    """Draw a Latin hypercube (n, d) in the open unit cube; a seed gives the same bits everywhere.

    ``centred`` puts each value at the centre of its stratum. A wider design of the same n and seed begins
    with the same columns. ``SamplingError`` where n, d or seed (0 to 2^64 - 1) is out of range.
    """

def extend_latin_hypercube(points: _Floats, n_total: int, seed: int, *, centred: bool = False) -> _Floats:
    """Extend a Latin hypercube (n, d) to (n_total, d); the first n sets stay as they are, bit for bit.

    ``n_total`` is a multiple of n, or a number of strata of which no two sets share one.
    ``SamplingError`` otherwise.
    """

def optimise_design(
    points: _Floats,
    criterion: Literal["cd", "maximin", "correlation"],
    seed: int,
    *,
    n_swaps: int | None = None,
    n_fixed: int | None = None,
) -> _Floats:
    """Reorder the values within each column of a design (n, d), by exchanges that improve a criterion.

    ``cd``: least squared centred L2 discrepancy (Hickernell 1998); ``maximin``: largest distance of the
    two closest sets; ``correlation``: least sum of squared correlations. The criterion never gets worse.
    ``n_swaps`` exchanges are tried, 20 n d and at most 4e9 / (n d) if left out; ``n_fixed`` rows at the
    top stay. ``SamplingError`` for values outside the unit cube or ``n_fixed`` above n.
    """

def owen_scramble(points: _Floats, seed: int) -> _Floats:
    """Scramble a digital net (n, d) in base 2, such as Sobol's, as Owen (1995) does; it stays a net.

    A longer net of the same seed begins with the shorter one's points.
    """

def geometric(shares: _Floats, lower: float, upper: float) -> _Floats:
    """Return lower · (upper / lower)^share for shares (n,) from 0 to 1; the same bits everywhere.

    ``SamplingError`` unless both ends have one sign and are not 0.
    """

# --------------------------------------------------------- finite elements

@final
class ElementBlock:
    """Finite elements of one kind with their reference geometry, for any isotropic energy.

    The material is asked, at `Deformation.stretches`, for the derivatives of its energy in the
    principal stretches.

    Parameters
    ----------
    nodes
        Nodes of each element (e, n).
    gradients
        Shape function gradients in the reference configuration (e, q, n, 3) [1/mm].
    volumes
        Quadrature weight times reference Jacobian (e, q) [mm³]; 0 for a point that only pads.
    mean_dilatation
        The energy is Σ_q w Ψ(F̄) with F̄ = (θ/J)^(1/3) F and θ the element's mean of J; otherwise
        F̄ = F.
    places
        Where each entry of an element's stiffness goes in the values of a sparse matrix
        (e, 3n, 3n). The nine of two nodes lie in three rows of three in sequence, at one distance,
        or all in one place.

    Raises
    ------
    ValueError
        The arrays do not fit one another, an index is negative, places of two nodes are not in such
        rows, a gradient is not finite, or an element has no volume.

    Examples
    --------
    >>> block = ElementBlock(nodes, gradients, volumes, places=places)
    >>> deformation = block.deform(displacements)
    >>> psi_i, psi_ij = principal_derivatives(material, deformation.stretches, theta)
    >>> deformation.add_force(psi_i, forces)
    >>> deformation.add_stiffness(psi_i, psi_ij, values)
    """

    def __new__(
        cls,
        nodes: NDArray[np.int64],
        gradients: _Floats,
        volumes: _Floats,
        *,
        mean_dilatation: bool = True,
        places: NDArray[np.int64] | None = None,
    ) -> ElementBlock: ...
    def deform(self, displacements: _Floats) -> Deformation:
        """Deform the elements by displacements of every node of the mesh (n_nodes, 3) [mm]."""

@final
class Deformation:
    """Where the material of an `ElementBlock` is stretched to, and in which directions.

    Arrays that do not fit the block are a ``ValueError``, those changed in place must be contiguous.
    """

    @property
    def stretches(self) -> _Floats:
        """Principal stretches of F̄ (e, q, 3) in no particular order; NaN where J is not positive."""

    @property
    def least_jacobian(self) -> float:
        """Least J of any quadrature point; NaN if a displacement is not a number."""

    def add_force(self, psi_i: _Floats, total: _Floats) -> None:
        """Add nodal forces to ``total`` (n_nodes, 3) [N], in place.

        They are linear in ``psi_i`` = ∂Ψ/∂λ_i at the stretches (e, q, 3) [MPa].
        """

    def add_stiffness(self, psi_i: _Floats, psi_ij: _Floats, values: _Floats) -> None:
        """Add element stiffnesses to the values of a sparse matrix [N/mm], in place at the block's places.

        They are the exact derivative of the forces. ``psi_ij`` = ∂²Ψ/∂λ_i∂λ_j (e, q, 3, 3) [MPa] is
        symmetric: the upper triangle is read.
        """

@final
class SparseFactor:
    """Factors L B Lᵀ of symmetric, possibly indefinite matrices of one pattern, to precondition with.

    The pattern is ordered (nested dissection) and analysed once; values are factorised as often as
    needed, on one thread, without the GIL, with Bunch-Kaufman pivoting.

    Parameters
    ----------
    indptr, indices
        Compressed rows (n + 1,) and (n_data,) of the whole matrix, int32; indices rise within a row.
    precision
        Of the factor. ``single`` halves memory and time: the matrix is first scaled to a diagonal
        near 1. It serves condition numbers up to about 1e5, ``double`` up to 1e11.
    order
        ``order`` (n,) of a factor of an equal pattern: saves the search, most of the time here.

    Raises
    ------
    ValueError
        The arrays do not describe a square matrix, the indices of a row do not rise, or an entry
        has no counterpart; the order does not have every unknown once.

    Examples
    --------
    >>> factor = SparseFactor(matrix.indptr, matrix.indices, precision="single")
    >>> factor.factorise(matrix.data)
    >>> x, n_steps, converged = factor.krylov(matrix.data, b, 1e-9, 60)
    """

    def __new__(
        cls,
        indptr: NDArray[np.int32],
        indices: NDArray[np.int32],
        *,
        precision: Literal["double", "single"],
        order: NDArray[np.uint32] | None = None,
    ) -> SparseFactor: ...
    def factorise(self, data: _Floats) -> None:
        """Factorise values (n_data,) in the order of ``indices``.

        ``ValueError`` if they are not finite, or not symmetric to 1e-9 of the largest;
        ``numpy.linalg.LinAlgError`` if singular to working precision: a known solution comes back with a
        relative error above 1e-5 (double) or 1e-2 (single). No factor is left then.
        """

    def precondition(self, rhs: _Floats) -> _Floats:
        """Apply the last factor once to ``rhs`` (n,), neither checked nor refined."""

    def krylov(
        self, data: _Floats, rhs: _Floats, tolerance: float, most_steps: int, *, sweep: bool = True
    ) -> tuple[_Floats, int, bool]:
        """Solve with another matrix of the same pattern by GMRES, the last factor preconditioning.

        The matrix, of values ``data`` (n_data,), may be unsymmetric. Preconditioning is from the right, so
        that the residual watched is the true one. It ends at ``tolerance`` (‖b - A x‖ over ‖b‖) or after
        ``most_steps`` applications of the factor. Returns the best solution found, zero at worst, the
        number of applications, and whether the residual is within the tolerance. A ``sweep`` over the rows
        that changed since the factor was made, ahead of it, saves steps; where these are far from symmetric
        it may do harm.
        """

    def krylov_together(
        self, data: _Floats, rhs: _Floats, tolerance: float, most_steps: int, *, sweep: bool = True
    ) -> tuple[_Floats, int, float]:
        """Solve for right-hand sides (m, n) with another matrix of the same pattern, in one space.

        The factor is applied to all residuals at once, and every solution is a combination of all
        directions, of which there are at most ``most_steps``. It ends where each residual is within the
        tolerance or falls no further. Returns solutions (m, n), the number of directions, and
        the largest residual.
        """

    @property
    def order(self) -> NDArray[np.uint32]:
        """Unknowns (n,) in the order of elimination."""

    @property
    def precision(self) -> Literal["double", "single"]:
        """Numbers that the factor is kept in."""
