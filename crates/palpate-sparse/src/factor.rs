//! faer's factorisation P A Pᵀ = L B Lᵀ, in double or single precision.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::sparse::linalg::cholesky::{
    self, CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
};
use faer::sparse::{FaerError, SparseColMatRef};
use faer::{Conj, MatMut, Par, Side, Spec};

use crate::error::InputError;
use crate::ordering::elimination_order;
use crate::panels::Tiled;
use crate::pattern::Pattern;
use crate::triangular_solve::TriangularSolve;

/// One thread: simulations run side by side instead. With two, these factors gain a quarter.
const PAR: Par = Par::Seq;

/// The blocked variant for any size: the unblocked one would not pivot.
const BLOCKED: SupernodalThreshold = SupernodalThreshold::FORCE_SUPERNODAL;

/// A factorisation: structure from the pattern, ordered by nested dissection, and numbers from the
/// last values. B has blocks of one or two rows from Bunch–Kaufman pivoting inside supernodes.
pub(crate) struct Factor<T: Tiled> {
    symbolic: SymbolicCholesky<u32>,
    values: Vec<T>,
    /// Entries of B off the diagonal.
    subdiagonal: Vec<T>,
    /// Which row is now at a place after pivoting, and where a row now is.
    moved: Vec<u32>,
    places: Vec<u32>,
    triangles: TriangularSolve<T>,
}

impl<T: Tiled> Factor<T> {
    /// Orders a pattern, unless there is an order of elimination, and analyses it; the numbers are
    /// still to come.
    pub(crate) fn analyse(pattern: &Pattern, order: Option<&[u32]>) -> Result<Self, InputError> {
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: BLOCKED,
            ..Default::default()
        };
        let order = match order {
            Some(order) => checked(order, pattern.n())?,
            None => elimination_order(pattern.n(), pattern.entries()),
        };
        let inverse = inverted(&order);
        let order = SymmetricOrdering::Custom(PermRef::new_checked(&order, &inverse, pattern.n()));
        let columns = pattern.columns();
        let symbolic = cholesky::factorize_symbolic_cholesky(columns, Side::Lower, order, params)
            .map_err(|_: FaerError| too_large(pattern))?;
        let values = vec![T::default(); symbolic.len_val()];
        let triangles = TriangularSolve::new(supernodal(&symbolic));
        let (subdiagonal, moved) = (vec![T::default(); pattern.n()], vec![0; pattern.n()]);
        Ok(Self { symbolic, values, subdiagonal, places: moved.clone(), moved, triangles })
    }

    /// Unknowns in the order of elimination.
    pub(crate) fn order(&self) -> &[u32] {
        order(&self.symbolic)
    }

    /// Computes the numbers. A singular matrix may pass and give infinities or NaN in a solution.
    pub(crate) fn factorise(&mut self, pattern: &Pattern, values: &[T]) -> Result<(), InputError> {
        let Self { symbolic, values: factor, subdiagonal, moved, places, triangles } = self;
        let params = Spec::default();
        let need = symbolic.factorize_numeric_intranode_lblt_scratch::<T>(PAR, params);
        let mut memory = MemBuffer::try_new(need).map_err(|_| too_large(pattern))?;
        symbolic.factorize_numeric_intranode_lblt(
            factor,
            subdiagonal,
            moved,
            places,
            SparseColMatRef::new(pattern.columns(), values),
            Side::Lower,
            PAR,
            MemStack::new(&mut memory),
            params,
        );
        let pivots = (&moved[..], &places[..]);
        triangles.take(order(symbolic), supernodal(symbolic), factor, subdiagonal, pivots);
        Ok(())
    }

    /// Solves for one right-hand side with the factor as it is, in place.
    pub(crate) fn solve(&self, rhs: &mut [T]) {
        let n = rhs.len();
        let pivots = PermRef::new_checked(&self.moved, &self.places, n);
        let factor = cholesky::IntranodeLbltRef::new(
            &self.symbolic,
            &self.values,
            &self.subdiagonal,
            pivots,
        );
        let mut memory = MemBuffer::new(self.symbolic.solve_in_place_scratch::<T>(1, PAR));
        let rhs = MatMut::from_column_major_slice_mut(rhs, n, 1);
        factor.solve_in_place_with_conj(Conj::No, rhs, PAR, MemStack::new(&mut memory));
    }

    /// Solves with the packed factor for `n_rhs` right-hand sides: `read(k, unknown)` gives the k-th, `write(k, unknown, value)`
    /// takes its solution; `work` is kept from call to call.
    pub(crate) fn apply(
        &self,
        n_rhs: usize,
        work: &mut Vec<T>,
        read: impl Fn(usize, usize) -> T,
        write: impl FnMut(usize, usize, T),
    ) {
        self.triangles.apply(n_rhs, work, read, write);
    }
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

/// The order, if it has every unknown once.
fn checked(order: &[u32], n: usize) -> Result<Vec<u32>, InputError> {
    let mut seen = vec![false; n];
    let fresh = |&unknown: &u32| {
        seen.get_mut(unknown as usize).is_some_and(|seen| !std::mem::replace(seen, true))
    };
    let sound = order.len() == n && order.iter().all(fresh);
    if sound { Ok(order.to_vec()) } else { Err(InputError::Order { n }) }
}

fn inverted(order: &[u32]) -> Vec<u32> {
    let mut inverse = vec![0; order.len()];
    order.iter().zip(0..).for_each(|(&unknown, step)| inverse[unknown as usize] = step);
    inverse
}

fn too_large(pattern: &Pattern) -> InputError {
    InputError::TooLarge { n: pattern.n(), n_entries: pattern.n_data() }
}
