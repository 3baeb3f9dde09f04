"""Numerical kernels of palpate, compiled from the Rust in ``crates``.

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

def branches(abscissa: _Floats) -> list[tuple[int, int]]:
    """Cut a path into its maximal monotone branches.

    Parameters
    ----------
    abscissa
        Depth or rotation (n,) in the order in which it was travelled.

    Returns
    -------
    list[tuple[int, int]]
        ``(start, stop)`` of each branch, half open. Neighbours share their turning point: the next
        ``start`` is this ``stop - 1``. A plateau belongs to the run before it (to the run after
        it if it comes first), so the turning point is the last point of a plateau.

    Raises
    ------
    palpate.errors.CurveError
        Empty, a single point, NaN or infinite, or never moves.

    Examples
    --------
    >>> branches(np.array([0.0, -20.0, 0.0, 20.0, 0.0]))
    [(0, 2), (1, 4), (3, 5)]
    """

def interpolate(sim_x: _Floats, sim_y: _Floats, at_x: _Floats) -> tuple[_Floats, NDArray[np.bool_]]:
    """Interpolate a simulated path linearly onto measured abscissae, branch by branch.

    The k-th simulated branch answers for the k-th measured branch; a turning point is answered by
    the earlier of its two branches. Nothing is extrapolated: a measured point may overshoot the
    end of its simulated branch by 1e-9 of the measured span (round-off), and then takes the value
    at the end. Where the simulated path holds still, the value with which it moves on counts.

    Parameters
    ----------
    sim_x, sim_y
        Simulated path (m,) in the order travelled.
    at_x
        Measured abscissae (n,) in the order travelled.

    Returns
    -------
    values
        Ordinates (n,); NaN where not covered.
    covered
        Whether the simulated path reached the point (n,). A simulation that ended early leaves the
        rest uncovered.

    Raises
    ------
    palpate.errors.CurveError
        As for `branches`; lengths differ; a simulated branch runs against its measured
        counterpart; or the simulated path has more branches than the measured one.
    """

def nmse(
    sim: _Floats,
    exp: _Floats,
    normaliser: _Normaliser = "mean_abs",
    weights: _Floats | None = None,
) -> float:
    """Return Σ w (sim - exp)² / (Σ w · normaliser²) of two curves at the same points.

    Parameters
    ----------
    sim, exp
        Simulated and measured ordinates (n,), in one unit.
    normaliser
        ``mean_abs``: mean(abs(exp)); ``mean``: abs(mean(exp)); ``rms``; ``range``: max - min;
        ``std``: population standard deviation; ``unit``: 1, which makes it a plain mean
        squared error. Always of the whole ``exp``, without weights.
    weights
        Weight of each point (n,), not negative; equal weights of any size change nothing.

    Returns
    -------
    float
        NMSE, dimensionless; 0 exactly when the curves agree wherever the weight is positive.

    Raises
    ------
    palpate.errors.CurveError
        Empty, NaN or infinite, or lengths differ.
    palpate.errors.ScoringError
        Unknown or degenerate normaliser (``mean`` below 0.1 rms, as on a symmetric twist; any
        other at most 1e-9 of max(abs(exp))); negative, all-zero or too few weights.

    Examples
    --------
    >>> round(nmse(np.array([1.1, 2.2]), np.array([1.0, 2.0]), "rms"), 12)
    0.01
    """

def normaliser(exp: _Floats, normaliser: _Normaliser = "mean_abs") -> float:
    """Return the normaliser of a measured curve, in the unit of ``exp``.

    Parameters and errors are those of `nmse`.

    Examples
    --------
    >>> normaliser(np.array([-1.0, 2.0, 6.0]))
    3.0
    """

@final
class Measured:
    """A measured curve, cut and weighted once for all that it is compared with.

    Parameters
    ----------
    x, y
        Measured path (n,) in the order travelled.
    normaliser, weights
        As for `nmse`; one weight for each measured point.

    Raises
    ------
    palpate.errors.CurveError
        A path that `branches` refuses, a value that is not finite, or lengths that differ.
    palpate.errors.ScoringError
        As for `nmse`.

    Examples
    --------
    >>> measured = Measured(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 4.0]))
    >>> nmse, coverage = measured.along(np.array([0.0, 1.0])).score(np.array([[0.0, 1.0]]))
    >>> nmse.tolist(), coverage.round(3).tolist()
    ([0.0], [0.667])
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
        """Make the curve ready for simulated curves that share the abscissae ``sim_x`` (m,).

        Raises
        ------
        palpate.errors.CurveError
            As for `interpolate`.
        """

