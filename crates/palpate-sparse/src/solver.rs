//! Analyse once, factorise often, solve with the last factor, and never return a bad solution.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, InputError, NumericalError};
use crate::krylov::Iterated;
use crate::pattern::{self, Layout, Pattern};
use crate::precision::{Numbers, Precision};

/// A solution with a larger backward error is refined.
pub const GOOD_BACKWARD_ERROR: f64 = 1e-13;

/// A refined solution with a larger backward error is an error.
pub const LARGEST_BACKWARD_ERROR: f64 = 1e-9;

/// Which factorisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Kind {
    /// Any matrix: L U with partial pivoting.
    #[default]
    Lu,
    /// Symmetric, possibly indefinite: L B Lᵀ with pivots of one or two rows.
    Ldlt,
    /// Symmetric and positive definite: L Lᵀ.
    Llt,
}

impl Kind {
    /// The name in Python.
    ///
    /// ```
    /// assert_eq!(palpate_sparse::Kind::Ldlt.name(), "ldlt");
    /// ```
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Lu => "lu",
            Self::Ldlt => "ldlt",
            Self::Llt => "llt",
        }
    }
}

impl FromStr for Kind {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        [Self::Lu, Self::Ldlt, Self::Llt].into_iter().find(|k| k.name() == name).ok_or_else(|| {
            let (name, choices) = (name.to_owned(), "lu, ldlt or llt");
            InputError::Unknown { what: "kind", name, choices }.into()
        })
    }
}

/// A direct solver of A x = b for a pattern that stays the same.
///
/// # Examples
/// ```
/// use palpate_sparse::{Kind, Layout, Precision, SparseFactor};
/// // [[4, 1], [1, 3]] by columns.
/// let (indptr, indices) = ([0, 2, 4], [0, 1, 0, 1]);
/// let mut factor =
///     SparseFactor::new(&indptr, &indices, Layout::Csc, Kind::Ldlt, Precision::Double)?;
/// factor.factorise(&[4.0, 1.0, 1.0, 3.0])?;
/// let x = factor.solve(&[1.0, 2.0], 1)?;
/// assert!((x[0] - 1.0 / 11.0).abs() < 1e-15 && (x[1] - 7.0 / 11.0).abs() < 1e-15);
/// # Ok::<(), palpate_sparse::Error>(())
/// ```
pub struct SparseFactor {
    kind: Kind,
    pattern: Pattern,
    numbers: Numbers,
    /// Values of the last factorisation that succeeded.
    current: Option<Current>,
}

/// What a residual needs.
struct Current {
    values: Vec<f64>,
    norm: f64,
    probe_error: f64,
}

impl fmt::Debug for SparseFactor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ready = self.current.is_some();
        write!(f, "SparseFactor({}, n={}, ready={ready})", self.kind.name(), self.n())
    }
}

impl SparseFactor {
    /// Orders and analyses the pattern of a square matrix with `indptr.len() - 1` rows.
    ///
    /// `ldlt` and `llt` take the lower triangle alone or a symmetric pattern.
    ///
    /// # Errors
    /// [`InputError`] as for [`Pattern::new`], or if the factor would exceed memory.
    pub fn new<I: Copy + Into<i64>>(
        indptr: &[I],
        indices: &[I],
        layout: Layout,
        kind: Kind,
        precision: Precision,
    ) -> Result<Self, Error> {
        let pattern = Pattern::new(indptr, indices, layout, kind != Kind::Lu)?;
        let numbers = Numbers::analyse(&pattern, kind, precision)?;
        Ok(Self { kind, pattern, numbers, current: None })
    }

    /// Rows of the matrix.
    #[must_use]
    pub fn n(&self) -> usize {
        self.pattern.n()
    }

    /// Values that [`Self::factorise`] takes.
    #[must_use]
    pub fn n_data(&self) -> usize {
        self.pattern.n_data()
    }

    /// Which factorisation.
    #[must_use]
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// Numbers that the factor is kept in.
    #[must_use]
    pub fn precision(&self) -> Precision {
        self.numbers.precision()
    }

    /// Relative error with which a known solution came back from the current factor: about its
    /// condition number times the rounding unit of its precision. `None` without a factor.
    #[must_use]
    pub fn probe_error(&self) -> Option<f64> {
        self.current.as_ref().map(|current| current.probe_error)
    }

    /// Factorises the values, given in the order of the pattern's indices.
    ///
    /// After an error there is no factor to solve with.
    ///
    /// # Errors
    /// [`InputError`] as for [`Pattern::gather`]; [`NumericalError`] if the matrix is singular to
    /// working precision, or not positive definite for `llt`.
    pub fn factorise(&mut self, data: &[f64]) -> Result<(), Error> {
        self.current = None;
        let values = self.pattern.gather(data)?;
        self.numbers.factorise(&self.pattern, &values)?;
        let probe_error = self.probe(&values)?;
        if probe_error <= self.precision().largest_probe_error() {
            let norm = self.pattern.norm(&values, |unknown| self.numbers.scale(unknown));
            self.current = Some(Current { values, norm, probe_error });
            return Ok(());
        }
        // NaN ends here too.
        Err(match self.precision() {
            Precision::Double => NumericalError::Singular { probe_error },
            Precision::Single => NumericalError::SingularInSingle { probe_error },
        }
        .into())
    }

