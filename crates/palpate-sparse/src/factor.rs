//! faer's factorisations behind one enum, in double or single precision.

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::{LltError as NonPositivePivot, LltRegularization};
use faer::perm::PermRef;
use faer::sparse::linalg::cholesky::{
    self, CholeskySymbolicParams, IntranodeLbltRef, LltRef, SymbolicCholesky, SymmetricOrdering,
};
use faer::sparse::linalg::lu::{self, LuRef, LuSymbolicParams, NumericLu, SymbolicLu};
use faer::sparse::linalg::{LuError, SupernodalThreshold};
use faer::sparse::{FaerError, SparseColMatRef};
use faer::traits::RealField;
use faer::{Conj, MatMut, Par, Side, Spec};

use crate::error::{Error, InputError, NumericalError};
use crate::pattern::Pattern;
use crate::solver::Kind;

/// One thread: simulations run side by side instead. With two, these factors gain a quarter.
const PAR: Par = Par::Seq;

/// The blocked variants, whatever the size: their unblocked L B Lᵀ would not pivot.
const BLOCKED: SupernodalThreshold = SupernodalThreshold::FORCE_SUPERNODAL;

/// A factorisation: ordering and structure from the pattern, numbers from the last values.
pub(crate) enum Factor<T> {
    /// P A Q = L U with partial pivoting; columns ordered by COLAMD.
    Lu { symbolic: SymbolicLu<u32>, numeric: NumericLu<u32, T> },
    /// P A Pᵀ = L B Lᵀ with Bunch–Kaufman pivoting inside a supernode; ordered by AMD.
    Ldlt { symbolic: SymbolicCholesky<u32>, numeric: Box<BlockDiagonal<T>> },
    /// P A Pᵀ = L Lᵀ; ordered by AMD.
    Llt { symbolic: SymbolicCholesky<u32>, values: Vec<T> },
}

/// Numbers of L B Lᵀ: B has blocks of one or two rows.
pub(crate) struct BlockDiagonal<T> {
    values: Vec<T>,
    subdiagonal: Vec<T>,
    forward: Vec<u32>,
    inverse: Vec<u32>,
}

impl<T: RealField + Copy + Default> Factor<T> {
    /// Orders and analyses a pattern; the numbers are still to come.
    pub(crate) fn analyse(pattern: &Pattern, kind: Kind) -> Result<Self, Error> {
        let n = pattern.n();
        let failed = |_: FaerError| too_large(pattern);
        if kind == Kind::Lu {
            let params =
                LuSymbolicParams { supernodal_flop_ratio_threshold: BLOCKED, ..Default::default() };
            let symbolic = lu::factorize_symbolic_lu(pattern.columns(), params).map_err(failed)?;
            return Ok(Self::Lu { symbolic, numeric: NumericLu::new() });
        }
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: BLOCKED,
            ..Default::default()
        };
        let (columns, order) = (pattern.columns(), SymmetricOrdering::Amd);
        let symbolic = cholesky::factorize_symbolic_cholesky(columns, Side::Lower, order, params)
            .map_err(failed)?;
        let values = vec![T::default(); symbolic.len_val()];
        Ok(if kind == Kind::Llt {
            Self::Llt { symbolic, values }
        } else {
            let (subdiagonal, forward, inverse) = (vec![T::default(); n], vec![0; n], vec![0; n]);
            let numeric = Box::new(BlockDiagonal { values, subdiagonal, forward, inverse });
            Self::Ldlt { symbolic, numeric }
        })
    }

    /// Computes the numbers. A singular matrix may pass and give infinities or NaN in a solution.
    pub(crate) fn factorise(&mut self, pattern: &Pattern, values: &[T]) -> Result<(), Error> {
        let matrix = SparseColMatRef::new(pattern.columns(), values);
        let side = Side::Lower;
        match self {
            Self::Lu { symbolic, numeric } => {
                let params = Spec::default();
                let mut memory =
                    memory(symbolic.factorize_numeric_lu_scratch::<T>(PAR, params), pattern)?;
                let stack = MemStack::new(&mut memory);
                symbolic
                    .factorize_numeric_lu(numeric, matrix, PAR, stack, params)
                    .map_err(|error| lu_error(error, pattern))?;
            }
            Self::Ldlt { symbolic, numeric } => {
                let params = Spec::default();
                let need = symbolic.factorize_numeric_intranode_lblt_scratch::<T>(PAR, params);
                let mut memory = memory(need, pattern)?;
                let stack = MemStack::new(&mut memory);
                let BlockDiagonal { values, subdiagonal, forward, inverse } = &mut **numeric;
                symbolic.factorize_numeric_intranode_lblt(
                    values,
                    subdiagonal,
                    forward,
                    inverse,
                    matrix,
                    side,
                    PAR,
                    stack,
                    params,
                );
            }
            Self::Llt { symbolic, values } => {
                let params = Spec::default();
                let need = symbolic.factorize_numeric_llt_scratch::<T>(PAR, params);
                let mut memory = memory(need, pattern)?;
                let stack = MemStack::new(&mut memory);
                let shift = LltRegularization::default();
                symbolic
                    .factorize_numeric_llt(values, matrix, side, shift, PAR, stack, params)
                    .map_err(|_: NonPositivePivot| NumericalError::NotPositiveDefinite)?;
            }
        }
        Ok(())
    }

    /// Replaces every column of `rhs` (n, k), row after row, by its solution.
    pub(crate) fn solve(&self, pattern: &Pattern, rhs: &mut [T]) -> Result<(), Error> {
        let n = pattern.n();
        let k = rhs.len() / n;
        let need = match self {
            Self::Lu { symbolic, .. } => symbolic.solve_in_place_scratch::<T>(k, PAR),
            Self::Ldlt { symbolic, .. } | Self::Llt { symbolic, .. } => {
                symbolic.solve_in_place_scratch::<T>(k, PAR)
            }
        };
        let mut memory = memory(need, pattern)?;
        let stack = MemStack::new(&mut memory);
        let rhs = MatMut::from_row_major_slice_mut(rhs, n, k);
        match self {
            Self::Lu { symbolic, numeric } => LuRef::new_unchecked(symbolic, numeric)
                .solve_in_place_with_conj(Conj::No, rhs, PAR, stack),
            Self::Ldlt { symbolic, numeric } => {
                let BlockDiagonal { values, subdiagonal, forward, inverse } = &**numeric;
                let pivots = PermRef::new_checked(forward, inverse, n);
                IntranodeLbltRef::new(symbolic, values, subdiagonal, pivots)
                    .solve_in_place_with_conj(Conj::No, rhs, PAR, stack);
            }
            Self::Llt { symbolic, values } => {
                LltRef::new(symbolic, values).solve_in_place_with_conj(Conj::No, rhs, PAR, stack);
            }
        }
        Ok(())
    }
}

fn memory(need: StackReq, pattern: &Pattern) -> Result<MemBuffer, Error> {
    MemBuffer::try_new(need).map_err(|_| too_large(pattern))
}

fn too_large(pattern: &Pattern) -> Error {
    InputError::TooLarge { n: pattern.n(), n_entries: pattern.n_data() }.into()
}

fn lu_error(error: LuError, pattern: &Pattern) -> Error {
    match error {
        LuError::SymbolicSingular { .. } => {
            NumericalError::Singular { probe_error: f64::NAN }.into()
        }
        LuError::Generic(_) => too_large(pattern),
    }
}