@final
class SharedPath:
    """A measured curve ready to score simulated curves that share their abscissae.

    Made by `Measured.along`. A batch ``sim`` is (n_sets, m): one value for each of the m shared
    abscissae. A row may end in NaNs; then it is scored as the path that it reached.

    Examples
    --------
    >>> measured = Measured(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 4.0]))
    >>> path = measured.along(np.array([0.0, 2.0]))
    >>> nmse, coverage = path.score(np.array([[0.0, 4.0], [0.0, 2.0]]))
    >>> nmse.round(12).tolist()
    [0.12, 0.48]
    """

    def score(self, sim: _Floats) -> tuple[_Floats, _Floats]:
        """Score a batch, at a cost per curve that does not grow with the measured points.

        Parameters
        ----------
        sim
            Simulated ordinates (n_sets, m).

        Returns
        -------
        nmse
            NMSE over the covered points (n_sets,); NaN for a row without any.
        coverage
            Weight of the covered points over the weight of all (n_sets,), 0 to 1.

        Raises
        ------
        palpate.errors.CurveError
            Another number of values, an infinite value, or a NaN that values follow.
        """

    def gradient(self, sim: _Floats) -> tuple[tuple[_Floats, _Floats], _Floats]:
        """Return the scores of a batch, as `score` does, and ∂NMSE/∂sim (n_sets, m).

        The gradient is NaN where ``sim`` is.
        """

    def best_scale(
        self, sim: _Floats, lower: float = 0.0, upper: float = ...
    ) -> tuple[_Floats, tuple[_Floats, _Floats]]:
        """Find the scale from ``lower`` to ``upper`` at which each curve scores best.

        A material whose moduli are all multiplied by s answers with s times the force, so that one
        simulation scores the whole ray of its multiples.

        Returns
        -------
        scale
            Factor on each curve (n_sets,); NaN for a curve of zeros.
        scores
            NMSE and coverage at that scale, as of `score`.

        Raises
        ------
        palpate.errors.CurveError
            As for `score`.
        palpate.errors.ScoringError
            The bounds are no range.
        """

def latin_hypercube(n: int, d: int, seed: int, *, centred: bool = False) -> _Floats:
    """Draw a Latin hypercube of n sets in the open unit cube of d parameters.

    In every column each of the n strata (k/n, (k+1)/n) holds exactly one value. A seed gives the
    same bits on every platform and in every version (xoshiro256++, SplitMix64, Fisher-Yates).

    Parameters
    ----------
    n, d
        Number of sets and of parameters, at least 1; n·d at most 2^28.
    seed
        0 to 2^64 - 1. A wider design of the same n and seed begins with the same columns.
    centred
        Put each value at the centre of its stratum instead of a random place; the strata are
        those of the design that is not centred.

    Returns
    -------
    NDArray[np.float64]
        Design (n, d), strictly between 0 and 1.

    Raises
    ------
    palpate.errors.SamplingError
        n, d or seed is out of range.
    """

