//! Analyse once, factorise often, precondition with the last factor.

use crate::error::{Error, InputError, NumericalError};
use crate::krylov::Iterated;
use crate::pattern::{self, Pattern};
use crate::precision::{Nearby, Numbers, Precision};

/// Factors L B Lᵀ of symmetric, possibly indefinite matrices whose pattern stays the same, to
/// precondition with.
///
/// # Examples
/// ```
/// use palpate_sparse::{Precision, SparseFactor};
/// // [[4, 1], [1, 3]] by rows.
/// let mut factor = SparseFactor::new(&[0, 2, 4], &[0, 1, 0, 1], Precision::Double)?;
/// factor.factorise(&[4.0, 1.0, 1.0, 3.0])?;
/// let x = factor.precondition(&[1.0, 2.0])?;
/// assert!((x[0] - 1.0 / 11.0).abs() < 1e-15 && (x[1] - 7.0 / 11.0).abs() < 1e-15);
/// # Ok::<(), palpate_sparse::Error>(())
/// ```
pub struct SparseFactor {
    pattern: Pattern,
    numbers: Numbers,
    /// Values of the last factorisation, in the order of the caller's data.
    factored: Vec<f64>,
    /// Whether the last factorisation succeeded.
    is_ready: bool,
}

impl SparseFactor {
    /// Orders and analyses the pattern of a symmetric matrix of `indptr.len() - 1` rows, given by
    /// rows: both triangles, with indices that rise within a row.
    ///
    /// # Errors
    /// [`InputError`] if pointers and indices do not describe such a matrix, or the factor would
    /// exceed memory.
    pub fn new(indptr: &[i32], indices: &[i32], precision: Precision) -> Result<Self, Error> {
        Self::ordered(indptr, indices, precision, None)
    }

    /// As [`Self::new`] with the [`Self::order`] of an equal pattern, whose search takes most of the
    /// time.
    ///
    /// # Errors
    /// As [`Self::new`], and [`InputError`] if `order` does not have every unknown once.
    ///
    /// # Examples
    /// ```
    /// use palpate_sparse::{Precision, SparseFactor};
    /// let (indptr, indices) = ([0, 2, 4], [0, 1, 0, 1]);
    /// let first = SparseFactor::new(&indptr, &indices, Precision::Single)?;
    /// let order = Some(first.order());
    /// let again = SparseFactor::ordered(&indptr, &indices, Precision::Double, order)?;
    /// assert_eq!(again.order(), first.order());
    /// # Ok::<(), palpate_sparse::Error>(())
    /// ```
    pub fn ordered(
        indptr: &[i32],
        indices: &[i32],
        precision: Precision,
        order: Option<&[u32]>,
    ) -> Result<Self, Error> {
        let pattern = Pattern::new(indptr, indices)?;
        let numbers = Numbers::analyse(&pattern, precision, order)?;
        Ok(Self { pattern, numbers, factored: Vec::new(), is_ready: false })
    }

    /// Unknowns in the order of elimination.
    #[must_use]
    pub fn order(&self) -> &[u32] {
        self.numbers.order()
    }

    /// Numbers that the factor is kept in.
    #[must_use]
    pub fn precision(&self) -> Precision {
        self.numbers.precision()
    }

    /// Factorises the values, given in the order of the pattern's indices.
    ///
    /// After an error there is no factor to precondition with.
    ///
    /// # Errors
    /// [`InputError`] if there is not one finite value for every entry, or the matrix is not
    /// symmetric to 1e-9 of its largest entry; [`NumericalError`] if it is singular to working
    /// precision.
    pub fn factorise(&mut self, data: &[f64]) -> Result<(), Error> {
        self.is_ready = false;
        let values = self.pattern.gather(data)?;
        self.numbers.factorise(&self.pattern, &values)?;
        let probe_error = self.probe(&values);
        if probe_error <= self.precision().largest_probe_error() {
            self.is_ready = true;
            self.factored = data.to_vec();
            return Ok(());
        }
        // NaN ends here too.
        Err(match self.precision() {
            Precision::Double => NumericalError::Singular { probe_error },
            Precision::Single => NumericalError::SingularInSingle { probe_error },
        }
        .into())
    }

