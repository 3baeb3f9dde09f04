//! faer's factorisations behind one enum, in double or single precision.

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::{LltError as NonPositivePivot, LltRegularization};
use faer::perm::PermRef;
use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::sparse::linalg::cholesky::{
    self, CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
};
use faer::sparse::linalg::lu::{self, LuRef, LuSymbolicParams, NumericLu, SymbolicLu};
use faer::sparse::linalg::{LuError, SupernodalThreshold};
use faer::sparse::{FaerError, SparseColMatRef};
use faer::{Conj, MatMut, Par, Side, Spec};

use crate::error::{Error, InputError, NumericalError};
use crate::ordering::elimination_order;
use crate::pattern::Pattern;
use crate::solver::Kind;
use crate::sweep::{Number, Sweep};

/// One thread: simulations run side by side instead. With two, these factors gain a quarter.
const PAR: Par = Par::Seq;

/// The blocked variants, whatever the size: their unblocked L B Lᵀ would not pivot.
const BLOCKED: SupernodalThreshold = SupernodalThreshold::FORCE_SUPERNODAL;

/// A factorisation: ordering and structure from the pattern, numbers from the last values.
pub(crate) enum Factor<T> {
    /// P A Q = L U with partial pivoting; columns ordered by COLAMD.
    Lu { symbolic: SymbolicLu<u32>, numeric: NumericLu<u32, T> },
    /// P A Pᵀ = L B Lᵀ, ordered by nested dissection. For `ldlt`, B has blocks of one or two rows
    /// from Bunch–Kaufman pivoting inside supernodes; for `llt`, there is no B.
    Symmetric { symbolic: SymbolicCholesky<u32>, values: Vec<T>, sweep: Sweep<T>, pivoting: bool },
}

impl<T: Number> Factor<T> {
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
        let order = elimination_order(n, pattern.entries());
        let inverse = inverted(&order);
        let order = SymmetricOrdering::Custom(PermRef::new_checked(&order, &inverse, n));
        let columns = pattern.columns();
        let symbolic = cholesky::factorize_symbolic_cholesky(columns, Side::Lower, order, params)
            .map_err(failed)?;
        let values = vec![T::default(); symbolic.len_val()];
        let sweep = Sweep::new(supernodal(&symbolic));
        Ok(Self::Symmetric { symbolic, values, sweep, pivoting: kind == Kind::Ldlt })
    }

    /// Computes the numbers. A singular matrix may pass and give infinities or NaN in a solution.
    pub(crate) fn factorise(&mut self, pattern: &Pattern, values: &[T]) -> Result<(), Error> {
        let matrix = SparseColMatRef::new(pattern.columns(), values);
        match self {
            Self::Lu { symbolic, numeric } => {
                let params = Spec::default();
                let mut memory =
                    memory(symbolic.factorize_numeric_lu_scratch::<T>(PAR, params), pattern)?;
                let stack = MemStack::new(&mut memory);
                symbolic
                    .factorize_numeric_lu(numeric, matrix, PAR, stack, params)
                    .map_err(|error| lu_error(error, pattern))?;
                Ok(())
            }
            Self::Symmetric { symbolic, values, sweep, pivoting: true } => {
                pivoted(symbolic, values, sweep, matrix, pattern)
            }
            Self::Symmetric { symbolic, values, sweep, pivoting: false } => {
                let params = Spec::default();
                let need = symbolic.factorize_numeric_llt_scratch::<T>(PAR, params);
                let mut memory = memory(need, pattern)?;
                let stack = MemStack::new(&mut memory);
                let shift = LltRegularization::default();
                symbolic
                    .factorize_numeric_llt(values, matrix, Side::Lower, shift, PAR, stack, params)
                    .map_err(|_: NonPositivePivot| NumericalError::NotPositiveDefinite)?;
                sweep.without_pivoting(order(symbolic), values);
                Ok(())
            }
        }
    }

    /// Numbers in a workspace of [`Self::apply`].
    pub(crate) fn n_work(&self) -> usize {
        match self {
            Self::Lu { symbolic, .. } => symbolic.nrows(),
            Self::Symmetric { sweep, .. } => sweep.n_work(),
        }
    }

    /// Solves for one right-hand side: `read(unknown)` gives it, `write(unknown, value)` takes the
    /// solution, and `work` has [`Self::n_work`] numbers.
    pub(crate) fn apply(
        &self,
        pattern: &Pattern,
        work: &mut [T],
        read: impl Fn(usize) -> T,
        mut write: impl FnMut(usize, T),
    ) -> Result<(), Error> {
        match self {
            Self::Symmetric { values, sweep, .. } => sweep.apply(values, work, read, write),
            Self::Lu { symbolic, numeric } => {
                work.iter_mut().enumerate().for_each(|(i, x)| *x = read(i));
                let mut memory = memory(symbolic.solve_in_place_scratch::<T>(1, PAR), pattern)?;
                let stack = MemStack::new(&mut memory);
                let x = MatMut::from_column_major_slice_mut(work, pattern.n(), 1);
                LuRef::new_unchecked(symbolic, numeric).solve_in_place_with_conj(
                    Conj::No,
                    x,
                    PAR,
                    stack,
                );
                work.iter().enumerate().for_each(|(i, x)| write(i, *x));
            }
        }
        Ok(())
    }
}

fn pivoted<T: Number>(
    symbolic: &SymbolicCholesky<u32>,
    values: &mut [T],
    sweep: &mut Sweep<T>,
    matrix: SparseColMatRef<'_, u32, T>,
    pattern: &Pattern,
) -> Result<(), Error> {
    let (n, params) = (pattern.n(), Spec::default());
    let need = symbolic.factorize_numeric_intranode_lblt_scratch::<T>(PAR, params);
    let mut memory = memory(need, pattern)?;
    let stack = MemStack::new(&mut memory);
    let (mut beside, mut moved, mut places) = (vec![T::default(); n], vec![0; n], vec![0; n]);
    symbolic.factorize_numeric_intranode_lblt(
        values,
        &mut beside,
        &mut moved,
        &mut places,
        matrix,
        Side::Lower,
        PAR,
        stack,
        params,
    );
    let pivots = (&moved[..], &places[..]);
    sweep.with_pivoting(order(symbolic), supernodal(symbolic), values, &beside, pivots);
    Ok(())
}

/// Unknowns in the order of the analysis.
fn order(symbolic: &SymbolicCholesky<u32>) -> &[u32] {
    symbolic.perm().map_or(&[], |perm| perm.arrays().0)
}

fn supernodal(symbolic: &SymbolicCholesky<u32>) -> &SymbolicSupernodalCholesky<u32> {
    match symbolic.raw() {
        SymbolicCholeskyRaw::Supernodal(supernodal) => supernodal,
        SymbolicCholeskyRaw::Simplicial(_) => unreachable!("the blocked variant is forced"),
    }
}

fn inverted(order: &[u32]) -> Vec<u32> {
    let mut inverse = vec![0; order.len()];
    order.iter().zip(0..).for_each(|(&unknown, step)| inverse[unknown as usize] = step);
    inverse
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