    /// Solves A X = B for every column of `rhs` (n, `n_columns`), row after row.
    ///
    /// # Errors
    /// [`InputError`] if there is no factor, or `rhs` is not finite or of another length;
    /// [`NumericalError::Inaccurate`] if a solution does not satisfy the system after refinement.
    pub fn solve(&self, rhs: &[f64], n_columns: usize) -> Result<Vec<f64>, Error> {
        let current = self.current.as_ref().ok_or(InputError::NotFactorised)?;
        pattern::finite("rhs", rhs, self.n().saturating_mul(n_columns))?;
        let mut solution = rhs.to_vec();
        self.numbers.solve(&self.pattern, &mut solution)?;
        let (mut residual, mut backward_error) = self.residual(current, rhs, &solution);
        for _ in 0..self.precision().most_refinements() {
            if backward_error <= GOOD_BACKWARD_ERROR {
                break;
            }
            self.numbers.solve(&self.pattern, &mut residual)?;
            solution.iter_mut().zip(&residual).for_each(|(x, correction)| *x += correction);
            (residual, backward_error) = self.residual(current, rhs, &solution);
        }
        if backward_error <= LARGEST_BACKWARD_ERROR {
            return Ok(solution);
        }
        // NaN ends here too.
        Err(NumericalError::Inaccurate { backward_error }.into())
    }

    /// Applies the last factor once to one right-hand side (n,): neither checked nor refined.
    ///
    /// # Errors
    /// [`InputError`] if there is no factor, or `rhs` is of another length.
    pub fn precondition(&self, rhs: &[f64]) -> Result<Vec<f64>, Error> {
        if self.current.is_none() {
            return Err(InputError::NotFactorised.into());
        }
        pattern::as_many("rhs", rhs, self.n())?;
        let mut solution = vec![0.0; self.n()];
        self.numbers.apply(&self.pattern, rhs, |i, x| solution[i] = x)?;
        Ok(solution)
    }

    /// Solves A x = b for another matrix A of the same pattern by GMRES, preconditioned with the
    /// last factor, until ‖b − A x‖ is at most `tolerance` ‖b‖ or the factor was applied
    /// `most_steps` times. A may be unsymmetric whatever the kind.
    ///
    /// # Errors
    /// [`InputError`] if there is no factor, or `data` or `rhs` is not finite or of another length.
    ///
    /// # Examples
    /// ```
    /// use palpate_sparse::{Kind, Layout, Precision, SparseFactor};
    /// let (indptr, indices) = ([0, 2, 4], [0, 1, 0, 1]);
    /// let mut factor =
    ///     SparseFactor::new(&indptr, &indices, Layout::Csr, Kind::Ldlt, Precision::Single)?;
    /// factor.factorise(&[4.0, 1.0, 1.0, 3.0])?;
    /// let found = factor.krylov(&[4.0, 1.0, 0.9, 3.0], &[5.0, 3.9], 1e-12, 20)?;
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
    ) -> Result<Iterated, Error> {
        if self.current.is_none() {
            return Err(InputError::NotFactorised.into());
        }
        pattern::finite("data", data, self.n_data())?;
        pattern::finite("rhs", rhs, self.n())?;
        let matrix = (&self.pattern, self.pattern.rows());
        self.numbers.iterate(matrix, data, rhs, tolerance, most_steps)
    }

    /// Relative error with which a known solution comes back.
    fn probe(&self, values: &[f64]) -> Result<f64, Error> {
        // A low-discrepancy sequence in [0.5, 1.5): no rigid motion or checkerboard is orthogonal
        // to it, so that whatever the matrix cannot see shows.
        let golden = 0.618_033_988_749_894_9_f64;
        let mut share = 0.0_f64;
        let known: Vec<f64> = (0..self.n())
            .map(|i| {
                share = (share + golden).fract();
                (0.5 + share) * self.numbers.scale(i)
            })
            .collect();
        let mut found = vec![0.0; self.n()];
        self.pattern.multiply(values, &known, &mut found);
        self.numbers.solve(&self.pattern, &mut found)?;
        let errors = found.iter().zip(&known).map(|(f, k)| (f - k).abs());
        Ok(errors.enumerate().map(|(i, e)| e / self.numbers.scale(i)).fold(0.0, largest))
    }

    /// B − A X, and its largest size over the columns relative to ‖A‖ ‖x‖ + ‖b‖, all scaled.
    fn residual(&self, current: &Current, rhs: &[f64], solution: &[f64]) -> (Vec<f64>, f64) {
        let n = self.n();
        let k = rhs.len() / n;
        let mut residual = rhs.to_vec();
        let mut worst = 0.0;
        for column in 0..k {
            let x: Vec<f64> = solution.iter().skip(column).step_by(k).copied().collect();
            let mut product = vec![0.0; n];
            self.pattern.multiply(&current.values, &x, &mut product);
            let (mut left, mut b) = (0.0, 0.0);
            for (i, p) in product.into_iter().enumerate() {
                let scale = self.numbers.scale(i);
                b = largest(b, scale * rhs[i * k + column].abs());
                residual[i * k + column] -= p;
                left = largest(left, scale * residual[i * k + column].abs());
            }
            let sizes = x.iter().enumerate().map(|(i, v)| v.abs() / self.numbers.scale(i));
            let scale = current.norm * sizes.fold(0.0, largest) + b;
            worst = largest(worst, if left == 0.0 { 0.0 } else { left / scale });
        }
        (residual, worst)
    }
}

/// The larger of two numbers; NaN if either is.
fn largest(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}