def extend_latin_hypercube(points: _Floats, n_total: int, seed: int, *, centred: bool = False) -> _Floats:
    """Extend a Latin hypercube; the sets there are stay as they are, bit for bit.

    In every column each of the n_total strata holds one value in the end: the new sets take the
    strata that ``points`` leaves empty, in random order. A seed gives the same bits everywhere.

    Parameters
    ----------
    points
        Latin hypercube (n, d) in the unit cube.
    n_total
        Sets in all: any multiple of n, or a number of strata of which no two sets share one.
    seed
        0 to 2^64 - 1; the one of ``points`` will do.
    centred
        Put each new value at the centre of its stratum instead of a random place.

    Returns
    -------
    NDArray[np.float64]
        Design (n_total, d) that begins with ``points``.

    Raises
    ------
    palpate.errors.SamplingError
        Values outside of the unit cube, ``n_total`` not above n, or two values of a column in one
        of the finer strata.

    Examples
    --------
    >>> four = latin_hypercube(4, 2, seed=1)
    >>> eight = extend_latin_hypercube(four, 8, seed=1)
    >>> bool((eight[:4] == four).all())
    True
    """

def optimise_design(
    points: _Floats,
    criterion: Literal["cd", "maximin", "correlation"],
    seed: int,
    *,
    n_swaps: int | None = None,
    n_fixed: int | None = None,
) -> _Floats:
    """Reorder the values within each column of a design for the better.

    Each column keeps its values, so a Latin hypercube stays one. The search exchanges two values
    of a column where that helps, or harms less than a falling threshold; the two come from ever
    closer strata. The criterion never gets worse, and a seed gives the same bits everywhere.

    Parameters
    ----------
    points
        Design (n, d) in the unit cube.
    criterion
        ``cd``: least squared centred L2 discrepancy (Hickernell 1998); ``maximin``: largest
        distance of the two closest sets; ``correlation``: least sum of squared correlations.
    seed
        0 to 2^64 - 1; the one of ``points`` will do.
    n_swaps
        Exchanges tried, each O(n d), or O(d) for ``correlation``. If left out, 20 n d, but
        never more than 4e9 / (n d).
    n_fixed
        Rows at the top that stay as they are, for the new sets of an extended design; 0 if
        left out.

    Returns
    -------
    NDArray[np.float64]
        Design (n, d).

    Raises
    ------
    palpate.errors.SamplingError
        Values outside of the unit cube, an unknown criterion, or ``n_fixed`` above n.

    Examples
    --------
    >>> drawn = latin_hypercube(50, 3, seed=1, centred=True)
    >>> better = optimise_design(drawn, "cd", seed=1)
    >>> bool((np.sort(better, axis=0) == np.sort(drawn, axis=0)).all())
    True
    """

def owen_scramble(points: _Floats, seed: int) -> _Floats:
    """Scramble the points of a digital net in base 2, such as Sobol's, as Owen (1995) does.

    Each of 32 binary digits of a value is flipped or not, as decided once for the column, the
    digit and all digits before it. The net stays a net, each point becomes uniform in the cube,
    and a longer net of the same seed begins with the shorter one's points.

    Parameters
    ----------
    points
        Net (n, d) in the unit cube.
    seed
        0 to 2^64 - 1.

    Returns
    -------
    NDArray[np.float64]
        Net (n, d), strictly between 0 and 1.

    Raises
    ------
    palpate.errors.SamplingError
        Empty, or values outside of the unit cube.
    """

def geometric(shares: _Floats, lower: float, upper: float) -> _Floats:
    """Return lower · (upper / lower)^share for each share of a range; the same bits everywhere.

    Parameters
    ----------
    shares
        Between 0 and 1, (n,).
    lower, upper
        Ends of one sign, not 0.

    Returns
    -------
    NDArray[np.float64]
        Values (n,) between the ends; exactly an end at 0 and 1.

    Raises
    ------
    palpate.errors.SamplingError
        A range without a logarithm, or a share outside of 0 to 1.

    Examples
    --------
    >>> geometric(np.array([0.0, 0.5, 1.0]), 1.0, 100.0)
    array([  1.,  10., 100.])
    """