    /// Applies the last factor once to one right-hand side (n,): neither checked nor refined.
    ///
    /// # Errors
    /// [`InputError`] if there is no factor, or `rhs` is of another length.
    pub fn precondition(&self, rhs: &[f64]) -> Result<Vec<f64>, Error> {
        self.check_ready()?;
        pattern::as_many("rhs", rhs, self.pattern.n())?;
        Ok(self.numbers.apply(rhs))
    }

    /// Solves A x = b for another matrix A of the same pattern by GMRES, preconditioned with the
    /// last factor, and ahead of it, if asked for, with a sweep over the rows that changed since, until
    /// ‖b − A x‖ is at most `tolerance` ‖b‖ or the factor was applied `most_steps` times. A may be
    /// unsymmetric; if it is so by much in the changed rows, a sweep may do harm.
    ///
    /// # Errors
    /// [`InputError`] if there is no factor, or `data` or `rhs` is not finite or of another length.
    ///
    /// # Examples
    /// ```
    /// use palpate_sparse::{Precision, SparseFactor};
    /// let mut factor = SparseFactor::new(&[0, 2, 4], &[0, 1, 0, 1], Precision::Single)?;
    /// factor.factorise(&[4.0, 1.0, 1.0, 3.0])?;
    /// let found = factor.krylov(&[4.0, 1.0, 0.9, 3.0], &[5.0, 3.9], 1e-12, 20, true)?;
    /// assert!(found.residual <= 1e-12);
    /// assert!(found.solution.iter().all(|x| (x - 1.0).abs() < 1e-11));
    /// # Ok::<(), palpate_sparse::Error>(())
    /// ```
    pub fn krylov(
        &self,
        data: &[f64],
        rhs: &[f64],
        tolerance: f64,
        most_steps: usize,
        sweep: bool,
    ) -> Result<Iterated, Error> {
        self.check_ready()?;
        pattern::finite("data", data, self.pattern.n_data())?;
        pattern::finite("rhs", rhs, self.pattern.n())?;
        Ok(self.numbers.iterate(self.nearby(data, sweep), rhs, tolerance, most_steps))
    }

    /// Solves A x = b for several right-hand sides (m, n) as [`Self::krylov`] does for one, all in one
    /// space of directions, of which there are `most_steps` at most: solutions (m, n), how many
    /// directions, and the largest residual.
    ///
    /// # Errors
    /// As [`Self::krylov`].
    pub fn krylov_together(
        &self,
        data: &[f64],
        rhs: &[f64],
        tolerance: f64,
        most_steps: usize,
        sweep: bool,
    ) -> Result<Iterated, Error> {
        self.check_ready()?;
        pattern::finite("data", data, self.pattern.n_data())?;
        let n = self.pattern.n();
        pattern::finite("rhs", rhs, rhs.len().next_multiple_of(n).max(n))?;
        Ok(self.numbers.iterate_together(self.nearby(data, sweep), rhs, tolerance, most_steps))
    }

    fn nearby<'a>(&'a self, data: &'a [f64], sweep: bool) -> Nearby<'a> {
        // Where no row differs there is nothing to sweep over.
        let factored = if sweep { &self.factored } else { data };
        Nearby { rows: self.pattern.rows(), factored, data }
    }

    fn check_ready(&self) -> Result<(), InputError> {
        if self.is_ready { Ok(()) } else { Err(InputError::NotFactorised) }
    }

    /// Relative error with which a known solution comes back: about the condition number times the
    /// rounding unit.
    fn probe(&self, values: &[f64]) -> f64 {
        // A low-discrepancy sequence in [0.5, 1.5): no rigid motion or checkerboard is orthogonal
        // to it, so that its null space shows.
        let golden = 0.618_033_988_749_894_9_f64;
        let mut share = 0.0_f64;
        let known: Vec<f64> = (0..self.pattern.n())
            .map(|i| {
                share = (share + golden).fract();
                (0.5 + share) * self.numbers.scale(i)
            })
            .collect();
        let found = self.numbers.apply(&self.pattern.multiply(values, &known));
        let errors = found.iter().zip(&known).map(|(f, k)| (f - k).abs());
        errors.enumerate().map(|(i, e)| e / self.numbers.scale(i)).fold(0.0, largest)
    }
}

/// The larger of two numbers; NaN if either is.
fn largest(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}