@final
class ElementBlock:
    """Finite elements of one kind with their reference geometry, for any isotropic energy.

    Everything of an element but its material: deformation, principal directions, mean dilatation,
    the stiffness and its way into a sparse matrix. The material is asked, at
    `Deformation.stretches`, for the derivatives of its energy in the principal stretches.

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
        (e, 3n, 3n).

    Raises
    ------
    ValueError
        The arrays do not fit one another, an index is negative, a gradient is not finite, or an
        element has no volume.

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
        """Deform the elements.

        Parameters
        ----------
        displacements
            Of every node of the mesh (n_nodes, 3) [mm].

        Raises
        ------
        ValueError
            The block has a node beyond them.
        """

@final
class Deformation:
    """Where the material of an `ElementBlock` is stretched to, and in which directions."""

    @property
    def stretches(self) -> _Floats:
        """Principal stretches of F̄ (e, q, 3) in no particular order; NaN where J is not positive."""

    @property
    def least_jacobian(self) -> float:
        """Least J of any quadrature point; NaN if a displacement is not a number."""

    def add_force(self, psi_i: _Floats, total: _Floats) -> None:
        """Add nodal forces to those of other blocks.

        They are linear in ``psi_i``: its derivative in a parameter gives theirs.

        Parameters
        ----------
        psi_i
            ∂Ψ/∂λ_i at the stretches (e, q, 3) [MPa].
        total
            Nodal forces (n_nodes, 3) [N], changed in place.

        Raises
        ------
        ValueError
            An array does not fit the block.
        TypeError
            ``total`` is not contiguous.
        """

    def add_stiffness(self, psi_i: _Floats, psi_ij: _Floats, values: _Floats) -> None:
        """Add element stiffnesses, the exact derivative of the forces, to the values of a sparse matrix.

        Parameters
        ----------
        psi_i
            ∂Ψ/∂λ_i at the stretches (e, q, 3) [MPa].
        psi_ij
            ∂²Ψ/∂λ_i∂λ_j (e, q, 3, 3) [MPa], symmetric: the upper triangle is read.
        values
            Values of the sparse matrix [N/mm], changed in place at the block's places.

        Raises
        ------
        ValueError
            An array does not fit the block, or the block has no places.
        TypeError
            ``values`` is not contiguous.
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

    Raises
    ------
    ValueError
        The arrays do not describe a square matrix, the indices of a row do not rise, or an entry
        has no counterpart.

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
    ) -> SparseFactor: ...
    def factorise(self, data: _Floats) -> None:
        """Factorise new values.

        Parameters
        ----------
        data
            Values (n_data,) in the order of ``indices``.

        Raises
        ------
        ValueError
            Wrong length, NaN or infinite, or not symmetric to 1e-9 of the largest value.
        numpy.linalg.LinAlgError
            Singular to working precision: a known solution comes back with a relative error above
            1e-5, or 1e-2 in single precision. No factor is left then.
        """

    def precondition(self, rhs: _Floats) -> _Floats:
        """Apply the last factor once, neither checked nor refined.

        Parameters
        ----------
        rhs
            Right-hand side (n,).

        Returns
        -------
        NDArray[np.float64]
            Approximate solution (n,), as good as the factor. What is not finite in ``rhs`` comes
            back as such.

        Raises
        ------
        ValueError
            No factor or wrong length.
        """

    def krylov(
        self, data: _Floats, rhs: _Floats, tolerance: float, most_steps: int
    ) -> tuple[_Floats, int, bool]:
        """Solve with another matrix of the same pattern by GMRES, the last factor preconditioning.

        Right preconditioning, so that the residual watched is the true one, and restarts with a
        residual in double precision. Cycles run in the precision of the factor. The matrix may be
        unsymmetric.

        Parameters
        ----------
        data
            Values (n_data,) of the matrix in the order of ``indices``.
        rhs
            Right-hand side (n,).
        tolerance
            Residual ‖b - A x‖ at which to end, relative to ‖b‖.
        most_steps
            Applications of the factor at most.

        Returns
        -------
        solution
            Best solution found (n,), zero at worst.
        n_steps
            Applications of the factor.
        converged
            Whether the residual is within the tolerance.

        Raises
        ------
        ValueError
            No factor, wrong length, NaN or infinite.
        """

    @property
    def precision(self) -> Literal["double", "single"]:
        """Numbers that the factor is kept in."""
